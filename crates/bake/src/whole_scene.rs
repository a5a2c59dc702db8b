//! A scene with all its packs: prepared, then opened for a server, or published in a folder beside the cache.

use std::io;
use std::path::{Path, PathBuf};

use lodestream_scene::published::pack_name;
use lodestream_store::{BlobCache, PackFile, SceneObject, SceneObjectError, SceneStore, StoreError};

use crate::compose::framing::framing;
use crate::compose::{ComposeError, describe, open_with};
use crate::prepare::coarse::stand_ins;
use crate::prepare::{Options, PrepareError, prepare_all_of};
use crate::proxies::{self, Forest};
use crate::scene::{Asset, Scene};
use crate::sources::Sources;
use crate::stderr::write_line;
use crate::warnings::Warnings;

/// Name of the published scene in its folder.
const SCENE_FILE: &str = "scene.lss";

/// A scene whose packs are there.
#[derive(Debug)]
pub struct WholeScene {
    scene: Scene,
    packs: Vec<PackFile>,
    forest: Option<Forest>,
    /// Files that the models were read from.
    pub files: Vec<PathBuf>,
    /// How many packs were prepared; the others were in the cache.
    pub prepared: usize,
}

/// A scene that cannot be prepared.
#[derive(Debug, thiserror::Error)]
#[error("{why}")]
pub struct WholeSceneError {
    /// The asset at fault, if it is one.
    pub asset: Option<Box<Asset>>,
    /// Why.
    pub why: PrepareError,
}

/// A scene that cannot be published in a folder.
#[derive(Debug, thiserror::Error)]
pub enum PublishError {
    /// It cannot be described.
    #[error(transparent)]
    Compose(#[from] ComposeError),
    /// A pack cannot be read.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// It is too large for one object.
    #[error(transparent)]
    Object(#[from] SceneObjectError),
    /// A file cannot be written.
    #[error("{}: cannot be written: {source}", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
}

impl WholeScene {
    /// Prepares what is not in the cache folder. Reports and warnings are written to standard error.
    ///
    /// # Errors
    /// Of the first asset with one. Packs that were prepared stay in the cache.
    pub fn prepare(
        mut scene: Scene,
        cache: &Path,
        options: &Options,
        sources: &Sources,
    ) -> Result<Self, WholeSceneError> {
        let (mut done, mut prepared, mut warnings) = (0, 0, Warnings::default());
        let all = prepare_all_of(&scene.assets, cache, options, sources, |number, cached| {
            done += 1;
            if let Some(report) = &cached.report {
                prepared += 1;
                warnings.add(&scene.assets[number].file, &report.warnings);
                write_line(format_args!("{}: {report}", scene.assets[number].name));
            }
        });
        warnings.lines().for_each(|warning| write_line(format_args!("warning: {warning}")));
        // Assets are done in order: the next one is at fault.
        let at_fault = |why| WholeSceneError { asset: scene.assets.get(done).cloned().map(Box::new), why };
        let all = all.map_err(at_fault)?;
        let (mut packs, mut files) = (Vec::with_capacity(all.len()), Vec::new());
        for cached in all {
            files.extend(cached.files);
            packs.push(cached.pack);
        }
        // Assets of one model name the same files.
        files.sort_unstable();
        files.dedup();
        frame(&mut scene, &packs)?;
        let forest = proxies::make(&scene, &packs, cache, options);
        let forest = forest.map_err(|why| WholeSceneError { asset: None, why })?;
        if let Some(forest) = forest.as_ref().filter(|forest| forest.prepared > 0) {
            prepared += forest.prepared;
            write_line(format_args!("{}: {forest}", scene.name));
        }
        Ok(Self { scene, packs, forest, files, prepared })
    }

    /// The scene with coarse stand-ins for large models that are not in the cache folder, which are written to `folder`;
    /// `None` if it needs none: the whole scene is soon prepared.
    ///
    /// # Errors
    /// Of the first asset with one.
    pub fn coarse(
        scene: &Scene,
        cache: &Path,
        folder: &Path,
        options: &Options,
        sources: &Sources,
    ) -> Result<Option<Self>, WholeSceneError> {
        let packs = stand_ins(&scene.assets, cache, folder, options, sources).map_err(|(number, why)| {
            WholeSceneError { asset: scene.assets.get(number).cloned().map(Box::new), why }
        })?;
        let Some(packs) = packs else { return Ok(None) };
        let mut scene = scene.clone();
        frame(&mut scene, &packs)?;
        Ok(Some(Self { scene, packs, forest: None, files: Vec::new(), prepared: 0 }))
    }

    /// Opens the scene for a server; its blobs are in a cache that other scenes may share.
    ///
    /// # Errors
    /// As [`open_with`].
    pub fn open(self, blobs: &BlobCache) -> Result<SceneStore, ComposeError> {
        open_with(&self.scene, self.packs, self.forest, blobs)
    }

    /// Publishes the scene in a folder, as links to its packs, and returns its file. Packs are only copied where the system
    /// has no links.
    ///
    /// # Errors
    /// See [`PublishError`].
    pub fn publish_in(self, folder: &Path) -> Result<PathBuf, PublishError> {
        let (description, packs) = describe(&self.scene, self.packs, self.forest)?;
        for pack in &packs {
            let path = folder.join(pack_name(&pack.made_from()));
            link(pack.path(), &path).map_err(|source| PublishError::Write { path, source })?;
        }
        let packs = packs.iter().map(|pack| pack.published(pack.made_from())).collect::<Result<_, _>>()?;
        let bytes = SceneObject { packs, description }.encode()?;
        let path = folder.join(SCENE_FILE);
        std::fs::write(&path, bytes).map_err(|source| PublishError::Write { path: path.clone(), source })?;
        Ok(path)
    }
}

/// Gives a scene without a camera one that frames it.
fn frame(scene: &mut Scene, packs: &[PackFile]) -> Result<(), WholeSceneError> {
    let found = framing(scene, packs).map_err(|why| WholeSceneError { asset: None, why: why.into() })?;
    scene.camera = scene.camera.or(found);
    Ok(())
}

/// Makes a second name of a file, which keeps its content where the first is replaced.
fn link(from: &Path, to: &Path) -> io::Result<()> {
    if let Some(parent) = to.parent() {
        std::fs::create_dir_all(parent)?;
    }
    if to.exists() || std::fs::hard_link(from, to).is_ok() {
        return Ok(());
    }
    // On another disk, for example.
    #[cfg(unix)]
    if let Ok(whole) = std::fs::canonicalize(from)
        && std::os::unix::fs::symlink(whole, to).is_ok()
    {
        return Ok(());
    }
    std::fs::copy(from, to).map(drop)
}

#[cfg(test)]
mod tests {
    use std::fmt::Write as _;

    use super::*;
    use crate::prepare::coarse::MIN_SCENE_FACES;
    use crate::scene::of_files;

    /// A hilly square of `2 × cells²` faces.
    fn write_hills(path: &Path, cells: usize) {
        let mut obj = String::new();
        for (i, j) in (0..=cells).flat_map(|i| (0..=cells).map(move |j| (i, j))) {
            let [x, z] = [i, j].map(|at| at as f64 / cells as f64);
            writeln!(obj, "v {x:.5} {:.5} {z:.5}", 0.1 * (9.0 * x).sin() * (7.0 * z).cos()).unwrap();
        }
        let at = |i: usize, j: usize| 1 + i * (cells + 1) + j;
        for (i, j) in (0..cells).flat_map(|i| (0..cells).map(move |j| (i, j))) {
            writeln!(obj, "f {} {} {} {}", at(i, j), at(i, j + 1), at(i + 1, j + 1), at(i + 1, j)).unwrap();
        }
        std::fs::write(path, obj).unwrap();
    }

    fn options() -> Options {
        Options { quiet: true, ..Options::default() }
    }

    fn faces(scene: &WholeScene) -> u64 {
        let contents = scene.packs.iter().map(|pack| pack.load().unwrap());
        let of = |asset: lodestream_store::LoadedAsset| {
            asset.base.faces.len() as u64 + asset.infos.iter().map(|info| u64::from(info.faces)).sum::<u64>()
        };
        contents.map(of).sum()
    }

    #[test]
    fn a_large_model_has_a_coarse_stand_in_until_it_is_in_the_cache() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        write_hills(&at("hills.obj"), 230);
        write_hills(&at("small.obj"), 20);
        let cache = at("cache");
        let scene =
            |names: &[&str]| of_files(&names.iter().map(|name| at(name)).collect::<Vec<_>>()).unwrap();
        let coarse = |scene: &Scene, sources: &Sources| {
            let stand_ins = tempfile::tempdir_in(folder.path()).unwrap();
            let made = WholeScene::coarse(scene, &cache, stand_ins.path(), &options(), sources).unwrap();
            made.map(|made| (faces(&made), made.publish_in(stand_ins.path()).unwrap().exists()))
        };
        let (both, sources) = (scene(&["hills.obj", "small.obj"]), Sources::in_folder(&cache));
        let (stand_in, published) = coarse(&both, &sources).unwrap();
        assert!((5_000..=40_000).contains(&stand_in) && published, "{stand_in} faces");
        assert!(coarse(&scene(&["small.obj"]), &sources).is_none(), "a small model is soon prepared");
        let whole = WholeScene::prepare(both.clone(), &cache, &options(), &sources).unwrap();
        assert_eq!((whole.prepared, faces(&whole)), (2, 2 * (230 * 230 + 20 * 20)));
        assert!(faces(&whole) as usize > MIN_SCENE_FACES);
        let again = Sources::in_folder(&cache);
        assert!(coarse(&both, &again).is_none(), "it is in the cache");
        assert_eq!(WholeScene::prepare(both, &cache, &options(), &again).unwrap().prepared, 0);
    }

    #[cfg(unix)]
    #[test]
    fn published_packs_are_the_cached_ones_and_packs_need_no_model() {
        use std::os::unix::fs::MetadataExt as _;
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        write_hills(&at("hills.obj"), 30);
        let publish = |file: PathBuf, to: &str| {
            let (scene, sources) = (of_files(&[file]).unwrap(), Sources::default());
            let whole = WholeScene::prepare(scene, &at("cache"), &options(), &sources).unwrap();
            let pack = whole.packs[0].path().to_owned();
            std::fs::create_dir(at(to)).unwrap();
            let file = whole.publish_in(&at(to)).unwrap();
            let packs = std::fs::read_dir(at(to).join("packs")).unwrap();
            let packs: Vec<PathBuf> = packs.map(|entry| entry.unwrap().path()).collect();
            assert_eq!(packs.len(), 1);
            let inode = |path: &Path| std::fs::metadata(path).unwrap().ino();
            assert_eq!(inode(&packs[0]), inode(&pack), "the pack was copied");
            (pack, std::fs::read(file).unwrap())
        };
        let (pack, of_model) = publish(at("hills.obj"), "one");
        std::fs::rename(&pack, at("hills.lsp")).unwrap();
        let (_, of_pack) = publish(at("hills.lsp"), "two");
        assert_eq!(of_model, of_pack);
    }

    #[test]
    fn the_asset_at_fault_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        write_hills(&at("a.obj"), 4);
        std::fs::write(at("b.obj"), "v 0 0 0\nf 1 2 3\n").unwrap();
        write_hills(&at("c.obj"), 5);
        let scene = of_files(&["a.obj", "b.obj", "c.obj"].map(at)).unwrap();
        let failed = WholeScene::prepare(scene, &at("cache"), &options(), &Sources::default()).unwrap_err();
        assert_eq!(failed.asset.unwrap().file, at("b.obj"));
    }
}
