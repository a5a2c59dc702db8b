//! `lodestream-sim train`: arguments; writes a table of priors.

use std::path::PathBuf;

use anyhow::Context as _;
use clap::Args;
use lodestream_assess::train;
use lodestream_bake::preparation_settings::PositionBits;

#[derive(Debug, Args)]
pub(crate) struct Train {
    /// The models.
    #[arg(required = true)]
    models: Vec<PathBuf>,
    /// Output file: `crates/geometry/src/codec/priors.bin`.
    #[arg(short, long)]
    output: PathBuf,
    /// Bits per axis of positions, 4 to 24.
    #[arg(long, default_value = "12")]
    position_bits: PositionBits,
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
