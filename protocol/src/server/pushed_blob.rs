//! A blob that the server pushes in the first refinement.

use lodestream_scene::blob::BlobId;
use lodestream_select::priority::Priority;

/// One blob of the first refinement.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct PushedBlob {
    pub(super) priority: Priority,
    pub(super) id: BlobId,
    /// End of the part that the view needs, in bytes; `None` for the whole blob.
    pub(super) end: Option<u32>,
}
