//! A pool of open pack files: at most so many at a time, each reopened when it is needed again.
//!
//! A scene may have more assets than a process may have open files, and most packs are read once, for their base mesh.

use std::collections::VecDeque;
use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, LazyLock, Mutex, MutexGuard, PoisonError};

/// Open files of all packs of the process. A fraction of the usual limit of 1,024 files, which leaves enough for a
/// thousand connections. Reopening a file costs 5 µs, once per blob that is not in memory.
const MAX_OPEN: usize = 128;

/// A pool of open files. The least recently used one is closed first.
#[derive(Debug)]
pub struct FilePool {
    limit: usize,
    next: AtomicU64,
    /// Numbers of files and the files, the most recently used last. So short that searching it costs less than reading.
    open: Mutex<VecDeque<(u64, Arc<File>)>>,
}

impl FilePool {
    /// A pool of at most `limit` open files.
    pub fn new(limit: usize) -> Arc<Self> {
        Arc::new(Self { limit, next: AtomicU64::new(0), open: Mutex::default() })
    }

    /// The pool that all packs of the process share.
    pub(super) fn shared() -> Arc<Self> {
        static SHARED: LazyLock<Arc<FilePool>> = LazyLock::new(|| FilePool::new(MAX_OPEN));
        Arc::clone(&SHARED)
    }

    /// Number of files that are open now, without those that only a running read holds.
    #[must_use]
    pub fn count(&self) -> usize {
        self.lock().len()
    }

    fn get(&self, number: u64) -> Option<Arc<File>> {
        let mut open = self.lock();
        let at = open.iter().position(|(other, _)| *other == number)?;
        let (_, file) = open.remove(at)?;
        open.push_back((number, Arc::clone(&file)));
        Some(file)
    }

    fn insert(&self, number: u64, file: Arc<File>) {
        let mut open = self.lock();
        open.retain(|(other, _)| *other != number);
        open.push_back((number, file));
        while open.len() > self.limit {
            open.pop_front();
        }
    }

    fn remove(&self, number: u64) {
        self.lock().retain(|(other, _)| *other != number);
    }

    /// A thread that panicked with the lock left a usable list: every change of it is one call.
    fn lock(&self) -> MutexGuard<'_, VecDeque<(u64, Arc<File>)>> {
        self.open.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// A file that may be read at any time; the pool decides whether it is open in between.
#[derive(Debug)]
pub(super) struct PooledFile {
    pool: Arc<FilePool>,
    number: u64,
    path: PathBuf,
}

impl PooledFile {
    /// Opens a file and adds it to the pool.
    ///
    /// # Errors
    /// As [`File::open`].
    pub(super) fn open(pool: Arc<FilePool>, path: &Path) -> io::Result<(Self, Arc<File>)> {
        let file = Arc::new(File::open(path)?);
        let number = pool.next.fetch_add(1, Ordering::Relaxed);
        pool.insert(number, Arc::clone(&file));
        Ok((Self { pool, number, path: path.to_owned() }, file))
    }

    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    /// The open file. If it was closed, opens the file at its path again, which must pass `check_same`. It stays open
    /// while the result is held.
    ///
    /// # Errors
    /// The error of opening, converted by `unreadable`, and that of `check_same`.
    pub(super) fn get<E>(
        &self,
        check_same: impl FnOnce(&File) -> Result<(), E>,
        unreadable: impl FnOnce(io::Error) -> E,
    ) -> Result<Arc<File>, E> {
        if let Some(file) = self.pool.get(self.number) {
            return Ok(file);
        }
        let file = Arc::new(File::open(&self.path).map_err(unreadable)?);
        check_same(&file)?;
        self.pool.insert(self.number, Arc::clone(&file));
        Ok(file)
    }
}

impl Drop for PooledFile {
    fn drop(&mut self) {
        self.pool.remove(self.number);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_least_recently_used_file_is_closed_first() {
        let file = tempfile::NamedTempFile::new().unwrap();
        let pool = FilePool::new(3);
        let files: Vec<PooledFile> =
            (0..3).map(|_| PooledFile::open(Arc::clone(&pool), file.path()).unwrap().0).collect();
        assert!(pool.get(0).is_some());
        let (last, _) = PooledFile::open(Arc::clone(&pool), file.path()).unwrap();
        assert!(pool.get(1).is_none());
        assert!([0, 2, 3].iter().all(|&number| pool.get(number).is_some()));
        assert_eq!(pool.count(), 3);
        drop(last);
        assert_eq!(pool.count(), 2);
        drop(files);
        assert_eq!(pool.count(), 0);
    }
}
