//! The program `lodestream-viewer`: command line, headless mode, window.

mod args;
mod figures;
mod files;
mod frames;
mod headless;
mod outcome;
mod report;
mod run;
mod signals;
mod token;
mod window;

use std::io::IsTerminal as _;
#[cfg(target_os = "linux")]
use std::path::Path;
use std::process::ExitCode;

use args::Args;
use clap::Parser;
use outcome::Outcome;
use tracing_subscriber::EnvFilter;

/// What is logged unless `RUST_LOG` says otherwise: of libraries, only what is wrong.
const LOGGED: &str = "error,lodestream_client=info,lodestream_render=info,lodestream_viewer=info";

fn main() -> ExitCode {
    without_wayland();
    let filter = EnvFilter::try_from_default_env().unwrap_or_else(|_| EnvFilter::new(LOGGED));
    // Colours are for people: in a file they are noise.
    let colours =
        std::io::stderr().is_terminal() && std::env::var_os("NO_COLOR").is_none_or(|no| no.is_empty());
    tracing_subscriber::fmt().with_env_filter(filter).with_writer(std::io::stderr).with_ansi(colours).init();
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
    let args = Args::parse();
    if args.headless { headless::run(&args) } else { window::run(&args) }
}
