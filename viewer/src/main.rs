//! The program `lodestream-viewer`: command line, headless mode, window.

mod animation;
mod arg_groups;
mod args;
mod figures;
mod files;
mod frames;
mod generate;
mod headless;
mod local;
mod log;
mod matte;
mod outcome;
mod part_args;
mod part_names;
mod parts;
mod recent;
mod report;
mod run;
mod sequence;
mod settings_file;
mod signals;
mod token;
mod window;

use std::io::Write as _;
#[cfg(target_os = "linux")]
use std::path::Path;
use std::process::ExitCode;

use local::Target;
use lodestream_bake::stderr::{one_line, write_line};
use outcome::Outcome;

fn main() -> ExitCode {
    disable_device_select_layer();
    log::to_stderr();
    match run() {
        Ok(outcome) => outcome.into(),
        Err(why) => {
            write_line(format_args!("error: {}", one_line(why.as_ref())));
            // 2, as clap has it for a wrong command line.
            ExitCode::from(2)
        }
    }
}

/// Disables Mesa's device selection layer where there is no Wayland: the layer asks Wayland for the default device, and
/// libwayland prints an error if `XDG_RUNTIME_DIR` is missing or not a folder.
#[cfg(target_os = "linux")]
#[allow(unsafe_code, reason = "see SAFETY")]
fn disable_device_select_layer() {
    let is_set = |name| std::env::var_os(name).is_some();
    let runtime = std::env::var_os("XDG_RUNTIME_DIR");
    if !runtime.is_some_and(|folder| Path::new(&folder).is_dir()) && !is_set("MESA_VK_DEVICE_SELECT") {
        // SAFETY: called first in `main`: no other thread exists that could read the environment.
        unsafe { std::env::set_var("NODEVICE_SELECT", "1") };
    }
}

#[cfg(not(target_os = "linux"))]
fn disable_device_select_layer() {}

/// Runs the program with the process's arguments.
///
/// # Errors
/// One line with the fault and the remedy.
fn run() -> anyhow::Result<Outcome> {
    let arguments: Vec<_> = std::env::args_os().collect();
    if generate::run(&arguments)? {
        return Ok(Outcome::Finished);
    }
    let args = arg_groups::parse(arguments);
    if args.help_all {
        let help = arg_groups::command(true).render_long_help();
        // A closed pipe is not an error.
        let _ = writeln!(std::io::stdout(), "{help}");
        return Ok(Outcome::Finished);
    }
    let target = if args.files.is_empty() { None } else { Some(Target::of(&args.files)?) };
    if let Some(target) = &target {
        run::check(&args, target)?;
    }
    let outcome = match target {
        Some(target) if args.headless => headless::run(&args, target),
        target => window::run(&args, target),
    };
    // Threads may still be preparing files.
    local::remove_at_once();
    outcome
}
