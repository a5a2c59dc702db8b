//! Encoding of control messages: bincode with limits; trailing bytes are an error.

use bincode::config::{Configuration, Limit, LittleEndian, Varint};
use bincode::de::Decode;
use bincode::enc::Encode;
use lodestream_scene::coding::{CodingError, consumed};
use lodestream_scene::limits::MAX_DECODED_BYTES;

const MESSAGE: Configuration<LittleEndian, Varint, Limit<MAX_DECODED_BYTES>> =
    bincode::config::standard().with_limit::<MAX_DECODED_BYTES>();

/// Appends the encoding of a control message's body.
pub(crate) fn encode_message<T: Encode>(value: &T, out: &mut Vec<u8>) -> Result<(), CodingError> {
    bincode::encode_into_std_write(value, out, MESSAGE)?;
    Ok(())
}

/// Decodes a control message's body, all of it.
pub(crate) fn decode_message<T: Decode<()>>(bytes: &[u8]) -> Result<T, CodingError> {
    let (value, used) = bincode::decode_from_slice(bytes, MESSAGE)?;
    consumed(value, used, bytes.len())
}
