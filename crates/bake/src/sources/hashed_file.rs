//! A file that is hashed once, as a whole and in blocks, and then read in parts: each block that is read must still have
//! its hash, so all that is read is what the hash of the whole names.

use std::collections::VecDeque;
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};
use std::ops::Range;
use std::path::Path;
use std::sync::{Mutex, MutexGuard, PoisonError};

use blake3::Hash;
use bytes::{Bytes, BytesMut};
use lodestream_import::{Content, ImportError, MAX_FILE_BYTES};

/// Length of a block. Batches read meshes in the file's order, so blocks are read about once; the search for copies reads
/// similar meshes from all over the file, and so a block for each: of 128 KiB, hashing them was its largest cost.
const BLOCK_BYTES: u64 = 1 << 14;
/// Blocks that are kept: some threads read positions, normals, coordinates and indices at different places.
const KEPT_BLOCKS: usize = 512;

/// A file, of which some blocks are in memory.
#[derive(Debug)]
pub(super) struct HashedFile<F> {
    length: u64,
    hash: Hash,
    blocks: Vec<Hash>,
    state: Mutex<State<F>>,
}

#[derive(Debug)]
struct State<F> {
    file: F,
    /// Blocks that were read last, by number, the last one first.
    kept: VecDeque<(usize, Bytes)>,
}

impl HashedFile<File> {
    /// Opens and hashes a regular file.
    ///
    /// # Errors
    /// As [`lodestream_import::read_file`].
    pub(super) fn open(path: &Path) -> Result<Self, ImportError> {
        let read = |source| ImportError::Read { path: path.to_owned(), source };
        let file = File::open(path).map_err(read)?;
        let metadata = file.metadata().map_err(read)?;
        if !metadata.is_file() {
            return Err(ImportError::NotAFile { path: path.to_owned() });
        }
        if metadata.len() > MAX_FILE_BYTES {
            let (bytes, limit) = (metadata.len(), MAX_FILE_BYTES);
            return Err(ImportError::TooLarge { path: path.to_owned(), bytes, limit });
        }
        Self::new(file).map_err(read)
    }
}

impl<F: Read + Seek> HashedFile<F> {
    /// Hashes all of a file.
    fn new(mut file: F) -> io::Result<Self> {
        let (mut hasher, mut blocks, mut length) = (blake3::Hasher::new(), Vec::new(), 0);
        let mut block = Vec::with_capacity(BLOCK_BYTES as usize);
        loop {
            block.clear();
            (&mut file).take(BLOCK_BYTES).read_to_end(&mut block)?;
            length += block.len() as u64;
            if block.is_empty() || length > MAX_FILE_BYTES {
                break;
            }
            hasher.update(&block);
            blocks.push(blake3::hash(&block));
        }
        let state = Mutex::new(State { file, kept: VecDeque::new() });
        Ok(Self { length, hash: hasher.finalize(), blocks, state })
    }

    /// Hash of the whole file.
    pub(super) fn hash(&self) -> Hash {
        self.hash
    }

    fn state(&self) -> MutexGuard<'_, State<F>> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn block(&self, number: usize) -> io::Result<Bytes> {
        let mut state = self.state();
        if let Some(at) = state.kept.iter().position(|(other, _)| *other == number) {
            let found = state.kept.remove(at).unwrap_or_default();
            state.kept.push_front(found.clone());
            return Ok(found.1);
        }
        let start = number as u64 * BLOCK_BYTES;
        let mut block = vec![0; (self.length - start).min(BLOCK_BYTES) as usize];
        state.file.seek(SeekFrom::Start(start))?;
        let changed = || io::Error::other("it changed while it was read; prepare it again");
        state.file.read_exact(&mut block).map_err(|error| match error.kind() {
            io::ErrorKind::UnexpectedEof => changed(),
            _ => error,
        })?;
        if self.blocks.get(number) != Some(&blake3::hash(&block)) {
            return Err(changed());
        }
        let block = Bytes::from(block);
        state.kept.truncate(KEPT_BLOCKS - 1);
        state.kept.push_front((number, block.clone()));
        Ok(block)
    }
}

impl<F: Read + Seek + Send + std::fmt::Debug> Content for HashedFile<F> {
    fn length(&self) -> u64 {
        self.length
    }

    fn read(&self, range: Range<u64>) -> io::Result<Bytes> {
        if range.start > range.end || range.end > self.length {
            return Err(io::ErrorKind::UnexpectedEof.into());
        }
        if range.is_empty() {
            return Ok(Bytes::new());
        }
        let first = (range.start / BLOCK_BYTES) as usize;
        let last = ((range.end - 1) / BLOCK_BYTES) as usize;
        let of_block = |number: usize| {
            let block = self.block(number)?;
            let start = number as u64 * BLOCK_BYTES;
            let from = range.start.saturating_sub(start) as usize;
            let to = ((range.end - start) as usize).min(block.len());
            Ok::<Bytes, io::Error>(block.slice(from..to))
        };
        if first == last {
            return of_block(first);
        }
        let mut bytes = BytesMut::with_capacity((range.end - range.start) as usize);
        for number in first..=last {
            bytes.extend_from_slice(&of_block(number)?);
        }
        Ok(bytes.freeze())
    }
}

#[cfg(test)]
mod tests {
    use std::io::{Cursor, Write as _};

    use super::*;

    /// Counts the bytes that are read.
    #[derive(Debug)]
    struct Counting(Cursor<Vec<u8>>, u64);

    impl Read for Counting {
        fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
            let count = self.0.read(bytes)?;
            self.1 += count as u64;
            Ok(count)
        }
    }

    impl Seek for Counting {
        fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
            self.0.seek(to)
        }
    }

    fn bytes(count: usize) -> Vec<u8> {
        (0..count).map(|i| (i * i / 7) as u8).collect()
    }

    #[test]
    fn parts_are_those_of_the_whole_and_what_is_kept_does_not_grow_with_the_file() {
        let block = BLOCK_BYTES as usize;
        for blocks in [0, 1, 3 * KEPT_BLOCKS] {
            let all = bytes(blocks * block + 77);
            let length = all.len() as u64;
            let file = HashedFile::new(Counting(Cursor::new(all.clone()), 0)).unwrap();
            assert_eq!((file.hash(), file.length()), (blake3::hash(&all), length));
            let kept = || file.state().kept.iter().map(|(_, bytes)| bytes.len()).sum::<usize>();
            assert_eq!((kept(), file.state().file.1), (0, length));
            // In order, as meshes are: each block is read once.
            for start in (0..all.len()).step_by(50_001) {
                let end = (start + 50_001).min(all.len());
                let read = file.read(start as u64..end as u64).unwrap();
                assert!(read == all[start..end], "{start}");
                assert!(kept() <= KEPT_BLOCKS * block);
            }
            assert_eq!(file.state().file.1, 2 * length);
            assert!(file.read(0..length).unwrap() == all);
            assert!(file.read(length..length).unwrap().is_empty());
            assert!(file.read(0..length + 1).is_err());
        }
    }

    #[test]
    fn a_file_that_changes_is_an_error_where_it_changed() {
        let mut file = tempfile::NamedTempFile::new().unwrap();
        let all = bytes(4 * BLOCK_BYTES as usize);
        file.write_all(&all).unwrap();
        let hashed = HashedFile::open(file.path()).unwrap();
        file.as_file_mut().seek(SeekFrom::Start(2 * BLOCK_BYTES + 5)).unwrap();
        file.write_all(&[all[2 * BLOCK_BYTES as usize + 5] ^ 1]).unwrap();
        let read = |block: u64| hashed.read(block * BLOCK_BYTES..block * BLOCK_BYTES + 3);
        assert!(read(1).unwrap() == all[BLOCK_BYTES as usize..BLOCK_BYTES as usize + 3]);
        assert!(read(2).unwrap_err().to_string().contains("changed"));
        // Cut while it is read.
        file.as_file_mut().set_len(3 * BLOCK_BYTES + 1).unwrap();
        assert!(read(3).unwrap_err().to_string().contains("changed"));
        // Replaced: the one that was opened is still there.
        std::fs::remove_file(file.path()).unwrap();
        assert!(read(0).is_ok());
    }
}
