//! `lodestream-sim relief-methods`: arguments; prints tables.

use clap::Args;
use lodestream_report::pictures::relief_methods::{SIDE, compare};

use crate::print::print;

#[derive(Debug, Args)]
pub(crate) struct ReliefMethods {
    /// Rays per map and angle.
    #[arg(long, default_value_t = 4096, value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    rays: u32,
    /// Print JSON instead of tables.
    #[arg(long)]
    json: bool,
}

impl ReliefMethods {
    pub(crate) fn run(&self) -> anyhow::Result<()> {
        print(&compare(SIDE, self.rays), self.json)
    }
}
