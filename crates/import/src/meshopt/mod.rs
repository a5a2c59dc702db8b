//! Decoders of meshoptimizer's codecs, as used by glTF's EXT_meshopt_compression and KHR_meshopt_compression: from
//! compressed bytes to the bytes of a buffer view.
//!
//! Written from the specification of KHR_meshopt_compression (appendix A, "Bitstream"; appendix B, "Filters"), which
//! describes versions 0 (EXT) and 1 (KHR) of attributes. Tests encode and compare with the crate `meshopt`, which wraps
//! the library. It does not decode here because its filters use the processor's estimate of reciprocal square roots: the
//! same file would give different bytes on different processors.
//!
//! Each format has a minimum of bytes per element, which is checked before memory is reserved.

mod attributes;
mod error;
mod filter;
mod indices;
mod reader;
#[cfg(test)]
pub(crate) mod tests;

pub(crate) use error::MeshoptError;
pub(crate) use filter::Filter;

/// Codec of a buffer view.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Mode {
    /// Elements of any type, each byte as the difference from the previous element's.
    Attributes(Option<Filter>),
    /// Indices of a triangle list.
    Triangles,
    /// Any indices.
    Indices,
}

/// Decodes `count` elements of `stride` bytes each.
///
/// # Errors
/// Bytes that are not exactly that many elements.
pub(crate) fn decode(mode: Mode, data: &[u8], count: usize, stride: usize) -> Result<Vec<u8>, MeshoptError> {
    match mode {
        Mode::Attributes(filter) => {
            if !stride.is_multiple_of(4) || !(4..=256).contains(&stride) {
                return Err(MeshoptError::Stride(stride));
            }
            if filter.is_some_and(|filter| !filter.fits(stride)) {
                return Err(MeshoptError::Stride(stride));
            }
            let mut bytes = attributes::decode(data, count, stride)?;
            if let Some(filter) = filter {
                filter.undo(&mut bytes, stride);
            }
            Ok(bytes)
        }
        Mode::Triangles | Mode::Indices if stride != 2 && stride != 4 => Err(MeshoptError::Stride(stride)),
        Mode::Triangles if !count.is_multiple_of(3) => Err(MeshoptError::Triangles(count)),
        Mode::Triangles => indices::triangles(data, count, stride),
        Mode::Indices => indices::sequence(data, count, stride),
    }
}
