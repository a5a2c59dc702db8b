//! `prepare`: a model to a pack. Both may be in an object store.

use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, bail};
use clap::Args;
use lodestream_geometry::pack::{HEAD_BYTES, Head};
use lodestream_import::gltf;

use super::outcome::Outcome;
use super::preparation_settings::PreparationArguments;
use crate::catalogue::fetch::fetch;
use lodestream_bake::mapping_allocator::{FROM_BYTES, MappingAllocator};
use lodestream_bake::prepare::{Options, Report, key_of, prepare_to};
use lodestream_bake::scene::Asset;
use lodestream_bake::stderr::write_line;
use lodestream_bake::warnings::Warnings;
use lodestream_store::{Objects, StoreError};

/// Longest list of a block, in bytes per face (that of quadrics), if its faces share vertices as in a closed surface.
/// Longer lists belong to the whole mesh, or to a block of disconnected faces.
const BLOCK_LIST_BYTES: usize = 48;

#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// The model: OBJ, glTF, GLB, PLY or STL; a path or a URL. The meshes of a glTF file become one asset with their
    /// placements.
    #[arg(value_name = "MODEL")]
    model: PathBuf,
    /// The pack to write, a path or a URL. Whole scenes are published instead (`publish`).
    #[arg(short, long, value_name = "FILE.lsp")]
    output: PathBuf,
    /// Prepare only this mesh of a glTF file, without its transform.
    #[arg(long, value_name = "NAME")]
    mesh: Option<String>,
    #[command(flatten)]
    preparation_settings: PreparationArguments,
    /// Number of threads; the pack does not depend on it [default: one per core].
    #[arg(long, value_name = "N")]
    threads: Option<NonZeroUsize>,
    /// Keep finished levels beside the pack until it is complete, so that an interrupted run can be resumed; always on
    /// from a million faces.
    #[arg(long)]
    keep_levels: bool,
    /// For meshes larger than memory: keep lists longer than a block's (--block-faces) in files of this folder, which
    /// must be on a disk; takes about 250 bytes per face. The pack is the same.
    #[arg(long, value_name = "DIR")]
    out_of_core: Option<PathBuf>,
    /// Show no progress.
    #[arg(short, long)]
    quiet: bool,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    let preparation_settings = arguments.preparation_settings.resolve();
    let from_bytes = FROM_BYTES.max(BLOCK_LIST_BYTES * preparation_settings.simplify_settings().block_faces);
    let _mapping = arguments
        .out_of_core
        .as_deref()
        .map(|folder| MappingAllocator::into(folder, from_bytes))
        .transpose()?;
    let options = Options {
        preparation_settings,
        threads: arguments.threads,
        quiet: arguments.quiet,
        keep_levels: arguments.keep_levels,
        watch: None,
    };
    let Arguments { model, output, .. } = arguments;
    let (to_store, to_pack) =
        (Objects::is_url(output), output.extension().is_some_and(|ending| ending == "lsp"));
    let to_folder =
        to_store && !to_pack || output.is_dir() || output.as_os_str().to_string_lossy().ends_with('/');
    if to_folder || model.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("toml")) {
        bail!(
            "a scene is written to a folder or store by: lodestream-server publish {} FOLDER; prepare writes one pack, \
             --output FILE.lsp",
            model.display()
        );
    }
    if !to_store && !Objects::is_url(model) {
        let report = prepare_to(&asset(arguments, model)?, &options, output)?;
        return Ok(print_report(&report, output));
    }
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    // Deleted at the end of the function.
    let folder = tempfile::tempdir().context("a temporary folder for downloads cannot be created")?;
    let local = match model.to_str() {
        Some(url) if Objects::is_url(model) => runtime.block_on(fetch(url, folder.path()))?,
        _ => model.clone(),
    };
    if !to_store {
        let report = prepare_to(&asset(arguments, &local)?, &options, output)?;
        return Ok(print_report(&report, output));
    }
    let url = output.to_string_lossy();
    let (root, name) = url.rsplit_once('/').context("the URL of a pack must end with /NAME.lsp")?;
    let objects = Objects::of_url(root)?;
    let asset = asset(arguments, &local)?;
    let key = key_of(&asset, &options)?.bytes();
    let there = match runtime.block_on(objects.start(name, HEAD_BYTES as u64)) {
        Ok(head) => Head::parse(&head).is_ok_and(|head| head.fingerprint == key),
        Err(StoreError::NoSuchObject { .. }) => false,
        Err(why) => return Err(why.into()),
    };
    if there {
        return Ok(Outcome::good(format!("{url}: exists already, for the same model and settings\n")));
    }
    let pack = folder.path().join("pack.lsp");
    let report = prepare_to(&asset, &options, &pack)?;
    runtime.block_on(objects.put(name, std::fs::read(&pack)?.into()))?;
    Ok(print_report(&report, output))
}

/// The model as an asset, restricted to the mesh of `--mesh`.
fn asset(arguments: &Arguments, model: &Path) -> anyhow::Result<Asset> {
    let mut asset = Asset::of_file(model);
    if let Some(name) = &arguments.mesh {
        asset.part = gltf::part_named(model, name)?;
        asset.name.clone_from(name);
    }
    Ok(asset)
}

fn print_report(report: &Report, output: &Path) -> Outcome {
    let mut warnings = Warnings::default();
    // All are of one model.
    warnings.add(Path::new(""), &report.warnings);
    warnings.lines().for_each(|warning| write_line(format_args!("warning: {warning}")));
    Outcome::good(format!("{}: {report}\n", output.display()))
}
