//! Parts of the state of [`ClientCore`](super::ClientCore), each with the module that changes it: the session
//! (`session`), the selection (`update`), received blobs (`arrivals`).

use bytes::Bytes;
use lodestream_protocol::message::{Close, Welcome};
use lodestream_protocol::time::Time;
use lodestream_scene::blob::BlobId;
use lodestream_select::{Selector, Wanted};

use super::source::Source;

/// Cost of handling a blob besides its bytes, in units of [`ClientCore::update`]'s budget.
pub(super) const BLOB_COST: u64 = 256;
/// Cost of a step of compaction in the same units: about that of four chunks of usual size.
pub(super) const COMPACTION_COST: u64 = 4096;

/// The present session, and what earlier ones leave to it.
#[derive(Debug, Default)]
pub(super) struct ConnectionState {
    pub(super) session: Option<Source>,
    pub(super) welcome: Option<Welcome>,
    /// Why the session ended.
    pub(super) closed: Option<Close>,
    /// Whether the server has sent the base meshes of everything in view.
    pub(super) bases_sent: bool,
    /// The user's connect call.
    pub(super) started: Option<Time>,
    /// Transport payload of the present connection.
    pub(super) transport_bytes: u64,
    /// Range requests of earlier sessions.
    pub(super) earlier_requests: u64,
    /// Transport payload of earlier connections.
    pub(super) earlier_bytes: u64,
}

/// The last selection, and what has happened since.
#[derive(Debug)]
pub(in crate::core) struct SelectionState {
    pub(super) selector: Selector,
    /// Blobs wanted by the last selection, most urgent first; their states are kept up to date.
    pub(in crate::core) wanted: Vec<Wanted>,
    /// Blobs that the view needs and that failed, as of the last selection.
    pub(super) failed: Vec<BlobId>,
    /// Whether anything has changed that the last selection did not take into account.
    pub(super) stale: bool,
    /// Whether all height overrides that the view needs have arrived or failed.
    pub(super) terrain_settled: bool,
    /// Whether all punctual lights that the view needs have arrived or failed.
    pub(super) punctual_lights_settled: bool,
    /// Whether all animated models have arrived or failed.
    pub(super) animations_settled: bool,
    /// Time of the last selection.
    pub(super) selected_at: Option<Time>,
}

impl SelectionState {
    pub(super) const fn new(selector: Selector) -> Self {
        Self {
            selector,
            wanted: Vec::new(),
            failed: Vec::new(),
            stale: false,
            terrain_settled: true,
            punctual_lights_settled: true,
            animations_settled: true,
            selected_at: None,
        }
    }
}

/// A received blob, or a part of it.
#[derive(Clone, Debug)]
pub(super) struct ReceivedBlob {
    pub(super) id: BlobId,
    /// Offset of the bytes in the blob.
    pub(super) offset: u32,
    /// Length of the whole blob.
    pub(super) total: u32,
    pub(super) bytes: Bytes,
}
