//! `generate`: shell completions and the man page, generated from the arguments. The word takes the place of the
//! address.

use std::ffi::OsString;
use std::io::Write as _;
use std::path::{Path, PathBuf};

use anyhow::Context as _;
use clap::{Command, Parser, Subcommand};
use clap_complete::Shell;

use crate::arg_groups;

/// The command line without an address.
#[derive(Debug, Parser)]
#[command(name = "lodestream-viewer")]
struct WithoutAddress {
    #[command(subcommand)]
    command: GenerateCommand,
}

#[derive(Debug, Subcommand)]
enum GenerateCommand {
    /// Write shell completions or the man page.
    Generate {
        #[command(subcommand)]
        target: GenerateTarget,
    },
}

#[derive(Debug, Subcommand)]
enum GenerateTarget {
    /// Write completions for a shell to standard output.
    Completions {
        /// The shell.
        shell: Shell,
    },
    /// Write the man page.
    Man {
        /// Folder to write to; created if it is missing.
        #[arg(value_name = "DIR")]
        folder: PathBuf,
    },
}

/// Runs `generate` if the arguments name it; returns whether they do.
///
/// # Errors
/// The man page cannot be written.
pub(crate) fn run(arguments: &[OsString]) -> anyhow::Result<bool> {
    if arguments.get(1).is_none_or(|first| first != "generate") {
        return Ok(false);
    }
    let WithoutAddress { command: GenerateCommand::Generate { target } } =
        WithoutAddress::parse_from(arguments);
    match target {
        GenerateTarget::Completions { shell } => completions(shell, arg_groups::command(true)),
        GenerateTarget::Man { folder } => {
            man(&folder, arg_groups::command(true)).with_context(|| folder.display().to_string())?
        }
    }
    Ok(true)
}

fn completions(shell: Shell, mut command: Command) {
    let (name, mut script) = (command.get_name().to_owned(), Vec::new());
    clap_complete::generate(shell, &mut command, name, &mut script);
    // A closed pipe (`| head`) is not an error.
    let _ = std::io::stdout().write_all(&script);
}

fn man(folder: &Path, command: Command) -> anyhow::Result<()> {
    std::fs::create_dir_all(folder)?;
    clap_mangen::generate_to(command, folder)?;
    Ok(())
}
