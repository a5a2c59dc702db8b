//! `lodestream-sim terrain-table`: arguments; prints tables.

use clap::Args;
use lodestream_scenario::baseline::terrain_table;

use crate::print::print;

#[derive(Debug, Args)]
pub(crate) struct TerrainTable {
    /// Number of generations of each size.
    #[arg(long, default_value_t = terrain_table::GENERATIONS, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    generations: u32,
    /// Print JSON instead of tables.
    #[arg(long)]
    json: bool,
}

impl TerrainTable {
    pub(crate) fn run(&self) -> anyhow::Result<()> {
        print(&terrain_table::terrain_table(self.generations)?, self.json)
    }
}
