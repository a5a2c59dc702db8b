//! The scene of a plan: generated if necessary, prepared, opened.

use std::path::Path;
use std::sync::Arc;

use anyhow::Context as _;
use lodestream_bake::preparation_settings::{CodecChoice, CreaseAngle, Precision, PreparationSettings};
use lodestream_bake::prepare::{Options, prepare_all};
use lodestream_bake::proxies;
use lodestream_bake::scene::{self, Scene};
use lodestream_daemon::MemoryScene;
use lodestream_protocol::source::{Immediate, SceneSource};
use lodestream_store::{BlobCache, DEFAULT_CACHE_BYTES, PackFile};

use super::plan::SceneChoice;
use super::published_scene;

/// Seed of the demo scene, independent of the simulation's seed.
const DEMO_SEED: u64 = 1;

/// Generates the scene if it is a generated one, prepares the packs that the cache folder lacks, and opens them. The
/// files of demo scene and city are generated anew each time, so that they match this version, and removed afterwards; its packs
/// stay in the cache. `codec` applies to scenes that name none.
///
/// # Errors
/// A scene that cannot be generated, read or prepared.
pub fn open(
    choice: &SceneChoice,
    codec: Option<CodecChoice>,
    cache: &Path,
    quiet: bool,
) -> anyhow::Result<Arc<dyn SceneSource>> {
    match choice {
        // A server refuses to prepare an empty scene; a client must accept one nevertheless.
        SceneChoice::Empty => Ok(Arc::new(MemoryScene::new(0, 0, 0))),
        SceneChoice::Published(place) => published_scene::open(place),
        _ => {
            let (scene, packs) = prepared(choice, codec, cache, quiet)?;
            let forest = proxies::make(&scene, &packs, cache, &Options { quiet, ..Options::default() })?;
            let blobs = BlobCache::new(DEFAULT_CACHE_BYTES);
            Ok(Arc::new(Immediate(lodestream_bake::compose::open_with(&scene, packs, forest, &blobs)?)))
        }
    }
}

/// The same as a scene and its packs, in the order of its assets.
pub(crate) fn packs(
    choice: &SceneChoice,
    codec: Option<CodecChoice>,
    cache: &Path,
) -> anyhow::Result<(Scene, Vec<PackFile>)> {
    prepared(choice, codec, cache, true)
}

fn prepared(
    choice: &SceneChoice,
    codec: Option<CodecChoice>,
    cache: &Path,
    quiet: bool,
) -> anyhow::Result<(Scene, Vec<PackFile>)> {
    let preparation_settings = PreparationSettings { codec, ..PreparationSettings::default() };
    let options = match choice {
        SceneChoice::Empty => return Ok((Scene::of_models(&[])?, Vec::new())),
        SceneChoice::Published(place) => {
            anyhow::bail!("{place} is published; here name the scene file that it was made from")
        }
        SceneChoice::File(file) => return prepare(scene::read(file)?, preparation_settings, cache, quiet),
        SceneChoice::Model { file, folder, position_bits } => {
            let folder = folder.as_ref().with_context(|| {
                format!(
                    "no folder of models is known for {file}; name one with --models DIR or LODESTREAM_MODELS"
                )
            })?;
            let precision = position_bits.map(Precision::Bits);
            // As the other codecs get it, which is positions alone where the file has no normals.
            let crease_angle = Some(CreaseAngle::SMOOTH);
            let preparation_settings =
                PreparationSettings { precision, crease_angle, ..preparation_settings };
            return prepare(Scene::of_models(&[folder.join(file)])?, preparation_settings, cache, quiet);
        }
        SceneChoice::Field(field) => {
            let folder = tempfile::tempdir().context("no folder for the scene")?;
            return prepare(field.generate(folder.path())?, preparation_settings, cache, quiet);
        }
        &SceneChoice::City(parts) => {
            let folder = tempfile::tempdir().context("no folder for the city")?;
            let options = lodestream_demo_scene::city::Options { seed: DEMO_SEED, parts };
            let made = lodestream_demo_scene::city::generate(folder.path(), &options)?;
            return prepare(scene::read(&made.scene)?, preparation_settings, cache, quiet);
        }
        SceneChoice::Demo => lodestream_demo_scene::Options::full(DEMO_SEED),
        SceneChoice::DemoSmall => lodestream_demo_scene::Options::small(DEMO_SEED),
    };
    let folder = tempfile::tempdir().context("no folder for the demo scene")?;
    if !quiet {
        eprintln!("generating the demo scene");
    }
    let made = lodestream_demo_scene::generate(folder.path(), &options)?;
    prepare(scene::read(&made.scene)?, preparation_settings, cache, quiet)
}

fn prepare(
    scene: Scene,
    preparation_settings: PreparationSettings,
    cache: &Path,
    quiet: bool,
) -> anyhow::Result<(Scene, Vec<PackFile>)> {
    let options = Options { preparation_settings, quiet, ..Options::default() };
    let packs = prepare_all(&scene.assets, cache, &options, |_, _| {})?;
    let packs = packs.into_iter().map(|cached| cached.pack).collect();
    Ok((scene, packs))
}
