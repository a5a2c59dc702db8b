//! meshoptimizer's codecs, as glTF's EXT_meshopt_compression and KHR_meshopt_compression use them: what is compressed to
//! the bytes of a buffer view.
//!
//! Written from the specification of KHR_meshopt_compression (appendix A, "Bitstream"; appendix B, "Filters"), where
//! versions 0 (EXT) and 1 (KHR) of attributes stand; the crate `meshopt`, which wraps the codecs of the library itself,
//! is what the tests encode with and compare with. Not that crate in here: its filters take the reciprocal of a root
//! from the processor's estimate, so the same file would give other bytes on another make of processor.
//!
//! What is reserved is held against the bytes that are there first: each format has a least number of bytes per element.

mod attributes;
mod damage;
mod filter;
mod indices;
mod reader;
#[cfg(test)]
pub(crate) mod tests;

pub(crate) use damage::Damage;
pub(crate) use filter::Filter;

/// What a buffer view is compressed as.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Mode {
    /// Elements of any kind, byte by byte against the element before.
    Attributes(Option<Filter>),
    /// A list of triangles.
    Triangles,
    /// Any indices.
    Indices,
}

/// `count` elements of `stride` bytes each.
///
/// # Errors
/// Bytes that say another number of elements, or nothing.
pub(crate) fn decode(mode: Mode, data: &[u8], count: usize, stride: usize) -> Result<Vec<u8>, Damage> {
    match mode {
        Mode::Attributes(filter) => {
            if !stride.is_multiple_of(4) || !(4..=256).contains(&stride) {
                return Err(Damage::Stride(stride));
            }
            if filter.is_some_and(|filter| !filter.fits(stride)) {
                return Err(Damage::Stride(stride));
            }
            let mut bytes = attributes::decode(data, count, stride)?;
            if let Some(filter) = filter {
                filter.undo(&mut bytes, stride);
            }
            Ok(bytes)
        }
        Mode::Triangles | Mode::Indices if stride != 2 && stride != 4 => Err(Damage::Stride(stride)),
        Mode::Triangles if !count.is_multiple_of(3) => Err(Damage::Triangles(count)),
        Mode::Triangles => indices::triangles(data, count, stride),
        Mode::Indices => indices::sequence(data, count, stride),
    }
}
