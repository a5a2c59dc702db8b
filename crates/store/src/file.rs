//! One pack: its table in memory, its blobs on disk.

use std::fs::File;
use std::io;
use std::path::Path;
use std::sync::{Arc, OnceLock};

use bytes::Bytes;
use lodestream_compress::decode_base;
use lodestream_geometry::DecodeError;
use lodestream_geometry::base::Base;
use lodestream_geometry::index::{CHUNKS_PER_PAGE, ChunkInfo, decode_page, page_count};
use lodestream_geometry::pack::{BlobKind, Entry, HEAD_BYTES, Head};
use lodestream_geometry::screen::visible_error;
use lodestream_scene::BlobPart;
use lodestream_scene::description::{AssetEntry, Fingerprint};

use super::error::StoreError;
use super::file_pool::{FilePool, PooledFile};
use super::table::{Table, blob_name, kind};

/// A pack in a file. Reads are positional, so threads share it without a lock. Its file may be closed between reads.
#[derive(Debug)]
pub struct PackFile {
    file: PooledFile,
    table: Table,
    /// Decoded when it is first needed.
    summary: OnceLock<Summary>,
}

/// What base mesh and index pages say of a pack.
#[derive(Debug)]
struct Summary {
    /// The entry, without a name.
    entry: AssetEntry,
    base_faces: u32,
}

impl PackFile {
    /// Opens a pack and checks its head and table.
    ///
    /// # Errors
    /// A file that is missing, not a pack, of another version, truncated or damaged. Damage within a
    /// blob shows when that is read.
    pub fn open(path: &Path) -> Result<Self, StoreError> {
        Self::open_in(FilePool::shared(), path)
    }

    /// As [`PackFile::open`], with the file in the given pool of open files.
    ///
    /// # Errors
    /// As [`PackFile::open`].
    pub fn open_in(pool: Arc<FilePool>, path: &Path) -> Result<Self, StoreError> {
        let read_error = |source| StoreError::Read { path: path.to_owned(), source };
        let (pooled, file) = PooledFile::open(pool, path).map_err(read_error)?;
        let metadata = file.metadata().map_err(read_error)?;
        if !metadata.is_file() {
            return Err(StoreError::NotAFile { path: path.to_owned() });
        }
        let length = metadata.len();
        let format = |source| StoreError::Format { path: path.to_owned(), source };
        let mut head = vec![0; HEAD_BYTES.min(usize::try_from(length).unwrap_or(HEAD_BYTES))];
        read_at(&file, &mut head, 0).map_err(read_error)?;
        let head = Head::parse(&head).map_err(format)?;
        let range = Table::range(&head, length).map_err(format)?;
        let mut table = vec![0; head.table_bytes()];
        read_at(&file, &mut table, range.start).map_err(read_error)?;
        let table = Table::parse(head, &table, length).map_err(format)?;
        Ok(Self { file: pooled, table, summary: OnceLock::new() })
    }

    /// Path of the pack.
    #[must_use]
    pub fn path(&self) -> &Path {
        self.file.path()
    }

    /// The head, which identifies the contents.
    #[must_use]
    pub fn head(&self) -> &Head {
        &self.table.head
    }

    /// Length of the pack.
    #[must_use]
    pub fn total_bytes(&self) -> u64 {
        self.table.total_bytes
    }

    /// Hash of the source files and settings (`lodestream_bake::prepare::cache::Key`).
    #[must_use]
    pub fn made_from(&self) -> [u8; 32] {
        self.table.head.fingerprint
    }

    /// Hash that names the contents of the whole pack.
    #[must_use]
    pub fn fingerprint(&self) -> Fingerprint {
        self.table.fingerprint
    }

    /// The table of blobs.
    pub fn entries(&self) -> &[Entry] {
        &self.table.entries
    }

    /// Length of a blob, or `None` where there is no such blob.
    #[must_use]
    pub fn blob_len(&self, part: BlobPart) -> Option<u32> {
        self.table.find(part).map(|entry| entry.length)
    }

    /// Number of a blob's entry.
    pub(super) fn number(&self, part: BlobPart) -> Option<u32> {
        let number = self.table.entries.binary_search_by_key(&kind(part), |entry| entry.kind).ok()?;
        u32::try_from(number).ok()
    }

    /// Reads a blob and checks its hash.
    ///
    /// # Errors
    /// A blob that is missing, unreadable or damaged.
    pub fn read(&self, part: BlobPart) -> Result<Bytes, StoreError> {
        let entry = self
            .table
            .find(part)
            .ok_or_else(|| StoreError::NoSuchBlob { path: self.path().to_owned(), what: blob_name(part) })?;
        self.read_entry(entry).map(Bytes::from)
    }

    /// Reads a blob and checks its hash.
    ///
    /// # Errors
    /// As [`PackFile::read`].
    pub fn read_entry(&self, entry: &Entry) -> Result<Vec<u8>, StoreError> {
        // The table's lengths were checked against the file's, so this reserves no more than it has.
        let mut bytes = vec![0; entry.length as usize];
        let file = self.file.get(|file| self.check_same(file), |source| self.unreadable(source))?;
        read_at(&file, &mut bytes, entry.offset).map_err(|source| self.unreadable(source))?;
        entry.verify(&bytes).map_err(|source| self.damaged(source))?;
        Ok(bytes)
    }

    /// Checks that a reopened file has the head and length of the first one, so the same blobs. Damage within a blob is
    /// found when it is read.
    fn check_same(&self, file: &File) -> Result<(), StoreError> {
        let mut head = [0; HEAD_BYTES];
        let same = read_at(file, &mut head, 0).is_ok()
            && Head::parse(&head).is_ok_and(|head| head == self.table.head)
            && file.metadata().is_ok_and(|metadata| metadata.len() == self.table.total_bytes);
        if same { Ok(()) } else { Err(StoreError::Replaced { path: self.path().to_owned() }) }
    }

    fn unreadable(&self, source: io::Error) -> StoreError {
        StoreError::Read { path: self.path().to_owned(), source }
    }

    /// An error about invalid bytes of this pack.
    pub fn damaged(&self, source: DecodeError) -> StoreError {
        StoreError::Format { path: self.path().to_owned(), source }
    }

    /// Reads every blob, which checks its hash. Costs about as much as reading the file.
    ///
    /// # Errors
    /// The first blob that is unreadable or damaged.
    pub fn verify(&self) -> Result<(), StoreError> {
        self.table.entries.iter().try_for_each(|entry| self.read_entry(entry).map(drop))
    }

    /// The base mesh, decoded.
    ///
    /// # Errors
    /// A base blob that is missing, unreadable or damaged.
    pub fn base(&self) -> Result<Base, StoreError> {
        decode_base(&self.read(BlobPart::Base)?).map_err(|source| self.damaged(source))
    }

    /// The pack's entry in a scene description. The first call decodes the base mesh and all index pages.
    ///
    /// # Errors
    /// As [`PackFile::base`]; also an index page that is.
    pub fn entry(&self, name: &str) -> Result<AssetEntry, StoreError> {
        Ok(AssetEntry { name: name.to_owned(), ..self.summary()?.entry.clone() })
    }

    /// Number of faces of the base mesh. Costs as much as [`PackFile::entry`].
    ///
    /// # Errors
    /// As [`PackFile::entry`].
    pub fn base_faces(&self) -> Result<u32, StoreError> {
        Ok(self.summary()?.base_faces)
    }

    fn summary(&self) -> Result<&Summary, StoreError> {
        if let Some(summary) = self.summary.get() {
            return Ok(summary);
        }
        let base = self.base()?;
        let entry = AssetEntry {
            name: String::new(),
            fingerprint: self.table.fingerprint,
            origin: base.grid.origin,
            sphere: base.sphere,
            root_error: self.root_error(&base)?,
            base_bytes: self.blob_len(BlobPart::Base).unwrap_or(0),
            chunk_count: base.chunk_count,
            shared: Vec::new(),
        };
        let base_faces = u32::try_from(base.faces.len()).unwrap_or(u32::MAX);
        Ok(self.summary.get_or_init(|| Summary { entry, base_faces }))
    }

    /// Fingerprint of each texture, by number: equal if all levels and tiles have equal bytes.
    pub fn textures(&self) -> Vec<(u16, Fingerprint)> {
        let mut levels: Vec<(u16, u8, u16, &Entry)> = self
            .table
            .entries
            .iter()
            .filter_map(|entry| match entry.kind {
                BlobKind::Texture { texture, level } => Some((texture, level, 0, entry)),
                BlobKind::Tile { texture, level, tile } => Some((texture, level, tile, entry)),
                _ => None,
            })
            .collect();
        levels.sort_unstable_by_key(|&(texture, level, tile, _)| (texture, level, tile));
        let of = |levels: &[(u16, u8, u16, &Entry)]| {
            let mut hasher = blake3::Hasher::new();
            for (_, level, _, entry) in levels {
                hasher.update(&[*level]).update(&entry.length.to_le_bytes()).update(&entry.hash());
            }
            let mut fingerprint = Fingerprint::default();
            fingerprint.copy_from_slice(&hasher.finalize().as_bytes()[..16]);
            (levels[0].0, fingerprint)
        };
        levels.chunk_by(|a, b| a.0 == b.0).map(of).collect()
    }

    /// Visible error of the base mesh, in which attributes may exceed the geometric error. Also checks that chunks have the
    /// lengths of the index, since a client treats any other length as a protocol violation.
    fn root_error(&self, base: &Base) -> Result<f32, StoreError> {
        let mut error = base.geometric_error;
        for page in 0..page_count(base.chunk_count as usize) as u32 {
            let bytes = self.read(BlobPart::IndexPage(page))?;
            let first = page * CHUNKS_PER_PAGE as u32;
            let infos = decode_page(&bytes, first).map_err(|e| self.damaged(e))?;
            let fits = |(chunk, info): (u32, &ChunkInfo)| {
                self.blob_len(BlobPart::Chunk(chunk)) == Some(info.payload_bytes)
            };
            if !(first..).zip(&infos).all(fits) {
                return Err(
                    self.damaged(DecodeError::new("pack", "a chunk is not as long as its index page says"))
                );
            }
            error = infos.iter().map(|info| visible_error(info, 1.0)).fold(error, f32::max);
        }
        Ok(error)
    }
}

#[cfg(unix)]
fn read_at(file: &File, bytes: &mut [u8], offset: u64) -> io::Result<()> {
    std::os::unix::fs::FileExt::read_exact_at(file, bytes, offset)
}

#[cfg(windows)]
fn read_at(file: &File, mut bytes: &mut [u8], mut offset: u64) -> io::Result<()> {
    while !bytes.is_empty() {
        let read = std::os::windows::fs::FileExt::seek_read(file, bytes, offset)?;
        if read == 0 {
            return Err(io::ErrorKind::UnexpectedEof.into());
        }
        bytes = &mut bytes[read..];
        offset += read as u64;
    }
    Ok(())
}
