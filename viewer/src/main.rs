//! The program `lodestream-viewer`: command line, headless mode, window.

mod args;
mod figures;
mod headless;
mod report;
mod run;
mod window;

use std::process::ExitCode;

use args::Args;
use clap::Parser;
use tracing_subscriber::EnvFilter;

/// What is logged unless `RUST_LOG` says otherwise.
const LOGGED: &str = "warn,lodestream_client=info,lodestream_render=info,lodestream_viewer=info";

fn main() -> ExitCode {
    let filter = EnvFilter::try_from_default_env().unwrap_or_else(|_| EnvFilter::new(LOGGED));
    tracing_subscriber::fmt().with_env_filter(filter).with_writer(std::io::stderr).init();
    match run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(why) => {
            eprintln!("error: {why:#}");
            // 2: what was asked for cannot be done, as for a wrong command line.
            ExitCode::from(2)
        }
    }
}

/// Runs the program with the process's arguments.
///
/// # Errors
/// One line that says what went wrong and what to do.
fn run() -> anyhow::Result<()> {
    let args = Args::parse();
    if args.headless { headless::run(&args) } else { window::run(&args) }
}
