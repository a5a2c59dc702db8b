//! The command line: parsed by clap, then resolved by each command.

mod check;
mod config;
mod export;
mod generate;
mod inspect;
mod log;
mod log_limit;
mod log_lines;
mod outcome;
mod preparation_settings;
mod prepare;
mod process;
mod publish;
mod serve;
mod terrain;
mod units;

use std::io::Write as _;
use std::process::ExitCode;

use clap::{CommandFactory as _, Parser, Subcommand};

use lodestream_bake::stderr::{one_line, write_line};
use outcome::Outcome;

/// Exit code for unusable input, the same that clap uses for unusable arguments.
const BAD_INPUT: u8 = 2;

/// Prepares 3D models for streaming, and streams them.
#[derive(Debug, Parser)]
#[command(name = "lodestream-server", version, about, max_term_width = 100)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Stream scenes: prepares models that are not prepared yet, then listens.
    Serve(Box<serve::Arguments>),
    /// Prepare one model (OBJ, glTF, PLY or STL) to a pack.
    Prepare(prepare::Arguments),
    /// Write a scene to a folder or store, from which any web server or daemon can stream it.
    Publish(publish::Arguments),
    /// Show the contents of a pack.
    Inspect(inspect::Arguments),
    /// Write the best mesh within a budget as OBJ.
    Export(export::Arguments),
    /// Check random ancestor-closed cuts for cracks, dependence on order and inexact undo.
    Check(check::Arguments),
    /// Generate one patch of a terrain: heights, a picture or a hash.
    Terrain(terrain::Arguments),
    /// Convert a 16-bit height map to features of a terrain.
    TerrainImport(terrain::ImportArguments),
    /// Write shell completions or manual pages.
    Generate(generate::Arguments),
}

/// Parses the command line and runs its command.
#[must_use]
pub fn main() -> ExitCode {
    process::set_up();
    let words = match config::with_file(&Cli::command(), std::env::args_os().collect()) {
        Ok(words) => words,
        Err(error) => return finish(Err(error)),
    };
    finish(match Cli::parse_from(&words).command {
        Command::Serve(arguments) => match &arguments.save_config {
            Some(file) => config::save(&Cli::command(), &words, file),
            None => serve::run(*arguments, serve_again),
        },
        Command::Prepare(arguments) => prepare::run(&arguments),
        Command::Publish(arguments) => publish::run(&arguments),
        Command::Inspect(arguments) => inspect::run(&arguments),
        Command::Export(arguments) => export::run(&arguments),
        Command::Check(arguments) => check::run(&arguments),
        Command::Terrain(arguments) => terrain::run(&arguments),
        Command::TerrainImport(arguments) => terrain::import(&arguments),
        Command::Generate(arguments) => generate::run(&arguments, Cli::command()),
    })
}

/// The arguments of `serve` parsed again, with the present contents of the file of `--config`.
fn serve_again() -> anyhow::Result<serve::Arguments> {
    let words = config::with_file(&Cli::command(), std::env::args_os().collect())?;
    match Cli::try_parse_from(words)?.command {
        Command::Serve(arguments) => Ok(*arguments),
        _ => anyhow::bail!("the command line is not of serve"),
    }
}

fn finish(outcome: anyhow::Result<Outcome>) -> ExitCode {
    match outcome {
        Ok(outcome) => {
            // A closed pipe (`| head`) is not an error.
            let _ = std::io::stdout().write_all(outcome.text.as_bytes());
            if outcome.good { ExitCode::SUCCESS } else { ExitCode::FAILURE }
        }
        Err(error) => {
            write_line(format_args!("error: {}", one_line(error.as_ref())));
            ExitCode::from(BAD_INPUT)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_arguments_are_consistent() {
        Cli::command().debug_assert();
    }

    #[test]
    fn documented_command_lines_parse() {
        for line in [
            "serve a.obj b.obj",
            "serve scene.toml --rate 2Mbit --listen 127.0.0.1:4433 --http 127.0.0.1:8080 --cache dir",
            "serve a.obj --rate-per-address 8Mbit --total-rate 1Gbit",
            "serve a.obj --rate-per-address off --total-rate off",
            "serve a.obj --admin 127.0.0.1:0",
            "serve a.obj --admin off",
            "serve a.obj --page target/web",
            "serve a.obj --token-keys keys.json --token-audience us",
            "serve a.obj --http-tls --cert c.pem --key k.pem",
            "serve a.obj --trusted-proxy 10.0.0.0/8,127.0.0.1 --trusted-proxy 2001:db8::/32",
            "serve a.obj --log-format json --log-limit 7",
            "serve a.obj --log-limit off",
            "serve a.obj --drain 0",
            "serve a.obj --drain 86400",
            "serve a.obj --max-sessions 100 --max-sessions-per-address 20",
            "serve a.obj --new-sessions-per-address 100",
            "serve a.obj --new-sessions-per-address off",
            "prepare a.obj -o a.lsp",
            "prepare a.obj -o a.lsp --position-bits 12 --threads 2",
            "prepare a.obj -o a.lsp --tolerance 0.001",
            "prepare a.glb -o a.lsp --mesh hose --uv-bits 10 --normal-tolerance 5",
            "prepare a.obj -o a.lsp --metric melax --round-size 0.1",
            "serve a.glb --metric qem --round-size heap --codec range",
            "prepare a.obj -o a.lsp --codec zstd",
            "prepare a.obj -o a.lsp --keep-levels",
            "prepare a.ply -o a.lsp --out-of-core dir",
            "publish hall.toml s3://bucket/scenes/",
            "publish hall.toml folder --page target/web",
            "publish a.obj b.glb folder --cache packs --threads 2 -q",
            "inspect a.lsp --json",
            "export a.lsp --faces 1000 -o b.obj",
            "export a.lsp --error 0.1 -o b.obj",
            "export a.lsp --bytes 40kB -o b.obj",
            "check a.lsp --random-sets 200 --seed 1",
            "check a.lsp --source a.glb --mesh hose",
            "terrain --seed 7 --level 8 --patch -3,5 --hash",
            "terrain --seed 7 --level 4 --finest 8 --patch 0,-1 --features f.json --erosion 9 --png out.png",
            "terrain --level 4 --patch=-1,-1 --amplitude 9 --roughness 0.6 --base -5 --spike-limit 1 --raw a.i32",
            "generate completions bash",
            "generate man dir",
            "terrain-import map.png -o f.json --every 8 --at -64,0 --offset -500",
        ] {
            let words = std::iter::once("lodestream-server").chain(line.split(' '));
            if let Err(error) = Cli::try_parse_from(words) {
                panic!("{line}: {error}");
            }
        }
        for line in [
            "serve",
            "prepare a.obj",
            "publish a.obj",
            "prepare a.obj -o a.lsp --position-bits 12 --tolerance 1",
            "prepare a.obj -o a.lsp --position-bits 25",
            "prepare a.obj -o a.lsp --tolerance -1",
            "prepare a.obj -o a.lsp --uv-bits 17",
            "prepare a.obj -o a.lsp --normal-tolerance 181",
            "prepare a.obj -o a.lsp --metric best",
            "prepare a.obj -o a.lsp --round-size 0.7",
            "prepare a.obj -o a.lsp --codec gzip",
            "prepare a.obj -o a.lsp --threads 0",
            "export a.lsp --faces 1 --error 1 -o b.obj",
            "serve a.obj --rate fast",
            "serve a.obj --rate-per-address 999",
            "serve a.obj --total-rate 0",
            "serve a.obj --admin 8081",
            "serve a.obj --trusted-proxy proxy.example",
            "serve a.obj --cert c.pem",
            "serve a.obj --token-audience us",
            "serve a.obj --log-format xml",
            "serve a.obj --log-limit 0",
            "serve a.obj --drain -1",
            "serve a.obj --drain 86401",
            "serve a.obj --max-sessions 0",
            "serve a.obj --max-sessions-per-address 0",
            "serve a.obj --new-sessions-per-address 0",
            "check a.lsp --mesh hose",
            "terrain --level 8 --patch 0,0",
            "terrain --level 8 --patch 0,0 --hash --raw a.i32",
            "terrain --level 8 --patch 0 --hash",
            "terrain --level 8 --patch 0,0 --hash --roughness 2",
            "terrain --level 8 --patch 0,0 --hash --distribution normal",
            "terrain --level 8 --patch 0,0 --hash --finest 13",
            "terrain --level 8 --patch 0,0 --hash --erosion 33",
            "terrain --level 8 --patch 0,0 --hash --erosion 8 --talus 1",
            "terrain --level 8 --patch 0,0 --hash --spike-limit 16",
            "terrain-import map.png -o f.json --every 0",
            "generate",
            "generate completions sh",
        ] {
            let words = std::iter::once("lodestream-server").chain(line.split(' '));
            assert!(Cli::try_parse_from(words).is_err(), "{line}");
        }
    }

    #[test]
    fn causes_are_printed_once_and_in_one_line() {
        let error = anyhow::anyhow!("disk\nfull").context("a.lsp: cannot be written: disk\nfull");
        assert_eq!(one_line(error.as_ref()), "a.lsp: cannot be written: disk full");
        let error = anyhow::anyhow!("disk full").context("a.lsp");
        assert_eq!(one_line(error.as_ref()), "a.lsp: disk full");
    }
}
