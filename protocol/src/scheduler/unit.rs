//! The unit of a session's queue.

use lodestream_scene::blob::BlobId;

/// A unit of the queue.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Unit {
    /// A page of the scene description.
    Page(u32),
    /// A blob.
    Blob(BlobId),
}
