//! Where a server session finds scenes and blobs.

use std::sync::Arc;

use bytes::Bytes;

use crate::blob::BlobId;
use crate::scene::{SceneHeader, ScenePage};

/// Why a blob cannot be had.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum SourceError {
    /// No such blob in this scene.
    #[error("{0} does not exist")]
    NotFound(BlobId),
    /// The blob's bytes are damaged or cannot be read.
    #[error("{id} cannot be read: {why}")]
    Unreadable {
        /// The blob.
        id: BlobId,
        /// What the store said.
        why: String,
    },
}

/// One scene with its blobs. Shared by all sessions; calls are made from the session's own thread, so
/// they should be quick (memory or page cache).
pub trait SceneSource: Send + Sync {
    /// What holds for the whole scene.
    fn header(&self) -> &SceneHeader;

    /// A page of the description; `None` beyond the last.
    fn page(&self, page: u32) -> Option<Arc<ScenePage>>;

    /// Length of a blob in bytes, or `None` where there is no such blob. Must not read the blob.
    fn blob_len(&self, id: &BlobId) -> Option<u32>;

    /// The blob's bytes, as long as [`SceneSource::blob_len`] says.
    ///
    /// # Errors
    /// Fails where the blob is missing or damaged.
    fn read(&self, id: &BlobId) -> Result<Bytes, SourceError>;
}
