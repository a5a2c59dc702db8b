//! Counters for overlays, reports and tests.

use std::time::Duration;

use lodestream_protocol::client::ClientStats;
use lodestream_scene::BlobId;
use lodestream_select::Counters;

use super::milestones::Milestones;

/// What the core knows of its connection.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum Connection {
    /// None yet, or lost; with the reason, if there was one.
    #[default]
    None,
    /// Opening: `Hello` is under way.
    Opening,
    /// The server has answered.
    Open,
    /// Ended, with the reason.
    Closed(String),
}

/// What came of one blob, and what of it was of use.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Received {
    /// Payload bytes, as often as they came.
    pub bytes: u64,
    /// Of a chunk: how many of its bytes were ever in use, from its beginning on.
    pub used_bytes: u64,
}

/// Blobs in [`Stats::lacking`], at most.
pub(crate) const MAX_LACKING: usize = 4;

/// Everything countable, as it is now.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Stats {
    /// Name of the scene, once known.
    pub scene: String,
    /// Connection.
    pub connection: Connection,
    /// Bits per second that the server's limiter admits; `None` if unlimited or not known.
    pub rate_bits_per_s: Option<u64>,
    /// Counters of the last selection.
    pub counters: Counters,
    /// Counters of the session, if there is one.
    pub session: ClientStats,
    /// First frame and qualities.
    pub milestones: Milestones,
    /// Transport payload received over all connections, handshakes included.
    pub transport_bytes: u64,
    /// Known assets.
    pub assets: u32,
    /// Known instances.
    pub instances: u32,
    /// Instances of the whole scene.
    pub scene_instances: u32,
    /// Faces drawable now, each asset once.
    pub faces: u64,
    /// Vertices drawable now, each asset once.
    pub vertices: u64,
    /// Chunks applied now.
    pub applied_chunks: u64,
    /// Chunks wanted and not applied.
    pub wanted_chunks: u64,
    /// Texture levels decoded.
    pub texture_levels: u64,
    /// Bytes in the cache.
    pub cached_bytes: u64,
    /// Memory of meshes, in bytes, with what undoing needs.
    pub mesh_bytes: u64,
    /// Chunks undone so far.
    pub undone: u64,
    /// Faces decoded so far, those of base meshes and of what was decoded again included.
    pub decoded_faces: u64,
    /// Blobs that came damaged so far.
    pub decode_failures: u64,
    /// Blobs evicted from the cache so far.
    pub evicted: u64,
    /// Blobs that the server refused so far.
    pub refused: u64,
    /// Selections made so far.
    pub selections: u64,
    /// Connections opened so far.
    pub connections: u64,
    /// Whether the picture is as sharp as target and budgets allow, and nothing is under way or lacking.
    pub settled: bool,
    /// Blobs that the view lacks when all else is here, because they came damaged or are refused; else 0.
    pub lacking_blobs: u64,
    /// The first few of them.
    pub lacking: Vec<BlobId>,
    /// When it first settled, since the connect call.
    pub settled_after: Option<Duration>,
}
