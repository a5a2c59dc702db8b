//! What arrives of the server's blobs.

use bytes::Bytes;
use lodestream_protocol::blob::BlobId;

/// A blob, or part of it, as it arrived.
#[derive(Clone, Debug)]
pub(super) struct Arrived {
    pub(super) id: BlobId,
    /// Where in the blob the bytes begin.
    pub(super) offset: u32,
    /// Length of the whole blob.
    pub(super) total: u32,
    pub(super) bytes: Bytes,
}
