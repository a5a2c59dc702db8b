//! `lodestream-sim normals`: its arguments, and a line for each model and tolerance.

use std::path::PathBuf;

use clap::Args;
use lodestream_assess::normals;
use lodestream_geometry::quantise::{DEFAULT_POSITION_BITS, MAX_POSITION_BITS, MIN_POSITION_BITS};
use lodestream_server::prepare::recipe::check_normal_tolerance;

#[derive(Debug, Args)]
pub(crate) struct Normals {
    /// The models.
    #[arg(required = true, value_name = "MODEL")]
    models: Vec<PathBuf>,
    /// Angles in degrees, 0 to 180, divided by commas.
    #[arg(long, value_delimiter = ',', default_value = "0,1,2,3,5,7.5,10,15,20,30,45", value_parser = tolerance)]
    tolerances: Vec<f64>,
    /// Bits per axis of positions, on whose grid the faces lie.
    #[arg(
        long,
        default_value_t = DEFAULT_POSITION_BITS,
        value_parser = clap::value_parser!(u8).range(i64::from(MIN_POSITION_BITS)..=i64::from(MAX_POSITION_BITS))
    )]
    position_bits: u8,
    /// Prints JSON instead of text.
    #[arg(long)]
    json: bool,
}

fn tolerance(text: &str) -> Result<f64, String> {
    text.parse().map_err(|_| "a number of degrees is needed".to_owned()).and_then(check_normal_tolerance)
}

impl Normals {
    pub(crate) fn run(&self) -> anyhow::Result<()> {
        let mut all = Vec::new();
        for model in &self.models {
            let counted = normals::count(model, self.position_bits, &self.tolerances)?;
            if !self.json {
                counted.iter().for_each(|one| println!("{one}"));
            }
            all.extend(counted);
        }
        if self.json {
            println!("{}", serde_json::to_string(&all)?);
        }
        Ok(())
    }
}
