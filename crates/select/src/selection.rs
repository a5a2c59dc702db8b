//! What a selection finds.

use super::priority::Priority;
use lodestream_scene::blob::BlobId;

/// Where a blob is, as far as the caller is concerned.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum State {
    /// Not here and not asked for.
    #[default]
    Absent,
    /// Asked for, or about to be pushed.
    InFlight,
    /// The bytes are here, but not in use (yet, or any longer).
    Cached,
    /// In use: drawn (base, chunk, texture level) or known (index page).
    Applied,
    /// Will not come: refused or damaged. Neither it nor its children are wanted.
    Failed,
}

/// One wanted blob.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Wanted {
    /// The blob.
    pub id: BlobId,
    /// Higher first; never above a parent's.
    pub priority: Priority,
    /// Length of the whole blob in bytes, where known.
    pub bytes: Option<u32>,
    /// Where it is, as far as it is wanted: absent, in flight or cached. Applied blobs are not listed.
    pub state: State,
    /// Bytes of its beginning that are here.
    pub held: u32,
    /// How many of its bytes suffice; `None` for all.
    pub end: Option<u32>,
    /// The truncation up to which a chunk is to be applied; `None` for the whole chunk.
    pub truncation: Option<u8>,
    /// Screen error of a chunk's own while it is missing, in whole pixels rounded down, at most `u16::MAX`; 0 for other
    /// blobs.
    pub error_px: u16,
}

impl Wanted {
    /// All of a blob of which nothing is here.
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
    /// Chunk entries looked at, once per visible instance.
    pub tested_chunks: u64,
    /// Chunks that the view needs, applied or not.
    pub needed_chunks: u32,
    /// Of these, the ones that are not applied.
    pub missing_chunks: u32,
    /// Payload bytes of the missing ones that are not here either.
    pub missing_bytes: u64,
    /// Payload bytes of the needed ones, up to where they are needed.
    pub needed_bytes: u64,
    /// Of these, those of chunks that the view needs for shadows alone.
    pub shadow_bytes: u64,
    /// Faces of the applied chunks.
    pub applied_faces: u64,
    /// Payload bytes of the applied chunks.
    pub applied_bytes: u64,
    /// Upper bound on the screen error over all visible parts with what is applied now, in pixels;
    /// infinite while a visible instance lacks its base mesh.
    pub max_screen_error_px: f64,
    /// The same over what is seen: without what the scene's own surfaces hide, but for less than a hundredth of a region's
    /// disc.
    pub seen_screen_error_px: f64,
    /// Screen error above which chunks are wanted now: the view's target, or more over budget.
    pub threshold_px: f64,
    /// Whether nothing is wanted: the picture is as sharp as target and budgets allow.
    pub settled: bool,
}

/// What one call finds.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Selection {
    /// Blobs to have, most urgent first; any prefix is closed under parents.
    pub wanted: Vec<Wanted>,
    /// Blobs in flight that no view needs.
    pub cancel: Vec<BlobId>,
    /// Blobs that the view needs and that will not come ([`State::Failed`]): the picture stays coarser for them.
    pub failed: Vec<BlobId>,
    /// Applied chunks that the view does not need, in an order in which they may be undone.
    pub undo: Vec<BlobId>,
    /// What was counted.
    pub counters: Counters,
}
