//! Encoding of stored values: asset descriptions, scene headers and pages, directories. Messages carry them in the same
//! bytes.
//!
//! docs/formats.md specifies it: little-endian, integers of variable length in their shortest form, counted lists, no
//! names and no alignment. A number has one form, because fingerprints are computed over the bytes.
//!
//! Decoding is safe on any bytes. A length is compared with the bytes that are left before it is used, a list grows as
//! its elements are read, and the memory that a value takes counts against a limit ([`Reader::claim`]).

mod error;
mod reader;
mod values;
mod vector;
mod writer;

pub use error::CodingError;
pub use reader::{Reader, SliceReader};
pub use values::{Decode, Encode, decode, encode};
pub(crate) use values::{encode_fields, encode_variants};
pub(crate) use vector::{decode_vector, encode_vector, vector_fits_f32};
pub use writer::Writer;

#[cfg(test)]
mod tests;
