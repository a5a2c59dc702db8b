//! The pack: one file per asset. A head, a table of blobs with a hash each, the blobs.
//!
//! ```text
//! magic "LODSPACK" | version u16 | 0 u16 | blobs u32 | fingerprint [32] | hash of head and table [16]
//! table: per blob  kind u8 | level u8 | texture u16 | index u32 | offset u64 | length u32 | hash [16]
//! blobs, in the table's order: base, index pages, chunks, settings, textures, texture regions, tiles
//! ```
//! All numbers little-endian; hashes are the first 16 bytes of BLAKE3. The crate reads and writes byte
//! slices; files are the caller's.

use crate::entropy::bytes::Reader;
use crate::error::DecodeError;

/// First bytes of every pack.
pub const MAGIC: [u8; 8] = *b"LODSPACK";
/// Version of the file's layout.
pub const PACK_VERSION: u16 = 3;
/// Bytes of the head.
pub const HEAD_BYTES: usize = 64;
/// Bytes of a table entry.
pub const ENTRY_BYTES: usize = 36;
/// Most blobs of one pack.
pub const MAX_BLOBS: u32 = 1 << 25;

/// Kind of a blob. Blobs are stored in this order.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum BlobKind {
    /// The base blob ([`crate::asset::base::Base`]).
    Base,
    /// An index page ([`crate::index`]).
    IndexPage(u32),
    /// A chunk's payload.
    Chunk(u32),
    /// The settings of the preparation, as text for people. Never sent.
    Settings,
    /// A mip level of a texture, coarsest level first.
    Texture {
        /// Number of the texture.
        texture: u16,
        /// Number of the level, 0 for the coarsest.
        level: u8,
    },
    /// Where the surface is in the textures.
    TextureRegions,
    /// A tile of a mip level of a texture.
    Tile {
        /// Number of the texture.
        texture: u16,
        /// Number of the level, 0 for the coarsest.
        level: u8,
        /// Number of the tile, row by row.
        tile: u16,
    },
}

/// Place and hash of a blob.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Entry {
    /// What it is.
    pub kind: BlobKind,
    /// Offset in the file.
    pub offset: u64,
    /// Length in bytes.
    pub length: u32,
    hash: [u8; 16],
}

impl Entry {
    /// First 16 bytes of the BLAKE3 hash of the blob.
    #[must_use]
    pub const fn hash(&self) -> [u8; 16] {
        self.hash
    }

    /// Verifies the blob's bytes as read from the file.
    ///
    /// # Errors
    /// If length or hash differ.
    pub fn verify(&self, bytes: &[u8]) -> Result<(), DecodeError> {
        if bytes.len() != self.length as usize || hash(bytes) != self.hash {
            let what = format!("pack blob {:?} at byte {}", self.kind, self.offset);
            return Err(DecodeError::new(
                what,
                "its hash does not match: the file is damaged; prepare it again",
            ));
        }
        Ok(())
    }
}

/// The head of a pack.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Head {
    /// Hash of source files and settings, as the caller computed it.
    pub fingerprint: [u8; 32],
    blobs: u32,
    hash: [u8; 16],
}

impl Head {
    /// Reads the first [`HEAD_BYTES`] of a file.
    ///
    /// # Errors
    /// If they are not the head of a pack of this version.
    pub fn parse(bytes: &[u8]) -> Result<Self, DecodeError> {
        let mut r = Reader::new(bytes, "pack");
        if r.array::<8>().ok() != Some(MAGIC) {
            return Err(r.error("this is not a Lodestream pack (wrong magic bytes)"));
        }
        let version = u16::from_le_bytes(r.array()?);
        if version != PACK_VERSION {
            return Err(r.error(format!(
                "pack version {version}; this program reads version {PACK_VERSION}; prepare the asset again"
            )));
        }
        r.array::<2>()?;
        let blobs = u32::from_le_bytes(r.array()?);
        if blobs > MAX_BLOBS {
            return Err(r.error(format!("{blobs} blobs; at most {MAX_BLOBS} are possible")));
        }
        Ok(Self { fingerprint: r.array()?, blobs, hash: r.array()? })
    }

    /// Bytes of the table that follows the head.
    #[must_use]
    pub fn table_bytes(&self) -> usize {
        self.blobs as usize * ENTRY_BYTES
    }

    /// Parses the table; `file_length` bounds the entries.
    ///
    /// # Errors
    /// If the table is damaged, out of order or points outside the file.
    pub fn parse_table(&self, bytes: &[u8], file_length: u64) -> Result<Vec<Entry>, DecodeError> {
        let mut r = Reader::new(bytes, "pack table");
        if bytes.len() != self.table_bytes() {
            return Err(r.error("the file ends within its table"));
        }
        if head_hash(&self.fingerprint, bytes) != self.hash {
            return Err(r.error("its hash does not match: the file is damaged; prepare it again"));
        }
        let mut entries: Vec<Entry> = Vec::with_capacity(self.blobs as usize);
        for _ in 0..self.blobs {
            let (kind, level) = (r.u8()?, r.u8()?);
            let texture = u16::from_le_bytes(r.array()?);
            let index = u32::from_le_bytes(r.array()?);
            let kind = match kind {
                0 => BlobKind::Base,
                1 => BlobKind::IndexPage(index),
                2 => BlobKind::Chunk(index),
                3 => BlobKind::Texture { texture, level },
                4 => BlobKind::Settings,
                5 => BlobKind::TextureRegions,
                6 => {
                    let tile = u16::try_from(index).map_err(|_| r.error("a tile beyond the last"))?;
                    BlobKind::Tile { texture, level, tile }
                }
                other => return Err(r.error(format!("unknown kind of blob {other}"))),
            };
            let offset = u64::from_le_bytes(r.array()?);
            let length = u32::from_le_bytes(r.array()?);
            let hash = r.array()?;
            if offset.checked_add(u64::from(length)).is_none_or(|end| end > file_length) {
                return Err(
                    r.error(format!("blob {kind:?} lies beyond the file's end: the file is truncated"))
                );
            }
            if entries.last().is_some_and(|e| e.kind >= kind) {
                return Err(r.error("its blobs are out of order"));
            }
            entries.push(Entry { kind, offset, length, hash });
        }
        Ok(entries)
    }
}

/// Finds a blob in a table.
#[must_use]
pub fn find(entries: &[Entry], kind: BlobKind) -> Option<&Entry> {
    entries.binary_search_by_key(&kind, |e| e.kind).ok().map(|i| &entries[i])
}

/// Writes a pack. Blobs may come in any order, each kind once.
///
/// # Errors
/// If a blob is given twice or is longer than 4 GiB, or there are too many.
pub fn write(fingerprint: [u8; 32], blobs: &[(BlobKind, &[u8])]) -> Result<Vec<u8>, DecodeError> {
    let mut order: Vec<usize> = (0..blobs.len()).collect();
    order.sort_by_key(|&i| blobs[i].0);
    if let Some(w) = order.windows(2).find(|w| blobs[w[0]].0 == blobs[w[1]].0) {
        return Err(DecodeError::new("pack", format!("blob {:?} is given twice", blobs[w[0]].0)));
    }
    let too_large = |what: &str| DecodeError::new("pack", format!("{what} is too large"));
    let count =
        u32::try_from(blobs.len()).ok().filter(|&c| c <= MAX_BLOBS).ok_or_else(|| too_large("the table"))?;
    let mut table = Vec::with_capacity(blobs.len() * ENTRY_BYTES);
    let mut offset = (HEAD_BYTES + blobs.len() * ENTRY_BYTES) as u64;
    for &i in &order {
        let (kind, bytes) = blobs[i];
        let (tag, level, texture, index) = match kind {
            BlobKind::Base => (0_u8, 0_u8, 0_u16, 0_u32),
            BlobKind::IndexPage(page) => (1, 0, 0, page),
            BlobKind::Chunk(chunk) => (2, 0, 0, chunk),
            BlobKind::Texture { texture, level } => (3, level, texture, 0),
            BlobKind::Settings => (4, 0, 0, 0),
            BlobKind::TextureRegions => (5, 0, 0, 0),
            BlobKind::Tile { texture, level, tile } => (6, level, texture, tile.into()),
        };
        let length = u32::try_from(bytes.len()).map_err(|_| too_large("a blob"))?;
        table.extend([tag, level]);
        table.extend(texture.to_le_bytes());
        table.extend(index.to_le_bytes());
        table.extend(offset.to_le_bytes());
        table.extend(length.to_le_bytes());
        table.extend(hash(bytes));
        offset += u64::from(length);
    }
    let mut out = Vec::with_capacity(usize::try_from(offset).unwrap_or(0));
    out.extend(MAGIC);
    out.extend(PACK_VERSION.to_le_bytes());
    out.extend([0; 2]);
    out.extend(count.to_le_bytes());
    out.extend(fingerprint);
    out.extend(head_hash(&fingerprint, &table));
    out.extend(&table);
    for &i in &order {
        out.extend(blobs[i].1);
    }
    Ok(out)
}

fn hash(bytes: &[u8]) -> [u8; 16] {
    let mut out = [0; 16];
    out.copy_from_slice(&blake3::hash(bytes).as_bytes()[..16]);
    out
}

/// Hash over the unchecked fields of the head, and the table.
fn head_hash(fingerprint: &[u8; 32], table: &[u8]) -> [u8; 16] {
    let mut hasher = blake3::Hasher::new();
    hasher.update(fingerprint);
    hasher.update(table);
    let mut out = [0; 16];
    out.copy_from_slice(&hasher.finalize().as_bytes()[..16]);
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample() -> Vec<u8> {
        write(
            [7; 32],
            &[(BlobKind::Chunk(1), b"second"), (BlobKind::Base, b"base"), (BlobKind::Chunk(0), b"first")],
        )
        .unwrap()
    }

    fn read(file: &[u8]) -> Result<Vec<Vec<u8>>, DecodeError> {
        let head = Head::parse(&file[..file.len().min(HEAD_BYTES)])?;
        let end = (HEAD_BYTES + head.table_bytes()).min(file.len());
        let entries = head.parse_table(&file[HEAD_BYTES.min(end)..end], file.len() as u64)?;
        entries
            .iter()
            .map(|e| {
                let bytes = &file[e.offset as usize..e.offset as usize + e.length as usize];
                e.verify(bytes)?;
                Ok(bytes.to_vec())
            })
            .collect()
    }

    #[test]
    fn blobs_come_back_in_file_order() {
        assert_eq!(read(&sample()).unwrap(), [b"base".to_vec(), b"first".to_vec(), b"second".to_vec()]);
    }

    #[test]
    fn every_flipped_bit_is_noticed() {
        let good = sample();
        for i in 0..good.len() * 8 {
            let mut bad = good.clone();
            bad[i / 8] ^= 1 << (i % 8);
            // Two reserved bytes carry nothing.
            if (80..96).contains(&i) {
                continue;
            }
            assert!(read(&bad).is_err(), "bit {i}");
        }
    }

    #[test]
    fn every_truncation_is_noticed() {
        let good = sample();
        for length in 0..good.len() {
            assert!(read(&good[..length]).is_err(), "length {length}");
        }
    }

    #[test]
    fn errors_say_what_is_wrong() {
        let mut other = sample();
        other[0] = b'X';
        assert!(read(&other).unwrap_err().to_string().contains("not a Lodestream pack"));
        let mut newer = sample();
        newer[8] = 9;
        assert!(read(&newer).unwrap_err().to_string().contains("version 9"));
        assert!(write([0; 32], &[(BlobKind::Base, b""), (BlobKind::Base, b"")]).is_err());
    }
}
