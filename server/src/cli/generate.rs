//! `generate`: shell completions and manual pages, generated from the arguments.

use std::path::{Path, PathBuf};

use anyhow::Context as _;
use clap::{Args, Command, Subcommand};
use clap_complete::Shell;

use super::outcome::Outcome;

#[derive(Debug, Args)]
pub(super) struct Arguments {
    #[command(subcommand)]
    what: What,
}

#[derive(Debug, Subcommand)]
enum What {
    /// Write completions for a shell to standard output.
    Completions {
        /// The shell.
        shell: Shell,
    },
    /// Write manual pages, one for each command.
    Man {
        /// Folder to write to; created if it is missing.
        #[arg(value_name = "DIR")]
        folder: PathBuf,
    },
}

pub(super) fn run(arguments: &Arguments, command: Command) -> anyhow::Result<Outcome> {
    match &arguments.what {
        What::Completions { shell } => completions(*shell, command),
        What::Man { folder } => man(folder, command).with_context(|| folder.display().to_string()),
    }
}

fn completions(shell: Shell, mut command: Command) -> anyhow::Result<Outcome> {
    let (name, mut script) = (command.get_name().to_owned(), Vec::new());
    clap_complete::generate(shell, &mut command, name, &mut script);
    Ok(Outcome::good(String::from_utf8(script)?))
}

fn man(folder: &Path, command: Command) -> anyhow::Result<Outcome> {
    std::fs::create_dir_all(folder)?;
    let name = command.get_name().to_owned();
    clap_mangen::generate_to(command, folder)?;
    Ok(Outcome::good(format!(
        "{} and a page for each command were written\n",
        folder.join(name).with_extension("1").display()
    )))
}
