//! `demo-scene`: writes the demo scene.

use std::path::PathBuf;

use clap::Args;

use super::outcome::Outcome;
use super::preparation_settings::positive;
use crate::demo_scene::{Options, generate};

#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// Folder to write to; made where it is missing.
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
    /// The same seed gives the same scene.
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// Linear resolution, 0.05 to 2: faces go with its square.
    #[arg(long, value_name = "X", default_value_t = 1.0, value_parser = positive)]
    detail: f64,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    let options = Options { seed: arguments.seed, detail: arguments.detail };
    let summary = generate(&arguments.output, &options)?;
    Ok(Outcome::good(format!(
        "{}: {} assets, {} instances, {} distinct faces, {} faces with instances, {} bytes\n",
        summary.scene.display(),
        summary.assets,
        summary.instances,
        summary.distinct_faces,
        summary.instanced_faces,
        summary.bytes
    )))
}
