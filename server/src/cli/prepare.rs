//! `prepare`: one model to one pack.

use std::num::NonZeroUsize;
use std::path::PathBuf;

use clap::Args;
use lodestream_import::gltf;

use super::outcome::Outcome;
use super::recipe::RecipeArguments;
use crate::prepare::{Options, prepare_to};
use crate::scene::Asset;
use crate::tell::tell;

#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// The model: OBJ, glTF, GLB or PLY. The meshes of a glTF file become one asset, each in its place.
    #[arg(value_name = "MODEL")]
    model: PathBuf,
    /// The pack to write.
    #[arg(short, long, value_name = "FILE.lsp")]
    output: PathBuf,
    /// Only this mesh of a glTF file, where it is about its own origin.
    #[arg(long, value_name = "NAME")]
    mesh: Option<String>,
    #[command(flatten)]
    recipe: RecipeArguments,
    /// Threads; the pack does not depend on it [default: as many as there are cores].
    #[arg(long, value_name = "N")]
    threads: Option<NonZeroUsize>,
    /// No progress.
    #[arg(short, long)]
    quiet: bool,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    let options =
        Options { recipe: arguments.recipe.resolve(), threads: arguments.threads, quiet: arguments.quiet };
    let mut asset = Asset::of_file(&arguments.model);
    if let Some(name) = &arguments.mesh {
        asset.part = gltf::part_named(&arguments.model, name)?;
        asset.name.clone_from(name);
    }
    let report = prepare_to(&asset, &options, &arguments.output)?;
    for warning in &report.warnings {
        tell(format_args!("warning: {warning}"));
    }
    Ok(Outcome::good(format!("{}: {report}\n", arguments.output.display())))
}
