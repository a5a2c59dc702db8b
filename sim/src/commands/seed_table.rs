//! `lodestream-sim seed-table`: arguments; prints a table.

use clap::Args;
use lodestream_scenario::baseline::seed_table;

use crate::print::print;

#[derive(Debug, Args)]
pub(crate) struct SeedTable {
    /// Print JSON instead of a table.
    #[arg(long)]
    json: bool,
}

impl SeedTable {
    pub(crate) fn run(&self) -> anyhow::Result<()> {
        print(&seed_table::seed_table()?, self.json)
    }
}
