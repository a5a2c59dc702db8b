//! What can be wrong with what is to be decoded.

/// What is wrong with compressed bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub(crate) enum Damage {
    #[error("elements of {0} bytes cannot be compressed so")]
    Stride(usize),
    #[error("{0} indices are no triangles")]
    Triangles(usize),
    #[error("the first byte, {0:#04x}, is of another format or of a later version")]
    Header(u8),
    #[error("they are coded in an unknown way")]
    Channel,
    #[error("the bytes end before the elements do")]
    Short,
    #[error("bytes are left over")]
    Left,
}
