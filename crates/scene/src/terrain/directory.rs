//! Which patches have listed points: pages of a directory ([`crate::blob::TerrainBlob`]).

use bincode::config::{Configuration, Limit, LittleEndian, Varint};
use bincode::{Decode, Encode};

use crate::coding::CodingError;
use crate::limits::MAX_BLOB_BYTES;

/// Patches on one page of the directory.
pub const PATCHES_PER_PAGE: u32 = 1024;

const CONFIG: Configuration<LittleEndian, Varint, Limit<{ 64 * 1024 }>> =
    bincode::config::standard().with_limit::<{ 64 * 1024 }>();

/// A patch with listed points.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Encode, Decode)]
pub struct OverridePatch {
    /// Column of the patch.
    pub x: i32,
    /// Row of the patch.
    pub y: i32,
    /// Length of the blob of its points.
    pub bytes: u32,
    /// How far at most the ground is off while the points are missing, in height units.
    pub error: u32,
}

/// A page of the directory that cannot be.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum DirectoryError {
    /// The bytes are no page.
    #[error(transparent)]
    Coding(#[from] CodingError),
    /// More than [`PATCHES_PER_PAGE`].
    #[error("a page of the terrain's directory has {0} patches; at most {PATCHES_PER_PAGE} can be said")]
    TooMany(usize),
    /// Another number than the scene says.
    #[error("a page of the terrain's directory has {got} patches, but should have {expected}")]
    WrongCount {
        /// How many it has.
        got: usize,
        /// How many it should have.
        expected: u32,
    },
    /// The points of a patch are longer than a blob may be.
    #[error("the points of patch {at} of a page of the terrain's directory are too long")]
    PointsTooLong {
        /// Its place on the page.
        at: usize,
    },
}

/// A page of the directory as bytes. At most [`PATCHES_PER_PAGE`] patches.
///
/// # Errors
/// If there are more.
pub fn encode_directory(patches: &[OverridePatch]) -> Result<Vec<u8>, DirectoryError> {
    if patches.len() > PATCHES_PER_PAGE as usize {
        return Err(DirectoryError::TooMany(patches.len()));
    }
    Ok(bincode::encode_to_vec(patches, CONFIG).map_err(CodingError::from)?)
}

/// Reads a page of the directory that must hold `count` patches.
///
/// # Errors
/// If the bytes are not such a page. Memory is bounded by the bytes.
pub fn decode_directory(bytes: &[u8], count: u32) -> Result<Vec<OverridePatch>, DirectoryError> {
    let (patches, used): (Vec<OverridePatch>, usize) =
        bincode::decode_from_slice(bytes, CONFIG).map_err(CodingError::from)?;
    if used != bytes.len() {
        return Err(CodingError::TrailingBytes { left: bytes.len() - used }.into());
    }
    if patches.len() != count as usize {
        return Err(DirectoryError::WrongCount { got: patches.len(), expected: count });
    }
    if let Some(at) = patches.iter().position(|patch| patch.bytes > MAX_BLOB_BYTES) {
        return Err(DirectoryError::PointsTooLong { at });
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
        // 250 announces a length of 16 bits more, 252 one of 64.
        for hostile in [&[251, 255, 255][..], &[253, 255, 255, 255, 255, 255, 255, 255, 255]] {
            assert!(decode_directory(hostile, 1024).is_err());
        }
        let long = OverridePatch { x: 0, y: 0, bytes: MAX_BLOB_BYTES + 1, error: 0 };
        assert!(decode_directory(&encode_directory(&[long]).unwrap(), 1).is_err());
    }
}
