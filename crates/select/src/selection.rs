//! Result of a selection.

use super::priority::Priority;
use lodestream_scene::blob::BlobId;

/// State of a blob at the caller.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum State {
    /// Not received and not requested.
    #[default]
    Absent,
    /// Requested, or about to be pushed.
    InFlight,
    /// Received, but not in use.
    Cached,
    /// In use: drawn (base, chunk, texture level) or known (index page).
    Applied,
    /// Refused or damaged. Neither it nor its children are wanted.
    Failed,
}

/// One wanted blob.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Wanted {
    /// The blob.
    pub id: BlobId,
    /// Higher first; never above a parent's.
    pub priority: Priority,
    /// Length of the whole blob in bytes, if known.
    pub bytes: Option<u32>,
    /// State of the wanted part: absent, in flight or cached. Applied blobs are not listed.
    pub state: State,
    /// Bytes received from the start of the blob.
    pub held: u32,
    /// End of the wanted part in bytes; `None` for the whole blob.
    pub end: Option<u32>,
    /// Truncation point up to which a chunk is to be applied; `None` for the whole chunk.
    pub truncation: Option<u8>,
    /// A chunk's own screen error while it is missing, in whole pixels rounded down, at most `u16::MAX`; 0 for other
    /// blobs.
    pub error_px: u16,
}

impl Wanted {
    /// A whole blob of which nothing was received.
    #[must_use]
    pub const fn whole(id: BlobId, priority: Priority, bytes: Option<u32>, state: State) -> Self {
        Self { id, priority, bytes, state, held: 0, end: None, truncation: None, error_px: 0 }
    }
}

/// Counters of one call.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Counters {
    /// Instances whose bounds reach into the frustum.
    pub visible_instances: u32,
    /// Of these, the ones whose base mesh is applied: all of them at the first frame.
    pub drawable_instances: u32,
    /// Chunk entries evaluated, once per visible instance.
    pub tested_chunks: u64,
    /// Chunks that the view needs, applied or not.
    pub needed_chunks: u32,
    /// Of these, the ones that are not applied.
    pub missing_chunks: u32,
    /// Payload bytes of the missing ones that were not received.
    pub missing_bytes: u64,
    /// Payload bytes of the needed ones, up to their truncation points.
    pub needed_bytes: u64,
    /// Of these, bytes of chunks that the view needs for shadows only.
    pub shadow_bytes: u64,
    /// Faces of the applied chunks.
    pub applied_faces: u64,
    /// Payload bytes of the applied chunks.
    pub applied_bytes: u64,
    /// Texels of the applied texture levels, shared ones once.
    pub texels: u64,
    /// Texture levels that the view needs and [`SelectSettings::max_texels`](super::SelectSettings::max_texels) leaves
    /// out.
    pub levels_without_room: u32,
    /// Upper bound on the screen error of all visible parts with the applied blobs, in pixels; infinite while a visible
    /// instance lacks its base mesh.
    pub max_screen_error_px: f64,
    /// The same without occluded parts: regions of which less than a hundredth of the disc is visible.
    pub unoccluded_screen_error_px: f64,
    /// Screen error above which chunks are wanted now: the view's target, or more over budget.
    pub threshold_px: f64,
    /// Whether nothing is wanted: the picture is as fine as target and budgets allow.
    pub settled: bool,
}

/// Result of one call.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Selection {
    /// Wanted blobs, most urgent first; with the applied ones, any prefix is an ancestor-closed cut.
    pub wanted: Vec<Wanted>,
    /// Blobs in flight that the view does not need.
    pub cancel: Vec<BlobId>,
    /// Blobs that the view needs and that have failed ([`State::Failed`]); the picture stays coarser there.
    pub failed: Vec<BlobId>,
    /// Applied chunks that the view does not need, in an order in which they may be undone.
    pub undo: Vec<BlobId>,
    /// Counters of the call.
    pub counters: Counters,
}
