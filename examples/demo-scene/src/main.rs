//! Writes a demo scene: models, textures and `scene.toml`.

use std::io::Write as _;
use std::path::PathBuf;

use anyhow::ensure;
use clap::{Parser, ValueEnum};
use lodestream_demo_scene::{Options, city, generate};

/// The scenes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum SceneName {
    /// A temple and an avenue of statues in a valley.
    Demo,
    /// Streets of buildings of parts.
    City,
}

/// Generates a demo scene: models, textures and scene.toml.
#[derive(Debug, Parser)]
#[command(name = "lodestream-demo-scene", version)]
struct Arguments {
    /// Folder to write to; created if it is missing.
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
    /// The scene to generate.
    #[arg(long, value_enum, default_value_t = SceneName::Demo)]
    scene: SceneName,
    /// Seed of the random shapes; the same options give the same files.
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// Linear resolution of the demo, 0.05 to 2; the number of faces grows with its square [default: 1].
    #[arg(long, value_name = "X")]
    detail: Option<f64>,
    /// Least number of parts of the city, 100 to 200000, of some 200 faces each [default: 1000].
    #[arg(long, value_name = "N")]
    parts: Option<usize>,
}

fn main() -> anyhow::Result<()> {
    let arguments = Arguments::parse();
    let seed = arguments.seed;
    let summary = match arguments.scene {
        SceneName::Demo => {
            ensure!(arguments.parts.is_none(), "--parts is for the city; leave it out, or add --scene city");
            generate(&arguments.output, &Options { seed, detail: arguments.detail.unwrap_or(1.0) })?
        }
        SceneName::City => {
            ensure!(arguments.detail.is_none(), "--detail is for the demo; a city has --parts");
            let parts = arguments.parts.unwrap_or(1_000);
            city::generate(&arguments.output, &city::Options { seed, parts })?
        }
    };
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
