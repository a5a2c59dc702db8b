//! Directory of the patches with height overrides, in pages ([`crate::blob::TerrainBlob`]).

use crate::encoding::{self, CodingError, encode_fields};
use crate::limits::MAX_BLOB_BYTES;

/// Patches on one page of the directory.
pub const PATCHES_PER_PAGE: u32 = 1024;

/// Most memory that a decoded page may take, in bytes.
const MAX_MEMORY_BYTES: usize = 64 * 1024;

/// A patch with height overrides.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct OverridePatch {
    /// Column of the patch.
    pub x: i32,
    /// Row of the patch.
    pub y: i32,
    /// Length of the blob with its height overrides.
    pub bytes: u32,
    /// Largest error of the terrain without the overrides, in height units.
    pub error: u32,
}

encode_fields!(OverridePatch { x, y, bytes, error });

/// An invalid page of the directory.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum DirectoryError {
    /// The bytes are not a valid page.
    #[error(transparent)]
    Coding(#[from] CodingError),
    /// More than [`PATCHES_PER_PAGE`].
    #[error("a page of the terrain's directory has {0} patches; at most {PATCHES_PER_PAGE} are allowed")]
    TooMany(usize),
    /// Another number of patches than the scene states.
    #[error("a page of the terrain's directory has {got} patches, but should have {expected}")]
    WrongCount {
        /// How many it has.
        got: usize,
        /// How many it should have.
        expected: u32,
    },
    /// The overrides of a patch are longer than a blob may be.
    #[error("the height overrides of patch {at} of a page of the terrain's directory are too long")]
    OverridesTooLong {
        /// Index of the patch on the page.
        at: usize,
    },
}

/// Encodes a page of the directory.
///
/// # Errors
/// If there are more than [`PATCHES_PER_PAGE`] patches.
pub fn encode_directory(patches: &[OverridePatch]) -> Result<Vec<u8>, DirectoryError> {
    if patches.len() > PATCHES_PER_PAGE as usize {
        return Err(DirectoryError::TooMany(patches.len()));
    }
    Ok(encoding::encode(patches)?)
}

/// Decodes a page of the directory that must hold `count` patches. Memory is bounded by the length of `bytes`.
///
/// # Errors
/// If the bytes are not such a page.
pub fn decode_directory(bytes: &[u8], count: u32) -> Result<Vec<OverridePatch>, DirectoryError> {
    let patches: Vec<OverridePatch> = encoding::decode(bytes, MAX_MEMORY_BYTES)?;
    if patches.len() != count as usize {
        return Err(DirectoryError::WrongCount { got: patches.len(), expected: count });
    }
    if let Some(at) = patches.iter().position(|patch| patch.bytes > MAX_BLOB_BYTES) {
        return Err(DirectoryError::OverridesTooLong { at });
    }
    Ok(patches)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn patches(count: i32) -> Vec<OverridePatch> {
        (0..count)
            .map(|i| OverridePatch { x: i - 7, y: -3 * i, bytes: 100 + i as u32, error: 9000 })
            .collect()
    }

    #[test]
    fn pages_survive_the_wire_and_truncation_is_an_error() {
        let all = patches(100);
        let bytes = encode_directory(&all).unwrap();
        assert_eq!(decode_directory(&bytes, 100).unwrap(), all);
        for end in 0..bytes.len() {
            assert!(decode_directory(&bytes[..end], 100).is_err(), "{end}");
        }
        assert!(decode_directory(&bytes, 99).is_err());
        assert!(decode_directory(&[bytes, vec![0]].concat(), 100).is_err());
        assert!(encode_directory(&patches(1025)).is_err());
    }

    #[test]
    fn lengths_that_bytes_cannot_justify_are_refused() {
        // 251 announces a count of 16 bits, 253 one of 64.
        for hostile in [&[251, 255, 255][..], &[253, 255, 255, 255, 255, 255, 255, 255, 255]] {
            assert!(decode_directory(hostile, 1024).is_err());
        }
        let long = OverridePatch { x: 0, y: 0, bytes: MAX_BLOB_BYTES + 1, error: 0 };
        assert!(decode_directory(&encode_directory(&[long]).unwrap(), 1).is_err());
    }
}
