//! Open files of packs: so many at once at most, opened again when they are needed.
//!
//! A scene may have more assets than a process may have files, and most of them are read once, for their base mesh.

use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, LazyLock, Mutex, MutexGuard, PoisonError};

use super::lru::Lru;

/// Files that stay open, of all packs of the process: a share of the 1,024 that a process mostly may have, so that
/// a thousand connections find room beside them. A file that is opened again costs 5 µs, once per blob that is not
/// in memory.
const MAX_OPEN: u64 = 128;

/// See the module.
#[derive(Debug)]
pub struct Handles {
    next: AtomicU64,
    open: Mutex<Lru<u64, Arc<File>>>,
}

impl Handles {
    /// A pool of at most `limit` open files.
    pub fn new(limit: u64) -> Arc<Self> {
        Arc::new(Self { next: AtomicU64::new(0), open: Mutex::new(Lru::new(limit)) })
    }

    /// Those that all packs of the process share.
    pub(super) fn shared() -> Arc<Self> {
        static SHARED: LazyLock<Arc<Handles>> = LazyLock::new(|| Handles::new(MAX_OPEN));
        Arc::clone(&SHARED)
    }

    /// A thread that panicked while it held the lock left the table usable: entries are whole.
    fn table(&self) -> MutexGuard<'_, Lru<u64, Arc<File>>> {
        self.open.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Files that are open now, without those that are being read from.
    #[must_use]
    pub fn count(&self) -> usize {
        self.table().len()
    }
}

/// A file that may be read at any time, and is open now and then.
#[derive(Debug)]
pub(super) struct PooledFile {
    handles: Arc<Handles>,
    number: u64,
    path: PathBuf,
}

impl PooledFile {
    /// Opens a file, which is the proof that it can be.
    ///
    /// # Errors
    /// As [`File::open`].
    pub(super) fn open(handles: Arc<Handles>, path: &Path) -> io::Result<(Self, Arc<File>)> {
        let file = Arc::new(File::open(path)?);
        let number = handles.next.fetch_add(1, Ordering::Relaxed);
        handles.table().insert(number, Arc::clone(&file), 1);
        Ok((Self { handles, number, path: path.to_owned() }, file))
    }

    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    /// The file, if need be opened again; what then lies at its path must pass `same`. It stays open while it is held.
    ///
    /// # Errors
    /// Whatever opening says, as `unreadable` puts it, and `same`.
    pub(super) fn get<E>(
        &self,
        same: impl FnOnce(&File) -> Result<(), E>,
        unreadable: impl FnOnce(io::Error) -> E,
    ) -> Result<Arc<File>, E> {
        if let Some(file) = self.handles.table().get(&self.number) {
            return Ok(file);
        }
        let file = Arc::new(File::open(&self.path).map_err(unreadable)?);
        same(&file)?;
        self.handles.table().insert(self.number, Arc::clone(&file), 1);
        Ok(file)
    }
}

impl Drop for PooledFile {
    fn drop(&mut self) {
        self.handles.table().remove(&self.number);
    }
}
