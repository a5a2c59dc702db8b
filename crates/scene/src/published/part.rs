//! A run of bytes of an object, and its hash.

use std::ops::Range;

use super::PublishedError;
use crate::encoding::{CodingError, Decode, Encode, Reader, Writer};

/// Bytes of a hash.
pub const HASH_BYTES: usize = 8;

/// First bytes of a BLAKE3 hash. They find damage and stale copies; who controls the host controls the scene anyway, so
/// more would protect nothing.
pub type PartHash = [u8; HASH_BYTES];

/// The hash of a part's bytes.
#[must_use]
pub fn part_hash(bytes: &[u8]) -> PartHash {
    let mut hash = PartHash::default();
    hash.copy_from_slice(&blake3::hash(bytes).as_bytes()[..HASH_BYTES]);
    hash
}

/// A run of bytes: of the published scene, counted from the end of its opening, or of a pack.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Part {
    /// Where it begins.
    pub offset: u64,
    /// Its length.
    pub bytes: u32,
    /// Hash of its bytes.
    pub hash: PartHash,
}

impl Part {
    /// Its bytes in the object.
    #[must_use]
    pub const fn range(&self) -> Range<u64> {
        self.offset..self.end()
    }

    /// Where it ends.
    #[must_use]
    pub const fn end(&self) -> u64 {
        self.offset.saturating_add(self.bytes as u64)
    }

    /// Checks its bytes.
    ///
    /// # Errors
    /// [`PublishedError::Hash`] with the name given.
    pub fn verify(&self, bytes: &[u8], what: &'static str) -> Result<(), PublishedError> {
        let same = bytes.len() == self.bytes as usize && part_hash(bytes) == self.hash;
        if same { Ok(()) } else { Err(PublishedError::Hash(what)) }
    }
}

impl Encode for Part {
    fn encode<W: Writer>(&self, writer: &mut W) -> Result<(), CodingError> {
        self.offset.encode(writer)?;
        self.bytes.encode(writer)?;
        self.hash.encode(writer)
    }
}

impl Decode for Part {
    fn decode<R: Reader>(reader: &mut R) -> Result<Self, CodingError> {
        let part = Self {
            offset: u64::decode(reader)?,
            bytes: u32::decode(reader)?,
            hash: PartHash::decode(reader)?,
        };
        match part.offset.checked_add(part.bytes.into()) {
            Some(_) => Ok(part),
            None => Err(CodingError::value("a part ends beyond any object")),
        }
    }
}
