//! The temporary folder of published scenes. It lies in the cache folder, so that its packs are further names of the cached
//! ones, and is removed with the program's end.

use std::collections::BTreeSet;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, SystemTime};

use anyhow::{Context as _, bail};
use lodestream_bake::prepare::{LEVELS_LOCK, remove_stale_levels};
use lodestream_bake::whole_scene::WholeScene;
use lodestream_client::net::Address;
use lodestream_compress::whole_file::{PREFIX, SUFFIX, abandon_unfinished, remove_stale};
use tempfile::TempDir;

use super::target::published;

/// Attempts to remove the folder, while a thread may still write to it, and the pause between them.
const ATTEMPTS: u32 = 20;
const PAUSE: Duration = Duration::from_millis(5);

/// The program's folders that are not closed yet.
static FOLDERS: Mutex<BTreeSet<PathBuf>> = Mutex::new(BTreeSet::new());

fn folders() -> MutexGuard<'static, BTreeSet<PathBuf>> {
    FOLDERS.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Removes the program's folders, and what other threads are writing to the cache: for the program's end, which does not
/// wait for them. Later writes of output files fail.
pub(crate) fn remove_at_once() {
    abandon_unfinished();
    let all = std::mem::take(&mut *folders());
    all.iter().for_each(|folder| remove(folder));
}

fn remove(folder: &Path) {
    for _ in 0..ATTEMPTS {
        if std::fs::remove_dir_all(folder).is_ok() || !folder.exists() {
            return;
        }
        std::thread::sleep(PAUSE);
    }
}

/// The folder.
#[derive(Debug)]
pub(super) struct SceneFolder {
    path: PathBuf,
    state: Mutex<State>,
}

#[derive(Debug)]
struct State {
    /// `None` once the folder is closed.
    folder: Option<TempDir>,
    /// Tells other programs that clean the cache folder up that this one is in use.
    _lock: File,
    scenes: usize,
}

impl SceneFolder {
    /// Creates the folder in the cache folder, which is created if it is missing and freed of what killed programs left.
    pub(super) fn create(cache: &Path) -> anyhow::Result<Self> {
        let about = || {
            format!("the cache folder {} cannot be written to; name another with --cache", cache.display())
        };
        std::fs::create_dir_all(cache).with_context(about)?;
        remove_stale(cache, SystemTime::now());
        remove_stale_levels(cache, SystemTime::now());
        let mut builder = tempfile::Builder::new();
        let prefix = format!("{PREFIX}view-");
        let folder = builder.prefix(&prefix).suffix(SUFFIX).tempdir_in(cache).with_context(about)?;
        let lock = File::create(folder.path().join(LEVELS_LOCK)).with_context(about)?;
        // Without it, another program removes the folder if it is a week old.
        let _ = lock.try_lock();
        let path = folder.path().to_owned();
        folders().insert(path.clone());
        Ok(Self { path, state: Mutex::new(State { folder: Some(folder), _lock: lock, scenes: 0 }) })
    }

    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    /// Whether nothing more is wanted.
    pub(super) fn is_closed(&self) -> bool {
        self.state.lock().unwrap_or_else(PoisonError::into_inner).folder.is_none()
    }

    /// Publishes a scene, and returns its address.
    pub(super) fn publish(&self, scene: WholeScene) -> anyhow::Result<Address> {
        // The folder is not removed meanwhile.
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        if state.folder.is_none() {
            bail!("something else is shown, or the program is ending");
        }
        state.scenes += 1;
        let folder = self.path.join(state.scenes.to_string());
        std::fs::create_dir(&folder).with_context(|| folder.display().to_string())?;
        published(&scene.publish_in(&folder)?)
    }

    /// Removes the folder. Later calls of [`Self::publish`] fail.
    pub(super) fn close(&self) {
        let folder = self.state.lock().unwrap_or_else(PoisonError::into_inner).folder.take();
        if let Some(folder) = folder {
            folders().remove(&self.path);
            remove(&folder.keep());
        }
    }
}
