//! `lodestream-sim reproduce`: arguments; reports differences.

use std::ffi::OsString;
use std::path::PathBuf;
use std::process::ExitCode;

use clap::Args;
use lodestream_report::reproduce::{self, Mode, Options};

#[derive(Debug, Args)]
pub(crate) struct Reproduce {
    /// Sections to run [default: all].
    #[arg(value_name = "SECTION")]
    only: Vec<String>,
    /// Folder of figures, reports, reproduction.json and reproduction.html, a page with every section.
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
    /// Folder of models that are not part of the project; without it, sections that need them are left out.
    #[arg(long, env = "LODESTREAM_MODELS", value_name = "DIR")]
    models: Option<PathBuf>,
    /// The list of sections.
    #[arg(long, value_name = "FILE", default_value = "docs/report/sections.toml")]
    sections: PathBuf,
    /// A page with tables, or a folder of pages; may be given more than once [default: BENCHMARKS.md and
    /// docs/benchmarks].
    #[arg(long, value_name = "FILE|DIR")]
    document: Vec<PathBuf>,
    /// Nodes of view-dependent peers: files and folders of *.json, separated by colons; without them, rows that need
    /// them are left out.
    #[arg(long, env = "LODESTREAM_PEERS", value_name = "FILE|DIR[:...]")]
    peers: Option<OsString>,
    /// Draco's encoder [default: draco_encoder, where $PATH has it]; rows that need it are left out without it.
    #[arg(long, env = "LODESTREAM_DRACO_ENCODER", value_name = "FILE")]
    draco_encoder: Option<PathBuf>,
    /// Replace the committed figures and the pages' tables instead of comparing.
    #[arg(long)]
    update: bool,
    /// Run nothing: regenerate the pages' tables from the committed figures.
    #[arg(long, conflicts_with = "update")]
    tables: bool,
}

impl Reproduce {
    /// Reproduces the sections; returns whether the figures agree, which determines the exit code.
    pub(crate) fn run(&self) -> anyhow::Result<ExitCode> {
        let mode = match (self.update, self.tables) {
            (true, _) => Mode::Update,
            (_, true) => Mode::Tables,
            _ => Mode::Compare,
        };
        // The commands take these from their environment.
        let draco_encoder = self.draco_encoder.clone().map(OsString::from);
        let beside = [("LODESTREAM_PEERS", self.peers.clone()), ("LODESTREAM_DRACO_ENCODER", draco_encoder)];
        let options = Options {
            sections: self.sections.clone(),
            documents: self.document.clone(),
            models: self.models.clone(),
            environment: beside.into_iter().filter_map(|(name, value)| Some((name, value?))).collect(),
            only: self.only.clone(),
            output: self.output.clone(),
            mode,
        };
        let made = reproduce::run(&options, |line| println!("{line}"))?;
        Ok(if made.agrees() { ExitCode::SUCCESS } else { ExitCode::FAILURE })
    }
}
