//! `lodestream-sim normals`: arguments; prints a line per model and tolerance.

use std::path::PathBuf;

use clap::Args;
use lodestream_assess::normals;
use lodestream_bake::preparation_settings::{NormalTolerance, PositionBits};

use crate::print::Results;

#[derive(Debug, Args)]
pub(crate) struct Normals {
    /// The models.
    #[arg(required = true, value_name = "MODEL")]
    models: Vec<PathBuf>,
    /// Angles in degrees, 0 to 180, separated by commas.
    #[arg(long, value_delimiter = ',', default_value = "0,1,2,3,5,7.5,10,15,20,30,45")]
    tolerances: Vec<NormalTolerance>,
    /// Bits per axis of positions, 4 to 24, to which the faces are quantised.
    #[arg(long, default_value_t = PositionBits::default())]
    position_bits: PositionBits,
    /// Print JSON instead of text.
    #[arg(long)]
    json: bool,
}

impl Normals {
    pub(crate) fn run(&self) -> anyhow::Result<()> {
        let mut results = Results::new(self.json);
        for model in &self.models {
            let counted = normals::count(model, self.position_bits, &self.tolerances)?;
            counted.into_iter().for_each(|one| results.push(one));
        }
        results.finish().map(drop)
    }
}
