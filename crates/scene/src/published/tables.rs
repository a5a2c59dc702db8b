//! Lengths and hashes of blobs that lie one after the other, so that their places need no offsets.

use super::part::{Part, PartHash};
use crate::encoding::{CodingError, Decode, Encode, Reader, Writer, encode_fields};
use crate::limits::MAX_BLOB_BYTES;

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

/// A run of a chunk that is checked by itself: up to its truncation point, or the rest.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Segment {
    /// Its bytes in the chunk.
    pub start: u32,
    /// End of its bytes in the chunk.
    pub end: u32,
    /// Hash of its bytes.
    pub hash: PartHash,
}

/// Length of a chunk and hashes of its segments.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ChunkPlace {
    /// Length of the chunk.
    pub bytes: u32,
    /// Where its second segment begins; 0 if it has but one.
    pub cut: u32,
    /// Hash of the first segment, if there are two.
    pub first: PartHash,
    /// Hash of the last segment.
    pub last: PartHash,
}

impl ChunkPlace {
    /// The segments, in order.
    pub fn segments(&self) -> impl Iterator<Item = Segment> {
        let first = (self.cut > 0).then_some(Segment { start: 0, end: self.cut, hash: self.first });
        first.into_iter().chain([Segment { start: self.cut, end: self.bytes, hash: self.last }])
    }
}

impl Encode for ChunkPlace {
    fn encode<W: Writer>(&self, writer: &mut W) -> Result<(), CodingError> {
        (self.bytes, self.cut).encode(writer)?;
        if self.cut > 0 {
            self.first.encode(writer)?;
        }
        self.last.encode(writer)
    }
}

impl Decode for ChunkPlace {
    fn decode<R: Reader>(reader: &mut R) -> Result<Self, CodingError> {
        let (bytes, cut) = (u32::decode(reader)?, u32::decode(reader)?);
        if bytes > MAX_BLOB_BYTES || (cut > 0 && cut >= bytes) {
            return Err(CodingError::value("a chunk's length or truncation point is out of range"));
        }
        let first = if cut > 0 { PartHash::decode(reader)? } else { PartHash::default() };
        Ok(Self { bytes, cut, first, last: PartHash::decode(reader)? })
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

encode_fields!(ChunkTable { offset, chunks });

impl ChunkTable {
    /// Where a chunk begins, and its segments; by its number on the page.
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
