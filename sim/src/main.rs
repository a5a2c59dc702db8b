//! `lodestream-sim`: assesses models, compares meshes, and streams scenes over simulated links.
//!
//! Exit codes: 0 done, 1 figures differ from those committed, 2 bad input (one line says what, where and what to do).

mod arguments;
mod commands;
mod print;
mod progress;

use std::process::ExitCode;

use clap::{CommandFactory as _, Parser};

/// Compares meshes and streams scenes over simulated links.
#[derive(Debug, Parser)]
#[command(name = "lodestream-sim", version)]
struct Arguments {
    #[command(subcommand)]
    command: commands::Command,
}

fn main() -> ExitCode {
    Arguments::parse().command.run(Arguments::command()).unwrap_or_else(|error| {
        eprintln!("error: {}", one_line(&error));
        ExitCode::from(2)
    })
}

/// The error and its causes, without causes that the text before them contains already.
fn one_line(error: &anyhow::Error) -> String {
    error.chain().map(ToString::to_string).fold(String::new(), |mut line, cause| {
        if !line.contains(&cause) {
            if !line.is_empty() {
                line.push_str(": ");
            }
            line.push_str(&cause);
        }
        line
    })
}
