//! The catalogue of open scenes. A scene is reopened when its files have changed or on request. If that fails, its
//! previous version stays.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, SystemTime};

use anyhow::{Context as _, bail};
use futures_util::FutureExt as _;
use futures_util::future::BoxFuture;
use lodestream_protocol::source::SceneSource;
use tokio::sync::Mutex;
use tokio::task::spawn_blocking;

use super::place::{Place, SceneLocation};
use lodestream_bake::prepare::Options;
use lodestream_bake::scene;
use lodestream_bake::sources::Sources;
use lodestream_bake::stderr::write_line;
use lodestream_bake::whole_scene::WholeScene;
use lodestream_daemon::{SceneProvider, SceneUpdate, Scenes};
use lodestream_store::{BlobCache, SceneStore};

/// Hash of names, lengths and times of a scene's files, or of its object's version.
type Stamp = blake3::Hash;

/// State of a scene at the last check.
#[derive(Clone, Default)]
struct Known {
    /// `None` if the next check must reopen it.
    stamp: Option<Stamp>,
    /// Files that the scene was read from.
    files: Vec<PathBuf>,
    /// `None` if it was never opened.
    source: Option<Arc<SceneStore>>,
}

/// The scenes of a command line's sources.
pub struct Catalogue {
    places: Vec<Place>,
    /// Folder of prepared packs.
    folder: PathBuf,
    options: Options,
    blobs: BlobCache,
    look_every: Option<Duration>,
    known: Mutex<BTreeMap<String, Known>>,
}

impl std::fmt::Debug for Catalogue {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Catalogue").field("places", &self.places).finish_non_exhaustive()
    }
}

impl Catalogue {
    /// A catalogue of the scenes that these arguments name: models combined to one scene, scene files, folders, URLs of
    /// stores. Packs that must be prepared are kept in `folder`.
    ///
    /// # Errors
    /// The arguments cannot be combined, or one names nothing.
    pub fn new(
        words: &[PathBuf],
        folder: PathBuf,
        options: Options,
        cache_bytes: u64,
        look_every: Option<Duration>,
    ) -> anyhow::Result<Self> {
        Ok(Self {
            places: Place::of_words(words)?,
            folder,
            options,
            blobs: BlobCache::new(cache_bytes),
            look_every,
            known: Mutex::default(),
        })
    }

    /// Opens all scenes for the first time. A scene of a folder that cannot be opened is skipped with a warning.
    ///
    /// # Errors
    /// A scene that the command line names cannot be opened, or there is no scene at all.
    pub async fn open(&self) -> anyhow::Result<Scenes> {
        let sources = self.all(true, true).await?.unwrap_or_default();
        if sources.is_empty() {
            bail!(
                "there is no scene that can be served: name scene files, models, a folder or a store of such"
            );
        }
        Ok(Scenes::new(sources)?)
    }

    /// All scenes, if any changed. If the sources cannot be listed, nothing changes.
    async fn all(&self, asked: bool, first: bool) -> anyhow::Result<Option<Vec<Arc<dyn SceneSource>>>> {
        let mut listed = Vec::new();
        for place in &self.places {
            listed.extend(place.list().await?.into_iter().map(|found| (place.is_one(), found)));
        }
        let mut known = self.known.lock().await;
        let mut now = BTreeMap::new();
        let mut changed = asked;
        for (is_one, found) in listed {
            let key = found.key();
            let before = known.get(&key);
            let stamp = stamp(&found, before).await;
            if let Some(same) = before.filter(|known| !asked && known.stamp.is_some() && known.stamp == stamp)
            {
                now.insert(key, same.clone());
                continue;
            }
            let (mut new, opened) = self.open_one(&found, !first).await;
            match opened {
                Ok(()) => changed = true,
                Err(why) if first && is_one => return Err(why),
                Err(why) if first => write_line(format_args!("warning: not served: {why:#}")),
                Err(why) => {
                    new.source = before.and_then(|before| before.source.clone());
                    let becomes = if new.source.is_some() { "stays as it was" } else { "is not served" };
                    tracing::error!("{key} {becomes}: {why:#}");
                }
            }
            now.insert(key, new);
        }
        changed |= known.keys().any(|key| !now.contains_key(key));
        *known = now;
        let sources = known.values().filter_map(|known| known.source.clone());
        Ok(changed.then(|| sources.map(|source| source as Arc<dyn SceneSource>).collect()))
    }

    /// Opens a scene. On failure the returned state is valid too: the scene is opened again when its files change.
    async fn open_one(&self, found: &SceneLocation, quiet: bool) -> (Known, anyhow::Result<()>) {
        match found {
            SceneLocation::Published(objects, listed) => {
                let opened = SceneStore::open(objects, &listed.name, &self.blobs).await;
                // No stamp on failure, so the next check tries again: the store may have failed for a moment only.
                let stamp = opened.is_ok().then(|| blake3::hash(listed.version.as_bytes()));
                let (source, opened) = parted(opened.map_err(Into::into));
                (Known { stamp, files: Vec::new(), source }, opened)
            }
            SceneLocation::Files(words) => {
                let (words, folder, blobs) = (words.clone(), self.folder.clone(), self.blobs.clone());
                let options = Options { quiet: quiet || self.options.quiet, ..self.options.clone() };
                let opened = spawn_blocking(move || open_files(&words, &folder, &options, &blobs)).await;
                opened.unwrap_or_else(|why| (Known::default(), Err(why).context("preparing was cut short")))
            }
        }
    }
}

fn parted(opened: anyhow::Result<SceneStore>) -> (Option<Arc<SceneStore>>, anyhow::Result<()>) {
    match opened {
        Ok(source) => (Some(Arc::new(source)), Ok(())),
        Err(why) => (None, Err(why)),
    }
}

impl SceneProvider for Catalogue {
    fn poll_interval(&self) -> Option<Duration> {
        self.look_every
    }

    fn load(&self, asked: bool) -> BoxFuture<'_, anyhow::Result<SceneUpdate>> {
        self.all(asked, false).boxed()
    }
}

/// Prepares the packs that are missing in the folder of packs, and opens the scene.
fn open_files(
    words: &[PathBuf],
    folder: &std::path::Path,
    options: &Options,
    blobs: &BlobCache,
) -> (Known, anyhow::Result<()>) {
    let began = SystemTime::now();
    let mut files = words.to_vec();
    let (source, opened) = parted(read_files(words, folder, options, blobs, &mut files));
    // Without a stamp the next check reads files again that changed during this read. A time in the future comes from
    // another machine's clock and is accepted.
    let meanwhile = began..=SystemTime::now();
    let stamp = of_files(&files).filter(|(_, last)| last.is_none_or(|last| !meanwhile.contains(&last)));
    (Known { stamp: stamp.map(|(stamp, _)| stamp), files, source }, opened)
}

/// Opens the scene and adds the files that it is read from to `files`.
fn read_files(
    words: &[PathBuf],
    folder: &std::path::Path,
    options: &Options,
    blobs: &BlobCache,
    files: &mut Vec<PathBuf>,
) -> anyhow::Result<SceneStore> {
    let sources = Sources::in_folder(folder);
    let scene = scene::of_files_in(words, &options.preparation_settings, &sources)?;
    files.extend(scene.files.iter().chain(scene.assets.iter().map(|asset| &asset.file)).cloned());
    let whole = WholeScene::prepare(scene, folder, options, &sources)?;
    // Files that were kept for further packs.
    drop(sources);
    files.extend_from_slice(&whole.files);
    files.sort_unstable();
    files.dedup();
    Ok(whole.open(blobs)?)
}

/// The stamp of a scene, computed without reading its contents.
async fn stamp(found: &SceneLocation, before: Option<&Known>) -> Option<Stamp> {
    match found {
        SceneLocation::Published(_, listed) => Some(blake3::hash(listed.version.as_bytes())),
        SceneLocation::Files(_) => {
            let files = before?.files.clone();
            spawn_blocking(move || of_files(&files)).await.ok()?.map(|(stamp, _)| stamp)
        }
    }
}

/// A hash of the names, lengths and modification times of files, and the latest of these times. A missing file counts
/// as having neither.
fn of_files(files: &[PathBuf]) -> Option<(Stamp, Option<SystemTime>)> {
    let mut hasher = blake3::Hasher::new();
    let mut last = None;
    for file in files {
        let metadata = std::fs::metadata(file).ok();
        let changed = metadata.as_ref().and_then(|metadata| metadata.modified().ok());
        let since_epoch = changed.and_then(|at| at.duration_since(SystemTime::UNIX_EPOCH).ok());
        let path = file.as_os_str().as_encoded_bytes();
        hasher.update(&(path.len() as u64).to_le_bytes()).update(path);
        for number in [metadata.map(|file| u128::from(file.len())), since_epoch.map(|time| time.as_nanos())] {
            hasher.update(&[u8::from(number.is_some())]).update(&number.unwrap_or(0).to_le_bytes());
        }
        last = last.max(changed);
    }
    Some((hasher.finalize(), last))
}
