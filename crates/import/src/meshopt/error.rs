//! Errors of the meshopt decoders.

/// Compressed bytes that cannot be decoded.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub(crate) enum MeshoptError {
    #[error("elements of {0} bytes are not supported by this mode or filter")]
    Stride(usize),
    #[error("{0} indices are not a multiple of three")]
    Triangles(usize),
    #[error("the first byte, {0:#04x}, is of another format or of a later version")]
    Header(u8),
    #[error("a channel has an unknown mode")]
    Channel,
    #[error("the bytes end before the elements do")]
    Truncated,
    #[error("bytes are left over")]
    TrailingBytes,
}
