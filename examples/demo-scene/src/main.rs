//! Writes the demo scene: models, textures and `scene.toml`.

use std::io::Write as _;
use std::path::PathBuf;

use clap::Parser;
use lodestream_demo_scene::{Options, generate};

/// Generates the demo scene: models, textures and scene.toml.
#[derive(Debug, Parser)]
#[command(name = "lodestream-demo-scene", version)]
struct Arguments {
    /// Folder to write to; created if it is missing.
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
    /// Seed of the random shapes; the same options give the same files.
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// Linear resolution, 0.05 to 2; the number of faces grows with its square.
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

#[cfg(test)]
mod tests {
    use clap::CommandFactory as _;

    use super::Arguments;

    #[test]
    fn the_manual_page_names_each_flag() {
        let page = include_str!("../lodestream-demo-scene.1").replace("\\-", "-");
        for argument in Arguments::command().get_arguments() {
            let flag = format!("--{}", argument.get_long().unwrap());
            assert!(page.contains(&flag), "{flag}");
        }
    }
}
