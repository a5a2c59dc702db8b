//! Vectors in f32 where that is exact, else in f64.

use super::{CodingError, Decode, Encode, Reader, Writer};

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
pub(crate) fn encode_vector<W: Writer>(v: &[f64; 3], short: bool, writer: &mut W) -> Result<(), CodingError> {
    if short {
        #[expect(
            clippy::cast_possible_truncation,
            reason = "`short` is set only if the vector is exact in f32"
        )]
        v.map(|x| x as f32).encode(writer)
    } else {
        v.encode(writer)
    }
}

/// Inverse of [`encode_vector`].
pub(crate) fn decode_vector<R: Reader>(short: bool, reader: &mut R) -> Result<[f64; 3], CodingError> {
    if short { Ok(<[f32; 3]>::decode(reader)?.map(f64::from)) } else { Decode::decode(reader) }
}
