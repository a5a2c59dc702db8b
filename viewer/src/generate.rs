//! `generate`: completions for shells, and the page of the manual, from what the arguments say of themselves. A word in
//! the place of the address, which no address is.

use std::ffi::OsString;
use std::io::Write as _;
use std::path::{Path, PathBuf};

use anyhow::Context as _;
use clap::{Command, CommandFactory as _, Parser, Subcommand};
use clap_complete::Shell;

use crate::args::Args;

/// The program where it is given no address.
#[derive(Debug, Parser)]
#[command(name = "lodestream-viewer")]
struct WithoutAddress {
    #[command(subcommand)]
    command: Word,
}

#[derive(Debug, Subcommand)]
enum Word {
    /// Write completions for a shell, or the page of the manual.
    Generate {
        #[command(subcommand)]
        what: What,
    },
}

#[derive(Debug, Subcommand)]
enum What {
    /// Completions for a shell, on standard output.
    Completions {
        /// The shell.
        shell: Shell,
    },
    /// The page of the manual.
    Man {
        /// Folder to write to; made where it is missing.
        #[arg(value_name = "DIR")]
        folder: PathBuf,
    },
}

/// Does what the words ask for, if they do; whether they did.
///
/// # Errors
/// Fails where the page cannot be written.
pub(crate) fn run(words: &[OsString]) -> anyhow::Result<bool> {
    if words.get(1).is_none_or(|word| word != "generate") {
        return Ok(false);
    }
    let WithoutAddress { command: Word::Generate { what } } = WithoutAddress::parse_from(words);
    match what {
        What::Completions { shell } => completions(shell, Args::command()),
        What::Man { folder } => {
            man(&folder, Args::command()).with_context(|| folder.display().to_string())?
        }
    }
    Ok(true)
}

fn completions(shell: Shell, mut command: Command) {
    let (name, mut script) = (command.get_name().to_owned(), Vec::new());
    clap_complete::generate(shell, &mut command, name, &mut script);
    // A reader that goes away (`| head`) is no error of ours.
    let _ = std::io::stdout().write_all(&script);
}

fn man(folder: &Path, command: Command) -> anyhow::Result<()> {
    std::fs::create_dir_all(folder)?;
    clap_mangen::generate_to(command, folder)?;
    Ok(())
}
