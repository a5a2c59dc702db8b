//! `lodestream-sim truth`: arguments; prints a line per case.

use std::path::PathBuf;

use anyhow::Context as _;
use clap::Args;
use lodestream_report::write_json;
use lodestream_scenario::{plan, truth};

use crate::arguments::{Beside, CacheFolder};

#[derive(Debug, Args)]
pub(crate) struct Truth {
    /// The plan (TOML); each case runs with its first seed.
    plan: PathBuf,
    /// Folder of truth.json and of figures.json, which has a row per figure.
    #[arg(short, long, value_name = "DIR")]
    output: Option<PathBuf>,
    /// Runs of each case in real time; their median is compared.
    #[arg(long, default_value_t = 5, value_parser = clap::value_parser!(u32).range(1..=i64::from(truth::MAX_REPEATS)))]
    repeats: u32,
    #[command(flatten)]
    cache: CacheFolder,
    #[command(flatten)]
    beside: Beside,
}

impl Truth {
    pub(crate) fn run(&self) -> anyhow::Result<()> {
        let plan = self.beside.add_to(plan::read(&self.plan)?)?;
        let scenes = self.cache.open_scenes(&plan, true)?;
        let compared = truth::run(&plan, &scenes, self.repeats, |comparison| println!("{comparison}"))?;
        let Some(folder) = &self.output else { return Ok(()) };
        write_json(folder, "truth.json", &compared)
            .and_then(|()| write_json(folder, "figures.json", &truth::figures(&compared)))
            .with_context(|| format!("{}: the report cannot be written", folder.display()))
    }
}
