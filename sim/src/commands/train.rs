//! `lodestream-sim train`: its arguments, and the table that it writes.

use std::path::PathBuf;

use anyhow::Context as _;
use clap::Args;
use lodestream_assess::train;

#[derive(Debug, Args)]
pub(crate) struct Train {
    /// The models.
    #[arg(required = true)]
    models: Vec<PathBuf>,
    /// The table: `geometry/src/codec/priors.bin`.
    #[arg(short, long)]
    output: PathBuf,
    /// Bits per axis of positions.
    #[arg(long, default_value_t = 12)]
    position_bits: u8,
}

impl Train {
    pub(crate) fn run(&self) -> anyhow::Result<()> {
        let table = train::train(&self.models, self.position_bits)?;
        let output = self.output.display();
        std::fs::write(&self.output, &table).with_context(|| format!("{output}: cannot be written"))?;
        println!("{output}: {} bytes", table.len());
        Ok(())
    }
}
