//! Encoding of descriptions: the bincode configuration, its limits, and helpers.

use bincode::config::{Configuration, Limit, LittleEndian, Varint};
use bincode::de::{Decode, Decoder};
use bincode::enc::{Encode, Encoder};
use bincode::error::{DecodeError, EncodeError};

use crate::limits::MAX_DESCRIPTION_BYTES;

type Limited<const N: usize> = Configuration<LittleEndian, Varint, Limit<N>>;

const DESCRIPTION: Limited<{ 4 * MAX_DESCRIPTION_BYTES }> =
    bincode::config::standard().with_limit::<{ 4 * MAX_DESCRIPTION_BYTES }>();

/// Bytes that do not decode to a value.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum CodingError {
    /// The bytes end early.
    #[error("the bytes end too early")]
    EndsEarly,
    /// A length or count exceeds its limit.
    #[error("a length exceeds its limit")]
    LimitExceeded,
    /// A number that is no variant of an enum.
    #[error("unknown variant of {0}")]
    UnknownVariant(&'static str),
    /// A value that its type refuses.
    #[error("{why}")]
    Value {
        /// What is wrong with it.
        why: String,
    },
    /// Bytes are left over.
    #[error("{left} bytes are left over at the end")]
    TrailingBytes {
        /// How many.
        left: usize,
    },
    /// More bytes than allowed.
    #[error("{bytes} bytes, but at most {limit} are allowed")]
    TooLong {
        /// How many.
        bytes: usize,
        /// The greatest allowed number.
        limit: usize,
    },
}

impl From<DecodeError> for CodingError {
    fn from(error: DecodeError) -> Self {
        // bincode's messages print whole types; operators need the cause only.
        match error {
            DecodeError::UnexpectedEnd { .. } => Self::EndsEarly,
            DecodeError::LimitExceeded => Self::LimitExceeded,
            DecodeError::UnexpectedVariant { type_name, .. } => Self::UnknownVariant(type_name),
            other => Self::Value { why: other.to_string() },
        }
    }
}

impl From<EncodeError> for CodingError {
    fn from(error: EncodeError) -> Self {
        Self::Value { why: error.to_string() }
    }
}

/// Encodes an asset description.
pub(crate) fn encode_description<T: Encode>(value: &T) -> Result<Vec<u8>, CodingError> {
    let bytes = bincode::encode_to_vec(value, DESCRIPTION)?;
    if bytes.len() > MAX_DESCRIPTION_BYTES {
        return Err(CodingError::TooLong { bytes: bytes.len(), limit: MAX_DESCRIPTION_BYTES });
    }
    Ok(bytes)
}

/// Decodes an asset description, all of it.
pub(crate) fn decode_description<T: Decode<()>>(bytes: &[u8]) -> Result<T, CodingError> {
    if bytes.len() > MAX_DESCRIPTION_BYTES {
        return Err(CodingError::TooLong { bytes: bytes.len(), limit: MAX_DESCRIPTION_BYTES });
    }
    let (value, used) = bincode::decode_from_slice(bytes, DESCRIPTION)?;
    consumed(value, used, bytes.len())
}

/// Checks that decoding used all bytes: bincode accepts trailing bytes silently.
///
/// # Errors
/// If bytes are left over.
pub fn consumed<T>(value: T, used: usize, length: usize) -> Result<T, CodingError> {
    if used == length { Ok(value) } else { Err(CodingError::TrailingBytes { left: length - used }) }
}

/// Whether a value is exact in f32.
fn fits_f32(value: f64) -> bool {
    #[expect(clippy::cast_possible_truncation, reason = "the loss is checked below")]
    let short = value as f32;
    f64::from(short) == value
}

/// Whether a vector is exact in f32; callers encode that as a flag.
pub(crate) fn vector_fits_f32(v: &[f64; 3]) -> bool {
    v.iter().all(|&x| fits_f32(x))
}

/// Encodes a vector in 12 bytes if `short`, else in 24.
pub(crate) fn encode_vector<E: Encoder>(v: &[f64; 3], short: bool, e: &mut E) -> Result<(), EncodeError> {
    if short {
        #[expect(
            clippy::cast_possible_truncation,
            reason = "`short` is set only if the vector is exact in f32"
        )]
        v.map(|x| x as f32).encode(e)
    } else {
        v.encode(e)
    }
}

/// Inverse of [`encode_vector`].
pub(crate) fn decode_vector<D: Decoder>(short: bool, d: &mut D) -> Result<[f64; 3], DecodeError> {
    if short { Ok(<[f32; 3]>::decode(d)?.map(f64::from)) } else { <[f64; 3]>::decode(d) }
}
