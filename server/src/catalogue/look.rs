//! Scenes as they are now. One is opened again when its files have changed, or when that is asked for; one that cannot be
//! opened is the one that was there before.

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

use super::place::{Found, Place};
use crate::daemon::scene_watch::{self, SceneProvider};
use crate::daemon::scenes::Scenes;
use crate::prepare::{Options, prepare_cached};
use crate::scene;
use crate::store::{BlobCache, SceneStore};
use crate::tell::tell;

/// What a scene was when it was looked at.
type Stamp = blake3::Hash;

struct Known {
    stamp: Option<Stamp>,
    /// Files whose change changes the scene.
    files: Vec<PathBuf>,
    source: Arc<SceneStore>,
}

/// See the module.
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
    /// The scenes of these words: models side by side, scene files, folders, URLs of stores. Packs that have to be
    /// prepared are kept in `folder`.
    ///
    /// # Errors
    /// Words that do not go together, or name nothing.
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

    /// Opens all scenes for the first time. Of those in folders some may fail, which is told.
    ///
    /// # Errors
    /// A scene that was named by itself and cannot be opened, or none at all.
    pub async fn open(&self) -> anyhow::Result<Scenes> {
        let sources = self.all(true, true).await?.unwrap_or_default();
        if sources.is_empty() {
            bail!(
                "there is no scene that can be served: name scene files, models, a folder or a store of such"
            );
        }
        Ok(Scenes::new(sources)?)
    }

    /// All scenes, if any changed.
    async fn all(&self, asked: bool, first: bool) -> anyhow::Result<scene_watch::Found> {
        let mut known = self.known.lock().await;
        let mut now = BTreeMap::new();
        let mut changed = asked;
        for place in &self.places {
            for found in place.list().await? {
                let key = found.key();
                let before = known.remove(&key);
                let stamp = stamp(&found, before.as_ref()).await;
                if let Some(mut before) = before {
                    if !asked && before.stamp.is_some() && before.stamp == stamp {
                        now.insert(key, before);
                        continue;
                    }
                    match self.open_one(&found, true).await {
                        Ok(new) => {
                            now.insert(key, new);
                            changed = true;
                        }
                        Err(why) => {
                            tracing::error!("{key} stays as it was: {why:#}");
                            // It is looked at again when it changes.
                            before.stamp = stamp;
                            now.insert(key, before);
                        }
                    }
                    continue;
                }
                match self.open_one(&found, !first).await {
                    Ok(new) => {
                        now.insert(key, new);
                        changed = true;
                    }
                    Err(why) if first && place.is_one() => return Err(why),
                    Err(why) if first => tell(format_args!("warning: not served: {why:#}")),
                    Err(why) => tracing::error!("{key} is not served: {why:#}"),
                }
            }
        }
        // What is left was not found any more.
        changed |= !known.is_empty();
        *known = now;
        let sources = known.values().map(|known| Arc::clone(&known.source) as Arc<dyn SceneSource>);
        Ok(changed.then(|| sources.collect()))
    }

    async fn open_one(&self, found: &Found, quiet: bool) -> anyhow::Result<Known> {
        match found {
            Found::Published(objects, listed) => {
                let source = SceneStore::open(objects, &listed.name, &self.blobs).await?;
                let stamp = Some(blake3::hash(listed.version.as_bytes()));
                Ok(Known { stamp, files: Vec::new(), source: Arc::new(source) })
            }
            Found::Files(files) => {
                let (words, folder, blobs) = (files.clone(), self.folder.clone(), self.blobs.clone());
                let options = Options { quiet: quiet || self.options.quiet, ..self.options };
                let opened = spawn_blocking(move || open_files(&words, &folder, &options, &blobs));
                opened.await.context("preparing was cut short")?
            }
        }
    }
}

impl SceneProvider for Catalogue {
    fn look_every(&self) -> Option<Duration> {
        self.look_every
    }

    fn look(&self, asked: bool) -> BoxFuture<'_, anyhow::Result<scene_watch::Found>> {
        self.all(asked, false).boxed()
    }
}

/// Prepares what is not in the folder of packs, and opens the scene.
fn open_files(
    words: &[PathBuf],
    folder: &std::path::Path,
    options: &Options,
    blobs: &BlobCache,
) -> anyhow::Result<Known> {
    let began = SystemTime::now();
    let scene = scene::of_files(words)?;
    let mut files = scene.files.clone();
    let mut packs = Vec::with_capacity(scene.assets.len());
    for asset in &scene.assets {
        let cached = prepare_cached(asset, folder, options)?;
        if let Some(report) = &cached.report {
            for warning in &report.warnings {
                tell(format_args!("warning: {warning}"));
            }
            tell(format_args!("{}: {report}", asset.name));
        }
        files.extend(cached.files);
        packs.push(cached.pack);
    }
    let source = Arc::new(SceneStore::sharing(&scene, packs, blobs)?);
    // What changed while it was read is looked at again. (A time that is still to come is that of another clock.)
    let meanwhile = began..=SystemTime::now();
    let stamp = of_files(&files).filter(|(_, last)| last.is_none_or(|last| !meanwhile.contains(&last)));
    Ok(Known { stamp: stamp.map(|(stamp, _)| stamp), files, source })
}

/// What a scene is like now, as far as that shows without reading it.
async fn stamp(found: &Found, before: Option<&Known>) -> Option<Stamp> {
    match found {
        Found::Published(_, listed) => Some(blake3::hash(listed.version.as_bytes())),
        Found::Files(_) => {
            let files = before?.files.clone();
            spawn_blocking(move || of_files(&files)).await.ok()?.map(|(stamp, _)| stamp)
        }
    }
}

/// Names, lengths and times of files, and the last of these times. Files that are not there count as such.
fn of_files(files: &[PathBuf]) -> Option<(Stamp, Option<SystemTime>)> {
    let mut hasher = blake3::Hasher::new();
    let mut last = None;
    for file in files {
        let metadata = std::fs::metadata(file).ok();
        let changed = metadata.as_ref().and_then(|metadata| metadata.modified().ok());
        let since = changed.and_then(|at| at.duration_since(SystemTime::UNIX_EPOCH).ok());
        hasher.update(format!("{file:?} {:?} {since:?}\n", metadata.map(|m| m.len())).as_bytes());
        last = last.max(changed);
    }
    Some((hasher.finalize(), last))
}
