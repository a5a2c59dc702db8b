//! Preparation of a model file as a pack.

pub mod cache;
mod checkpoint_folder;
pub mod coarse;
pub mod describe;
mod known_keys;
mod materials_key;
mod progress;
pub(crate) mod settings_key;
mod sizes;
#[cfg(test)]
mod tests;
pub(crate) mod texture_regions;

use std::fmt;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant, SystemTime};

use crate::preparation_settings::{Effort, PreparationSettings};
use lodestream_compress::whole_file::write_atomically;
use lodestream_compress::{encode_base, prepare_with_hooks};
use lodestream_geometry::pack::BlobKind;
use lodestream_geometry::pool::Pool as _;
use lodestream_geometry::prepare::{Hooks, suit};
use lodestream_geometry::quantise::quantise;
use lodestream_geometry::{MeshError, Settings};
use lodestream_import::{ImportError, Imported, Part, is_gltf};
use lodestream_scene::asset::{DescriptionError, TextureInfo};

use crate::mapping_allocator::MappingAllocator;
use crate::scene::Asset;
use crate::sources::{Source, Sources, free_memory};
use lodestream_store::{PackFile, StoreError};

use checkpoint_folder::CheckpointFolder;
pub use checkpoint_folder::{LOCK as LEVELS_LOCK, Resumed, remove_stale_levels};
use describe::DescribeError;
use known_keys::KnownKeys;
pub use lodestream_threads::Threads;
pub use progress::{Reporter, Watch};
use settings_key::{PackSettings, pack_version};
use sizes::Sizes;

/// Options of a preparation.
#[derive(Clone, Debug, Default)]
pub struct Options {
    /// Settings that take precedence over the asset's own: flags over files.
    pub preparation_settings: PreparationSettings,
    /// Number of threads; `None`: one per core. The pack does not depend on it.
    pub threads: Option<NonZeroUsize>,
    /// Disables the display of progress.
    pub quiet: bool,
    /// Keeps checkpoints beside the pack even for models below [`CHECKPOINT_MIN_FACES`].
    pub keep_levels: bool,
    /// Follows the progress and may cancel.
    pub watch: Option<Watch>,
}

/// Least number of faces for which checkpoints are kept beside the pack: from here on a preparation takes one core at
/// least ten seconds.
pub const CHECKPOINT_MIN_FACES: usize = 1_000_000;

/// Peak bytes of a preparation's lists per face, the input included (docs/benchmarks/preparation.md).
const LIST_BYTES_A_FACE: u64 = 300;

/// A model that cannot be prepared.
#[derive(Debug, thiserror::Error)]
pub enum PrepareError {
    /// The model cannot be imported.
    #[error(transparent)]
    Import(#[from] ImportError),
    /// The mesh cannot be used.
    #[error("{}: {source}", path.display())]
    Mesh {
        /// The model.
        path: PathBuf,
        /// Why.
        source: MeshError,
    },
    /// Its materials cannot be used.
    #[error("{}: {source}", path.display())]
    Describe {
        /// The model.
        path: PathBuf,
        /// Why.
        source: describe::DescribeError,
    },
    /// The pack cannot be written.
    #[error("{}: cannot be written: {source}", path.display())]
    Write {
        /// The pack.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// The pack just written cannot be opened.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// The disk for an out-of-core preparation is too small.
    #[error(
        "{}: the lists of {faces} faces take about {:.1} GB, {:.1} GB are free for them: name a folder on a larger disk \
         with --out-of-core", path.display(), *needed as f64 * 1e-9, *free as f64 * 1e-9
    )]
    NoRoom {
        /// The model.
        path: PathBuf,
        /// Its faces.
        faces: usize,
        /// Bytes that its lists need.
        needed: u64,
        /// Bytes that are free.
        free: u64,
    },
}

impl PrepareError {
    /// Checks that the lists of a mesh fit into the free bytes of the disk, if they are mapped to one.
    ///
    /// # Errors
    /// [`PrepareError::NoRoom`].
    pub fn room(path: &Path, faces: usize, free: Option<u64>) -> Result<(), Self> {
        let needed = faces as u64 * LIST_BYTES_A_FACE;
        match free {
            Some(free) if free < needed => Err(Self::NoRoom { path: path.to_owned(), faces, needed, free }),
            _ => Ok(()),
        }
    }
}

/// Result of a preparation.
#[derive(Clone, Debug)]
pub struct Report {
    /// Faces of the quantised input.
    pub faces: usize,
    /// Vertices of the quantised input.
    pub vertices: usize,
    /// Length of base mesh, index pages and chunks.
    pub geometry_bytes: u64,
    /// Length of the pack, textures included.
    pub pack_bytes: u64,
    /// Time of simplification, chunking and coding: without import and textures.
    pub time: Duration,
    /// Levels and blocks that an earlier run had finished.
    pub resumed: Resumed,
    /// Warnings, one line each.
    pub warnings: Vec<String>,
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let seconds = self.time.as_secs_f64();
        let bits = 8.0 * self.geometry_bytes as f64 / self.vertices.max(1) as f64;
        write!(
            f,
            "{} faces, {} vertices, {} bytes in all, {} of geometry ({bits:.1} bits/vertex), \
             prepared in {seconds:.2} s ({:.0} faces/s)",
            self.faces,
            self.vertices,
            self.pack_bytes,
            self.geometry_bytes,
            self.faces as f64 / seconds.max(1e-9)
        )?;
        if self.resumed == Resumed::default() {
            return Ok(());
        }
        write!(f, "; resumed from {}", self.resumed)
    }
}

/// Prepares a model and writes its pack atomically.
///
/// # Errors
/// See [`PrepareError`].
pub fn prepare_to(asset: &Asset, options: &Options, pack: &Path) -> Result<Report, PrepareError> {
    let keyed = Keyed::new(asset, options, &Sources::default())?;
    prepare_with_key(keyed, options, pack)
}

/// An asset with its resolved settings, its model file, and the key of its pack.
struct Keyed {
    asset: Asset,
    source: Arc<Source>,
    key: cache::Key,
    /// What was imported for the key.
    imported: Option<Imported>,
}

/// Most faces of a mesh among others whose key depends on the mesh instead of the file, which takes an import each time.
const MAX_CONTENT_FACES: usize = 1 << 16;

impl Keyed {
    fn new(asset: &Asset, options: &Options, sources: &Sources) -> Result<Self, ImportError> {
        let asset = resolved(asset, options);
        let source = sources.get(&asset.file)?;
        let mut settings = PackSettings::of(&asset);
        let (key, imported) = match content(&asset, &source)? {
            Some((imported, materials)) => {
                settings.part = None;
                let settings = settings.encode();
                let key = cache::Key::of_content(&imported.mesh, &materials, &settings, pack_version());
                (key, Some(imported))
            }
            None => (cache::Key::new(&source, &settings.encode(), pack_version()), None),
        };
        Ok(Self { asset, source, key, imported })
    }
}

/// An asset with the settings that it is prepared with.
fn resolved(asset: &Asset, options: &Options) -> Asset {
    let preparation_settings = options.preparation_settings.or(asset.preparation_settings);
    Asset { preparation_settings, ..asset.clone() }
}

/// What is imported for an asset and its encoded materials, if a pack depends on nothing else of the file: for batches and
/// small meshes.
fn content(asset: &Asset, source: &Source) -> Result<Option<(Imported, Vec<u8>)>, ImportError> {
    let Some(size) = source.model.stated_size(&asset.part) else { return Ok(None) };
    if size.faces > MAX_CONTENT_FACES && !matches!(asset.part, Part::Batch(_)) {
        return Ok(None);
    }
    let imported = source.import(&asset.part, asset.preparation_settings.crease_angle())?;
    // Materials that cannot be encoded are an error when the asset is prepared.
    let materials =
        materials_key::encode(&asset.name, &imported.materials, &|image| source.image_hash(image));
    Ok(materials.map(|materials| (imported, materials)))
}

/// The key of an asset's pack.
///
/// # Errors
/// A model that cannot be read.
pub fn key_of(asset: &Asset, options: &Options) -> Result<cache::Key, ImportError> {
    Keyed::new(asset, options, &Sources::default()).map(|keyed| keyed.key)
}

/// The keys of the packs of several assets; a model file with several of them is read once, or not at all if memos say
/// what its keys are.
///
/// # Errors
/// A model that cannot be read.
pub fn keys_of(
    assets: &[Asset],
    options: &Options,
    sources: &Sources,
) -> Result<Vec<cache::Key>, ImportError> {
    let known = KnownKeys::new(sources);
    let key = |asset: &Asset| {
        if let Some((key, _)) = known.get(&resolved(asset, options)) {
            return Ok(key);
        }
        let keyed = Keyed::new(asset, options, sources)?;
        known.add(&keyed.asset, keyed.key, &keyed.source);
        Ok(keyed.key)
    };
    let keys = assets.iter().map(key).collect();
    known.write();
    keys
}

/// Sets the least effort where no pack is in the cache folder and no effort is set: for packs that stay on this machine.
pub fn prefer_least_effort(assets: &mut [Asset], folder: &Path, sources: &Sources) {
    let known = KnownKeys::new(sources);
    let key = |asset: &Asset| match known.get(asset) {
        Some((key, _)) => Some(key),
        // Without a memo, the key of a glTF file's meshes may take an import.
        None if is_gltf(&asset.file) || is_pack(&asset.file) => None,
        None => Keyed::new(asset, &Options::default(), sources).ok().map(|keyed| keyed.key),
    };
    for asset in assets.iter_mut().filter(|asset| asset.preparation_settings.effort.is_none()) {
        if !key(asset).is_some_and(|key| key.path(folder, &asset.name).is_file()) {
            asset.preparation_settings.effort = Some(Effort::Least);
        }
    }
}

/// An asset's pack from the cache.
#[derive(Debug)]
pub struct Cached {
    /// The pack.
    pub pack: PackFile,
    /// Result of the preparation; `None` if the pack was in the cache.
    pub report: Option<Report>,
    /// The model's file, and those that it names.
    pub files: Vec<PathBuf>,
}

/// Opens an asset's pack in a cache folder, which is created if missing. Prepares the asset if the pack is missing, has
/// another version or key, or is damaged.
///
/// # Errors
/// See [`PrepareError`].
pub fn prepare_cached(asset: &Asset, folder: &Path, options: &Options) -> Result<Cached, PrepareError> {
    prepare_keyed(Keyed::new(asset, options, &Sources::default())?, folder, options)
}

/// Assets in a group, for each thread: lines appear after a group.
const GROUP: usize = 16;

/// [`prepare_cached`] for several assets: a model file with several of them is read once, and small ones are prepared side
/// by side. `done` is called for each in order, with its number. The packs do not depend on the threads.
///
/// # Errors
/// Of the first asset with one. Packs that were prepared stay in the cache.
pub fn prepare_all(
    assets: &[Asset],
    folder: &Path,
    options: &Options,
    done: impl FnMut(usize, &Cached),
) -> Result<Vec<Cached>, PrepareError> {
    prepare_all_of(assets, folder, options, &Sources::in_folder(folder), done)
}

/// As [`prepare_all`], with the model files that the assets were found in. If their memos say what the keys of all packs
/// are, and the packs are in the cache, they are not read.
///
/// # Errors
/// As [`prepare_all`].
pub fn prepare_all_of(
    assets: &[Asset],
    folder: &Path,
    options: &Options,
    sources: &Sources,
    mut done: impl FnMut(usize, &Cached),
) -> Result<Vec<Cached>, PrepareError> {
    let threads = options.threads.map_or_else(Threads::all_cores, Threads::new);
    let known = KnownKeys::new(sources);
    let in_cache = |asset: &Asset| {
        let asset = resolved(asset, options);
        let (key, mut files) = known.get(&asset)?;
        let pack = cached_pack(&key.path(folder, &asset.name), &key)?;
        files.push(asset.file);
        Some(Cached { pack, report: None, files })
    };
    let mut ready = side_by_side(assets, &threads, &in_cache);
    let one = |asset: &Asset, options: &Options| {
        if is_pack(&asset.file) {
            return open_pack(&asset.file);
        }
        let keyed = Keyed::new(asset, options, sources)?;
        known.add(&keyed.asset, keyed.key, &keyed.source);
        prepare_keyed(keyed, folder, options)
    };
    let mut all = Vec::with_capacity(assets.len());
    let mut take = |cached: Cached| {
        done(all.len(), &cached);
        all.push(cached);
    };
    let on_one_thread = Options { threads: Some(NonZeroUsize::MIN), ..options.clone() };
    let mut sizes = Sizes::new(assets, sources);
    let mut at = 0;
    while let Some(asset) = assets.get(at) {
        if let Some(cached) = ready.get_mut(at).and_then(Option::take) {
            take(cached);
            at += 1;
            continue;
        }
        let missing = ready[at..].iter().take_while(|cached| cached.is_none()).count();
        let run = sizes.small_ones(&assets[at..], missing.min(GROUP * threads.count().get()));
        if run < 2 {
            take(one(asset, options)?);
            at += 1;
            continue;
        }
        for made in side_by_side(&assets[at..at + run], &threads, &|asset| one(asset, &on_one_thread)) {
            take(made?);
        }
        at += run;
    }
    known.write();
    Ok(all)
}

/// Whether a file is a pack, by its extension: it needs no preparation.
#[must_use]
pub fn is_pack(file: &Path) -> bool {
    file.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("lsp"))
}

/// Opens a pack that is named instead of a model.
fn open_pack(file: &Path) -> Result<Cached, PrepareError> {
    let pack = PackFile::open(file)?;
    pack.verify()?;
    Ok(Cached { pack, report: None, files: vec![file.to_owned()] })
}

/// What `make` makes of each element, on some threads.
fn side_by_side<T: Sync, R: Send>(
    elements: &[T],
    threads: &Threads,
    make: &(impl Fn(&T) -> R + Sync),
) -> Vec<R> {
    let slots: Vec<Mutex<Option<R>>> = elements.iter().map(|_| Mutex::default()).collect();
    threads.run(elements.len(), &|i| {
        *slots[i].lock().unwrap_or_else(PoisonError::into_inner) = Some(make(&elements[i]));
    });
    let made = slots.into_iter().map(|slot| slot.into_inner().unwrap_or_else(PoisonError::into_inner));
    // A pool that runs no task leaves it to us.
    made.zip(elements).map(|(made, element)| made.unwrap_or_else(|| make(element))).collect()
}

/// A pack in the cache, if it is there, whole, and made for this key.
fn cached_pack(path: &Path, key: &cache::Key) -> Option<PackFile> {
    let pack = PackFile::open(path).ok().filter(|pack| pack.made_from() == key.bytes())?;
    // Reading the pack is less than reading what it is made from.
    pack.verify().and_then(|()| pack.base_faces()).is_ok().then_some(pack)
}

fn prepare_keyed(keyed: Keyed, folder: &Path, options: &Options) -> Result<Cached, PrepareError> {
    let Keyed { asset, source, key, .. } = &keyed;
    let mut files = source.model.dependencies().to_vec();
    files.push(asset.file.clone());
    let path = key.path(folder, &asset.name);
    if let Some(pack) = cached_pack(&path, key) {
        return Ok(Cached { pack, report: None, files });
    }
    std::fs::create_dir_all(folder)
        .map_err(|source| PrepareError::Write { path: folder.to_owned(), source })?;
    let report = prepare_with_key(keyed, options, &path)?;
    Ok(Cached { pack: PackFile::open(&path)?, report: Some(report), files })
}

/// Folder of checkpoints; `None` (memory) if they are not wanted, if another process prepares the same pack, or if the
/// output is not a regular file.
fn checkpoint_folder_for(
    pack: &Path,
    key: &cache::Key,
    wanted: bool,
) -> std::io::Result<Option<CheckpointFolder>> {
    if !wanted || std::fs::metadata(pack).is_ok_and(|at| !at.is_file()) {
        return Ok(None);
    }
    if let Some(folder) = pack.parent() {
        remove_stale_levels(folder, SystemTime::now());
    }
    CheckpointFolder::beside(pack, key)
}

fn prepare_with_key(keyed: Keyed, options: &Options, pack: &Path) -> Result<Report, PrepareError> {
    let Keyed { asset, source, key, imported } = keyed;
    let Asset { name, file: model, part, preparation_settings } = &asset;
    let mesh_error = |source| PrepareError::Mesh { path: model.clone(), source };
    let imported = imported.map_or_else(|| source.import(part, preparation_settings.crease_angle()), Ok)?;
    let mut warnings = imported.warnings;
    let threads = options.threads.map_or_else(Threads::all_cores, Threads::new);
    let described = describe::describe(name, &imported.materials, preparation_settings, &threads)
        .map_err(|source| PrepareError::Describe { path: model.clone(), source })?;
    warnings.extend(described.warnings);

    let start = Instant::now();
    let mut mesh = quantise(&imported.mesh, &preparation_settings.quantise_settings()).map_err(mesh_error)?;
    let mut description = described.description;
    let regions = texture_regions::measure(&imported.mesh, &mut description, mesh.grid.origin);
    drop(imported.mesh);
    let describe_error = |source| PrepareError::Describe { path: model.clone(), source };
    let regions = regions.map(|regions| regions.encode()).transpose();
    let regions =
        regions.map_err(|error| describe_error(DescribeError::from(DescriptionError::from(error))))?;
    let whole: Vec<usize> = description.textures.iter().map(TextureInfo::whole_levels).collect();
    let description = description.encode().map_err(|error| describe_error(error.into()))?;
    PrepareError::room(model, mesh.faces.len(), MappingAllocator::free_bytes())?;
    free_memory::check_faces(model, mesh.faces.len())?;
    let checkpoints =
        checkpoint_folder_for(pack, &key, options.keep_levels || mesh.faces.len() >= CHECKPOINT_MIN_FACES);
    let checkpoints = checkpoints.map_err(|source| PrepareError::Write { path: pack.to_owned(), source })?;
    let reporter = Reporter::new(name, options.quiet, options.watch.clone());
    let mut hooks = Hooks::new(&threads, &reporter);
    if let Some(checkpoints) = &checkpoints {
        hooks = hooks.with_checkpoints(checkpoints);
    }
    let codec = preparation_settings.codec().of(&mesh);
    let settings = Settings { codec, ..asset.simplify_settings() };
    suit(&mut mesh, settings.codec);
    let prepared = prepare_with_hooks(&mesh, &settings, hooks);
    reporter.finish();
    let mut prepared = prepared.map_err(mesh_error)?;
    let time = start.elapsed();

    prepared.base.description = description;
    let base =
        encode_base(&prepared.base).map_err(|e| mesh_error(MeshError::Internal { why: e.to_string() }))?;
    let mut blobs: Vec<(BlobKind, &[u8])> = vec![(BlobKind::Base, &base)];
    blobs.extend(prepared.pages.iter().zip(0..).map(|(page, i)| (BlobKind::IndexPage(i), &page[..])));
    blobs.extend(prepared.chunks.iter().zip(0..).map(|(chunk, i)| (BlobKind::Chunk(i), &chunk[..])));
    let settings = preparation_settings.to_string();
    let geometry_bytes = blobs.iter().map(|(_, blob)| blob.len() as u64).sum();
    for ((levels, texture), whole) in described.textures.iter().zip(0..).zip(whole) {
        let images = levels.iter().zip(0..).flat_map(|(images, level)| {
            images.iter().zip(0..).map(move |(image, tile)| (image, level, tile))
        });
        blobs.extend(images.map(|(image, level, tile)| match level {
            level if usize::from(level) < whole => (BlobKind::Texture { texture, level }, &image[..]),
            level => (BlobKind::Tile { texture, level, tile }, &image[..]),
        }));
    }
    blobs.extend(regions.iter().map(|regions| (BlobKind::TextureRegions, &regions[..])));
    blobs.push((BlobKind::Settings, settings.as_bytes()));
    let write_error = |source| PrepareError::Write { path: pack.to_owned(), source };
    let bytes = lodestream_geometry::pack::write(key.bytes(), &blobs)
        .map_err(|error| write_error(std::io::Error::other(error)))?;
    write_atomically(pack, |out| out.write_all(&bytes)).map_err(write_error)?;
    let resumed = checkpoints.as_ref().map(CheckpointFolder::resumed).unwrap_or_default();
    checkpoints.into_iter().for_each(CheckpointFolder::remove);
    Ok(Report {
        faces: mesh.faces.len(),
        vertices: mesh.positions.len(),
        geometry_bytes,
        pack_bytes: bytes.len() as u64,
        time,
        resumed,
        warnings,
    })
}
