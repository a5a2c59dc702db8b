//! Writes the demo scene: models, textures and `scene.toml`.

use std::io::Write as _;
use std::path::PathBuf;

use clap::Parser;
use lodestream_demo_scene::{Options, generate};

/// Generates the demo scene: models, textures and scene.toml.
#[derive(Debug, Parser)]
#[command(name = "lodestream-demo-scene", version)]
struct Arguments {
    /// Folder to write to; made where it is missing.
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
    /// The same seed gives the same scene.
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// Linear resolution, 0.05 to 2: faces go with its square.
    #[arg(long, value_name = "X", default_value_t = 1.0)]
    detail: f64,
}

fn main() -> anyhow::Result<()> {
    let arguments = Arguments::parse();
    let summary = generate(&arguments.output, &Options { seed: arguments.seed, detail: arguments.detail })?;
    writeln!(
        std::io::stdout(),
        "{}: {} assets, {} instances, {} distinct faces, {} faces with instances, {} bytes",
        summary.scene.display(),
        summary.assets,
        summary.instances,
        summary.distinct_faces,
        summary.instanced_faces,
        summary.bytes
    )?;
    Ok(())
}
