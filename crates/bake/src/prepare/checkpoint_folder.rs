//! Finished levels of a preparation, kept in a folder beside the pack while it is made: they are not held in memory, and
//! a run that was killed goes on from them.
//!
//! A file for each piece: a hash over its name and what follows, then that. Nothing is synced: what a crash of the machine
//! leaves incomplete does not hash to what it says, and is done again.

use std::collections::BTreeSet;
use std::fmt;
use std::fs::{File, TryLockError};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, SystemTime};

use lodestream_compress::whole_file::{PREFIX, SUFFIX, temporary_entries};
use lodestream_geometry::checkpoint::{CheckpointError, CheckpointStore, Piece};

use super::cache::Key;

/// Name of the file in a temporary folder that is locked by the process that uses the folder.
pub const LOCK: &str = "lock";
/// Age after which a folder is removed instead of resumed: preparations take hours at most.
const STALE_AFTER: Duration = Duration::from_secs(7 * 24 * 60 * 60);

/// Levels and blocks that an earlier run had finished.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Resumed {
    /// Levels of the whole mesh.
    pub levels: usize,
    /// Spatial blocks, of a mesh that is simplified block after block.
    pub blocks: usize,
}

impl fmt::Display for Resumed {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let parts = [(self.blocks, "block"), (self.levels, "level")].into_iter().filter(|part| part.0 > 0);
        let named = parts.map(|(count, what)| match count {
            1 => format!("a finished {what}"),
            _ => format!("{count} finished {what}s"),
        });
        f.write_str(&named.collect::<Vec<String>>().join(" and "))
    }
}

/// A folder of finished levels.
pub(super) struct CheckpointFolder {
    folder: PathBuf,
    /// Held until the folder is dropped.
    _lock: File,
    /// Final pieces of the levels and blocks that were read from an earlier run.
    resumed: Mutex<BTreeSet<Piece>>,
}

impl CheckpointFolder {
    /// The folder for a pack of this key, with the checkpoints of an earlier run; `None` if another process uses it.
    pub(super) fn beside(pack: &Path, key: &Key) -> io::Result<Option<Self>> {
        let folder = match pack.parent() {
            Some(folder) if !folder.as_os_str().is_empty() => folder,
            _ => Path::new("."),
        };
        let folder = folder.join(format!("{PREFIX}{}{SUFFIX}", &key.hex()[..32]));
        std::fs::create_dir_all(&folder)?;
        let lock = File::create(folder.join(LOCK))?;
        match lock.try_lock() {
            Ok(()) => Ok(Some(Self { folder, _lock: lock, resumed: Mutex::default() })),
            Err(TryLockError::WouldBlock) => Ok(None),
            Err(TryLockError::Error(error)) => Err(error),
        }
    }

    /// Number of resumed levels and blocks.
    pub(super) fn resumed(&self) -> Resumed {
        let closing = self.closing();
        let blocks = closing.iter().filter(|piece| piece.level == Piece::OF_BLOCKS).count();
        Resumed { levels: closing.len() - blocks, blocks }
    }

    /// Removes the folder, once the pack is complete.
    pub(super) fn remove(self) {
        // A folder that cannot be removed now is removed later as stale.
        let _ = std::fs::remove_dir_all(&self.folder);
    }

    fn closing(&self) -> MutexGuard<'_, BTreeSet<Piece>> {
        self.resumed.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn path(&self, piece: Piece) -> PathBuf {
        self.folder.join(piece.to_string())
    }
}

impl CheckpointStore for CheckpointFolder {
    fn is_persistent(&self) -> bool {
        true
    }

    fn put(&self, piece: Piece, bytes: Vec<u8>) -> Result<(), CheckpointError> {
        // A piece that is written again was not resumed.
        self.closing().remove(&piece);
        let path = self.path(piece);
        let part = path.with_extension("part");
        let write = || {
            let mut file = File::create(&part)?;
            io::Write::write_all(&mut file, hash(piece, &bytes).as_bytes())?;
            io::Write::write_all(&mut file, &bytes)?;
            std::fs::rename(&part, &path)
        };
        write()
            .map_err(|error| CheckpointError::new(format!("{} cannot be written: {error}", path.display())))
    }

    fn get(&self, piece: Piece) -> Result<Option<Vec<u8>>, CheckpointError> {
        let path = self.path(piece);
        let mut bytes = match std::fs::read(&path) {
            Ok(bytes) => bytes,
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
            Err(error) => {
                return Err(CheckpointError::new(format!("{} cannot be read: {error}", path.display())));
            }
        };
        let Some((stated_hash, rest)) = bytes.split_first_chunk::<{ blake3::OUT_LEN }>() else {
            return Ok(None);
        };
        if hash(piece, rest) != *stated_hash {
            return Ok(None);
        }
        if piece.is_end() {
            self.closing().insert(piece);
        }
        bytes.drain(..blake3::OUT_LEN);
        Ok(Some(bytes))
    }
}

fn hash(piece: Piece, bytes: &[u8]) -> blake3::Hash {
    let mut hasher = blake3::Hasher::new_derive_key("lodestream finished level");
    hasher.update(&piece.level.to_le_bytes()).update(&piece.block.to_le_bytes()).update(bytes);
    hasher.finalize()
}

/// Removes checkpoint folders that were not written for a week and are not in use. Skips those that cannot be read or
/// removed.
pub fn remove_stale_levels(folder: &Path, now: SystemTime) {
    for (path, metadata) in temporary_entries(folder, STALE_AFTER, now) {
        if metadata.is_dir()
            && let Ok(lock) = File::open(path.join(LOCK))
            && lock.try_lock().is_ok()
        {
            let _ = std::fs::remove_dir_all(path);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::prepare::cache;

    fn key(dir: &Path) -> Key {
        let model = dir.join("a.obj");
        std::fs::write(&model, "f 1 2 3\n").unwrap();
        cache::Key::new(&crate::sources::Source::read(&model).unwrap(), b"", 1)
    }

    #[test]
    fn pieces_are_read_back_and_damaged_ones_are_missing() {
        let dir = tempfile::TempDir::new().unwrap();
        let (pack, key) = (dir.path().join("a.lsp"), key(dir.path()));
        let kept = CheckpointFolder::beside(&pack, &key).unwrap().unwrap();
        let (one, end) = (Piece { level: 0, block: 3 }, Piece::end_of(0));
        assert_eq!(kept.get(one), Ok(None));
        kept.put(one, vec![7; 1000]).unwrap();
        kept.put(end, Vec::new()).unwrap();
        assert!(CheckpointFolder::beside(&pack, &key).unwrap().is_none(), "two work in one folder");
        drop(kept);
        let kept = CheckpointFolder::beside(&pack, &key).unwrap().unwrap();
        assert_eq!((kept.get(one), kept.get(end)), (Ok(Some(vec![7; 1000])), Ok(Some(Vec::new()))));
        assert_eq!(kept.resumed(), Resumed { levels: 1, blocks: 0 });
        let block = Piece::end_of_block(0);
        kept.put(block, Vec::new()).unwrap();
        assert_eq!(kept.resumed().to_string(), "a finished level", "it was not there before");
        assert_eq!(kept.get(block), Ok(Some(Vec::new())));
        assert_eq!(kept.resumed().to_string(), "a finished block and a finished level");
        assert_ne!(kept.path(block), kept.path(end));
        let file = kept.path(one);
        let whole = std::fs::read(&file).unwrap();
        for bytes in [&whole[..999], &whole[..20], &[], &[&whole[..], &[7]].concat()] {
            std::fs::write(&file, bytes).unwrap();
            assert_eq!(kept.get(one), Ok(None), "{} bytes", bytes.len());
        }
        std::fs::write(kept.path(end), &whole).unwrap();
        assert_eq!(kept.get(end), Ok(None), "another piece");
        let folder = kept.folder.clone();
        kept.remove();
        assert!(!folder.exists());
    }

    #[test]
    fn only_old_and_unused_folders_are_removed() {
        let dir = tempfile::TempDir::new().unwrap();
        let (pack, key) = (dir.path().join("a.lsp"), key(dir.path()));
        let kept = CheckpointFolder::beside(&pack, &key).unwrap().unwrap();
        let folder = kept.folder.clone();
        std::fs::create_dir(dir.path().join("mine.part")).unwrap();
        let now = SystemTime::now();
        let later = now + STALE_AFTER + Duration::from_secs(60);
        remove_stale_levels(dir.path(), later);
        assert!(folder.exists(), "somebody works in it");
        drop(kept);
        remove_stale_levels(dir.path(), now);
        assert!(folder.exists());
        remove_stale_levels(dir.path(), later);
        assert!(!folder.exists() && dir.path().join("mine.part").exists());
    }
}
