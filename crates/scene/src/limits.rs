//! Bounds on all lengths and counts that a peer may send. Larger ones are refused with a reason.

pub use lodestream_geometry::base::{MAX_CHUNKS, MAX_DESCRIPTION_BYTES};

/// Longest body of a control message, in bytes.
pub const MAX_MESSAGE_BYTES: usize = 64 * 1024;
/// Most memory that decoding one control message may reserve, in bytes.
pub const MAX_DECODED_BYTES: usize = 256 * 1024;
/// Most blob bytes in one frame.
pub const MAX_PIECE_BYTES: usize = 16 * 1024;
/// Longest frame: tag, length and body.
pub const MAX_FRAME_BYTES: usize = MAX_MESSAGE_BYTES + 8;
/// Longest blob, in bytes.
pub const MAX_BLOB_BYTES: u32 = 64 * 1024 * 1024;
/// Most entries of a `Want` and of a `RefusedMany`, and ids of a `Cancel`.
pub const MAX_IDS_PER_MESSAGE: usize = 1024;
/// Most blobs that a server queues for a client, unless configured otherwise: 256 KiB of memory at most.
pub const MAX_QUEUED: usize = 2048;
/// Most ids that a `Hello` may list as already held.
pub const MAX_HAVE: usize = 4096;
/// Most pages that one `WantScenePages` may name.
pub const MAX_PAGES_PER_MESSAGE: usize = 256;
/// Most asset entries and most instance entries of one scene page.
pub const MAX_ENTRIES_PER_PAGE: usize = 64;
/// Longest name of a scene or asset, in bytes of UTF-8.
pub const MAX_NAME_BYTES: usize = 255;
/// Longest token, in bytes of UTF-8.
pub const MAX_TOKEN_BYTES: usize = 8192;
/// Longest reason text of a `Close`, in bytes of UTF-8.
pub const MAX_REASON_BYTES: usize = 255;
/// Most assets of a scene.
pub const MAX_ASSETS: u32 = 1 << 20;
/// Most instances of a scene.
pub const MAX_INSTANCES: u32 = 1 << 24;
/// Most pages of a scene description.
pub const MAX_SCENE_PAGES: u32 = 1 << 20;
/// Largest width or height of a viewport, in pixels.
pub const MAX_VIEWPORT_PX: u32 = 65_535;
