//! Lengths and hashes of blobs that lie one after the other, so that their places need no offsets.

use lodestream_geometry::index::ChunkInfo;

use super::part::{Part, PartHash};
use crate::blob::Tile;
use crate::encoding::{CodingError, Decode, Encode, Reader, Writer, encode_fields};

/// Adjacent blobs.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct BlobTable {
    /// Where the first begins.
    pub offset: u64,
    /// Length and hash of each.
    pub blobs: Vec<(u32, PartHash)>,
}

impl BlobTable {
    /// The place of a blob.
    #[must_use]
    pub fn part(&self, number: usize) -> Option<Part> {
        let &(bytes, hash) = self.blobs.get(number)?;
        let before: u64 = self.blobs[..number].iter().map(|(bytes, _)| u64::from(*bytes)).sum();
        Some(Part { offset: self.offset.checked_add(before)?, bytes, hash })
    }

    /// Where the last ends.
    #[must_use]
    pub fn end(&self) -> u64 {
        self.blobs.iter().fold(self.offset, |end, (bytes, _)| end.saturating_add((*bytes).into()))
    }
}

impl Encode for BlobTable {
    fn encode<W: Writer>(&self, writer: &mut W) -> Result<(), CodingError> {
        (self.offset, self.blobs.as_slice()).encode(writer)
    }
}

impl Decode for BlobTable {
    fn decode<R: Reader>(reader: &mut R) -> Result<Self, CodingError> {
        let offset = u64::decode(reader)?;
        let blobs = Vec::<LengthAndHash>::decode(reader)?;
        let blobs = blobs.into_iter().map(|LengthAndHash { bytes, hash }| (bytes, hash));
        Ok(Self { offset, blobs: blobs.collect() })
    }
}

struct LengthAndHash {
    bytes: u32,
    hash: PartHash,
}

encode_fields!(LengthAndHash { bytes, hash });

/// First bytes of the BLAKE3 hash of a chunk's segment: as many as a CRC has, since there are thousands of them.
pub type SegmentHash = [u8; 4];

/// The hash of a segment's bytes.
#[must_use]
pub fn segment_hash(bytes: &[u8]) -> SegmentHash {
    let [a, b, c, d, ..] = *blake3::hash(bytes).as_bytes();
    [a, b, c, d]
}

/// Where a chunk lies, and how it is checked: up to its truncation point and behind it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ChunkPlace {
    /// Length of the chunk.
    pub bytes: u32,
    /// Its truncation point, where its second segment begins; 0 if it has none.
    pub cut: u32,
    /// Hash of the first segment, if there are two.
    pub first: SegmentHash,
    /// Hash of the last segment.
    pub last: SegmentHash,
}

impl ChunkPlace {
    /// The place of a chunk without hashes, as its index entry states it.
    #[must_use]
    pub fn of(info: &ChunkInfo) -> Self {
        let cut = info.truncation_points.first().map_or(0, |point| point.payload_bytes);
        let cut = if cut < info.payload_bytes { cut } else { 0 };
        Self { bytes: info.payload_bytes, cut, ..Self::default() }
    }

    /// The same with the hashes of the chunk's bytes; `None` if they are not as long as the index states.
    #[must_use]
    pub fn hashed(self, chunk: &[u8]) -> Option<Self> {
        let (first, last) = chunk.split_at_checked(self.cut as usize)?;
        let first = if self.cut > 0 { segment_hash(first) } else { SegmentHash::default() };
        (chunk.len() == self.bytes as usize).then(|| Self { first, last: segment_hash(last), ..self })
    }

    /// Start, end and hash of its segments in the chunk, in order.
    pub fn segments(&self) -> impl Iterator<Item = (u32, u32, SegmentHash)> {
        let first = (self.cut > 0).then_some((0, self.cut, self.first));
        first.into_iter().chain([(self.cut, self.bytes, self.last)])
    }
}

/// The chunks of one index page, in a pack.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ChunkTable {
    /// Where the first begins.
    pub offset: u64,
    /// Each chunk.
    pub chunks: Vec<ChunkPlace>,
}

impl ChunkTable {
    /// The bytes that an index page does not hold itself: the offset, and the hashes of all segments in order.
    pub(super) fn hashes(&self) -> ChunkHashes {
        let hashes = self.chunks.iter().flat_map(|chunk| chunk.segments().map(|(_, _, hash)| hash));
        ChunkHashes { offset: self.offset, hashes: hashes.collect() }
    }

    /// The table of an index page's chunks.
    pub(super) fn new(index: &[ChunkInfo], hashes: &ChunkHashes) -> Option<Self> {
        let mut left = hashes.hashes.iter();
        let mut chunks = Vec::with_capacity(index.len());
        for info in index {
            let mut place = ChunkPlace::of(info);
            if place.cut > 0 {
                place.first = *left.next()?;
            }
            place.last = *left.next()?;
            chunks.push(place);
        }
        left.next().is_none().then_some(Self { offset: hashes.offset, chunks })
    }

    /// Where a chunk begins, and its place; by its number on the page.
    #[must_use]
    pub fn chunk(&self, number: usize) -> Option<(u64, &ChunkPlace)> {
        let place = self.chunks.get(number)?;
        let before: u64 = self.chunks[..number].iter().map(|chunk| u64::from(chunk.bytes)).sum();
        Some((self.offset.checked_add(before)?, place))
    }

    /// Where the last chunk ends.
    #[must_use]
    pub fn end(&self) -> u64 {
        self.chunks.iter().fold(self.offset, |end, chunk| end.saturating_add(chunk.bytes.into()))
    }
}

/// Tiles of a pack's textures, adjacent in the pack.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct TileTable {
    /// Where the first begins.
    pub offset: u64,
    /// The levels that are cut, in the pack's order.
    pub levels: Vec<TileLevel>,
}

encode_fields!(TileTable { offset, levels });

/// The tiles of a level.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct TileLevel {
    /// Number of the texture.
    pub texture: u16,
    /// Number of the level, 0 for the coarsest.
    pub level: u8,
    /// Length and hash of each tile, row by row.
    pub tiles: Vec<TilePlace>,
}

encode_fields!(TileLevel { texture, level, tiles });

/// Length and hash of a tile.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TilePlace {
    /// Its length.
    pub bytes: u32,
    /// Its hash.
    pub hash: SegmentHash,
}

encode_fields!(TilePlace { bytes, hash });

impl TileTable {
    /// Where a tile begins, and its place.
    #[must_use]
    pub fn tile(&self, tile: Tile) -> Option<(u64, TilePlace)> {
        let lengths = |places: &[TilePlace]| places.iter().map(|place| u64::from(place.bytes)).sum::<u64>();
        let mut offset = self.offset;
        for level in &self.levels {
            if (level.texture, level.level) == (tile.texture, tile.level) {
                let at = usize::from(tile.tile);
                let place = *level.tiles.get(at)?;
                return Some((offset.checked_add(lengths(&level.tiles[..at]))?, place));
            }
            offset = offset.checked_add(lengths(&level.tiles))?;
        }
        None
    }

    /// Where the last ends.
    #[must_use]
    pub fn end(&self) -> u64 {
        let places = self.levels.iter().flat_map(|level| &level.tiles);
        places.fold(self.offset, |end, place| end.saturating_add(place.bytes.into()))
    }
}

/// What follows an index page.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct ChunkHashes {
    offset: u64,
    hashes: Vec<SegmentHash>,
}

encode_fields!(ChunkHashes { offset, hashes });
