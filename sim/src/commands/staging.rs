//! `lodestream-sim staging`: arguments; prints a line per case.

use std::path::PathBuf;
use std::time::Duration;

use clap::Args;
use lodestream_report::staging::staging;
use lodestream_scenario::plan;

use crate::arguments::{Beside, CacheFolder};

#[derive(Debug, Args)]
pub(crate) struct Staging {
    /// The plan (TOML); each case runs with its first seed.
    plan: PathBuf,
    /// Another value for a key of the plan, as "sweep.rate_bits_per_s=16000000"; may be given more than once.
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Time between two frames.
    #[arg(long, default_value_t = 16, value_parser = clap::value_parser!(u64).range(1..=10_000))]
    frame_ms: u64,
    /// Runs of each case; their frames are evaluated together.
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=100))]
    repeats: u32,
    /// Print JSON instead of text.
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    cache: CacheFolder,
    #[command(flatten)]
    beside: Beside,
}

impl Staging {
    pub(crate) fn run(&self) -> anyhow::Result<()> {
        let plan = self.beside.add_to(plan::read_with(&self.plan, &self.set)?)?;
        let scenes = self.cache.open_scenes(&plan, true)?;
        let apart = Duration::from_millis(self.frame_ms);
        let all = staging(&plan, &scenes, apart, self.repeats, |one| {
            if !self.json {
                println!("{one}");
            }
        })?;
        if self.json {
            println!("{}", serde_json::to_string(&all)?);
        }
        Ok(())
    }
}
