//! The program `lodestream-viewer`: command line, headless mode, window.

mod args;
mod figures;
mod files;
mod frames;
mod generate;
mod headless;
mod log;
mod outcome;
mod report;
mod run;
mod signals;
mod token;
mod window;

#[cfg(target_os = "linux")]
use std::path::Path;
use std::process::ExitCode;

use args::Args;
use clap::Parser;
use outcome::Outcome;

fn main() -> ExitCode {
    without_wayland();
    log::to_stderr();
    match run() {
        Ok(outcome) => outcome.into(),
        Err(why) => {
            eprintln!("error: {why:#}");
            // 2: what was asked for cannot be done, as for a wrong command line.
            ExitCode::from(2)
        }
    }
}

/// Mesa's layer that puts the default graphics device first asks Wayland for it, which complains on standard error where
/// a session has none or names a folder that is not there. Then the layer has nothing to find out.
#[cfg(target_os = "linux")]
#[allow(unsafe_code, reason = "see SAFETY")]
fn without_wayland() {
    let is_set = |name| std::env::var_os(name).is_some();
    let runtime = std::env::var_os("XDG_RUNTIME_DIR");
    if !runtime.is_some_and(|folder| Path::new(&folder).is_dir()) && !is_set("MESA_VK_DEVICE_SELECT") {
        // SAFETY: the first thing that the program does: no other thread is there that might read the environment.
        unsafe { std::env::set_var("NODEVICE_SELECT", "1") };
    }
}

#[cfg(not(target_os = "linux"))]
fn without_wayland() {}

/// Runs the program with the process's arguments.
///
/// # Errors
/// One line that says what went wrong and what to do.
fn run() -> anyhow::Result<Outcome> {
    let words: Vec<_> = std::env::args_os().collect();
    if generate::run(&words)? {
        return Ok(Outcome::Finished);
    }
    let args = Args::parse_from(words);
    run::check(&args)?;
    if args.headless { headless::run(&args) } else { window::run(&args) }
}
