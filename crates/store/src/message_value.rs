//! Scene headers and pages as the bytes that messages carry (docs/protocol.md), for fingerprints and scene objects.

use bincode::config::{Configuration, Limit, LittleEndian, Varint};
use bincode::{Decode, Encode};
use lodestream_scene::coding::{CodingError, consumed};
use lodestream_scene::limits::{MAX_DECODED_BYTES, MAX_MESSAGE_BYTES};

/// As the protocol crate's: most memory that decoding one value may reserve.
const LIMITED: Configuration<LittleEndian, Varint, Limit<MAX_DECODED_BYTES>> =
    bincode::config::standard().with_limit::<MAX_DECODED_BYTES>();

/// Encodes a value as in a message. The caller checks its length.
///
/// # Errors
/// A value that its type refuses.
pub(super) fn encode_value<T: Encode>(value: &T) -> Result<Vec<u8>, CodingError> {
    Ok(bincode::encode_to_vec(value, bincode::config::standard())?)
}

/// Decodes a value as in a message, from all of the bytes.
///
/// # Errors
/// Bytes that are not the value, too long, or left over. Reserves [`MAX_DECODED_BYTES`] at most.
pub(super) fn decode_value<T: Decode<()>>(bytes: &[u8]) -> Result<T, CodingError> {
    let bytes = checked_length(bytes)?;
    let (value, used) = bincode::decode_from_slice(bytes, LIMITED)?;
    consumed(value, used, bytes.len())
}

/// Checks that a message can carry the bytes.
///
/// # Errors
/// More than [`MAX_MESSAGE_BYTES`].
pub(super) fn checked_length<T: AsRef<[u8]>>(value: T) -> Result<T, CodingError> {
    let bytes = value.as_ref().len();
    if bytes > MAX_MESSAGE_BYTES {
        return Err(CodingError::TooLong { bytes, limit: MAX_MESSAGE_BYTES });
    }
    Ok(value)
}
