//! Counters for overlays, reports and tests.

use std::time::Duration;

use lodestream_protocol::client::ClientStats;
use lodestream_scene::BlobId;
use lodestream_select::Counters;

use super::milestones::Milestones;

/// State of the connection.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum Connection {
    /// No session.
    #[default]
    None,
    /// `Hello` is sent, and the server has not answered.
    Opening,
    /// The server has answered.
    Open,
    /// Ended, with the reason.
    Closed(String),
}

/// Received and used bytes of one blob.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Received {
    /// Payload bytes received, repetitions included.
    pub bytes: u64,
    /// For a chunk: the most leading bytes that were ever applied.
    pub used_bytes: u64,
}

/// Most blobs in [`Stats::lacking`].
pub(crate) const MAX_LACKING: usize = 4;

/// Counters and state of the client.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Stats {
    /// Name of the scene; empty until known.
    pub scene: String,
    /// State of the connection.
    pub connection: Connection,
    /// The server's rate limit in bits per second; `None` if unlimited or not known.
    pub rate_bits_per_s: Option<u64>,
    /// Counters of the last selection.
    pub counters: Counters,
    /// Counters of the session, if there is one.
    pub session: ClientStats,
    /// Range requests over all sessions with a published scene.
    pub requests: u64,
    /// Times of the first frame and of each quality.
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
    /// Faces decoded so far, including base meshes and repeated decoding.
    pub decoded_faces: u64,
    /// Damaged blobs so far.
    pub decode_failures: u64,
    /// Blobs evicted from the cache so far.
    pub evicted: u64,
    /// Blobs that the server refused so far.
    pub refused: u64,
    /// Selections made so far.
    pub selections: u64,
    /// Connections opened so far.
    pub connections: u64,
    /// Whether the picture is as sharp as target and budgets allow, and no blob is pending or missing.
    pub settled: bool,
    /// Number of blobs that the view needs and that stay missing because they are damaged or refused; 0 while others
    /// are pending.
    pub lacking_blobs: u64,
    /// The first few of these blobs.
    pub lacking: Vec<BlobId>,
    /// Time from the connect call until it first settled.
    pub settled_after: Option<Duration>,
}
