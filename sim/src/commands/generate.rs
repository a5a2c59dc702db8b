//! `generate`: shell completions and manual pages, derived from the arguments.

use std::io::Write as _;
use std::path::{Path, PathBuf};

use anyhow::Context as _;
use clap::{Args, Subcommand};
use clap_complete::Shell;

#[derive(Debug, Args)]
pub(crate) struct Generate {
    #[command(subcommand)]
    output: Output,
}

#[derive(Debug, Subcommand)]
enum Output {
    /// Writes completions for a shell to standard output.
    Completions {
        /// The shell.
        shell: Shell,
    },
    /// Writes manual pages, one for each command.
    Man {
        /// Folder to write to; created if missing.
        #[arg(value_name = "DIR")]
        folder: PathBuf,
    },
}

impl Generate {
    /// `program` is the whole command line that is described.
    pub(crate) fn run(&self, program: clap::Command) -> anyhow::Result<()> {
        match &self.output {
            Output::Completions { shell } => {
                // A reader that closes the pipe early (`| head`) is not an error.
                let _ = std::io::stdout().write_all(&completions(program, *shell));
                Ok(())
            }
            Output::Man { folder } => man(program, folder).with_context(|| folder.display().to_string()),
        }
    }
}

fn completions(mut command: clap::Command, shell: Shell) -> Vec<u8> {
    let (name, mut script) = (command.get_name().to_owned(), Vec::new());
    clap_complete::generate(shell, &mut command, name, &mut script);
    script
}

fn man(command: clap::Command, folder: &Path) -> anyhow::Result<()> {
    std::fs::create_dir_all(folder)?;
    clap_mangen::generate_to(command, folder)?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory as _;

    use super::*;

    #[test]
    fn completions_and_manual_pages_cover_commands_and_flags() {
        for shell in [Shell::Bash, Shell::Zsh, Shell::Fish] {
            let script = String::from_utf8(completions(crate::Arguments::command(), shell)).unwrap();
            for word in ["reproduce", "peer-errors", "completions"] {
                assert!(script.contains(word), "{shell}: {word}");
            }
        }
        let folder = tempfile::tempdir().unwrap();
        let pages = folder.path().join("new/man1");
        man(crate::Arguments::command(), &pages).unwrap();
        for name in ["lodestream-sim.1", "lodestream-sim-run.1", "lodestream-sim-generate-man.1"] {
            assert!(pages.join(name).exists(), "{name}");
        }
        let page = std::fs::read_to_string(pages.join("lodestream-sim-run.1")).unwrap();
        assert!(page.contains("LODESTREAM_PEERS"), "{page}");
    }
}
