//! Settings and initial state of a client session.

use std::time::Duration;

use crate::message::Token;
use lodestream_scene::blob::BlobId;
use lodestream_scene::description::Fingerprint;
use lodestream_scene::limits::MAX_BLOB_BYTES;

/// Settings of a client session.
#[derive(Clone, Debug)]
pub struct ClientConfig {
    /// Name of the scene; empty for the server's default.
    pub scene: String,
    /// Token that grants access to the scene, for servers that require one.
    pub token: Option<Token>,
    /// Longest blob that the client accepts, in bytes.
    pub max_blob_bytes: u32,
    /// The client's memory for blobs, in bytes.
    pub budget_bytes: u64,
    /// Least bytes kept in flight.
    pub min_in_flight_bytes: u64,
    /// Most bytes kept in flight.
    pub max_in_flight_bytes: u64,
    /// Time within which `Welcome` must arrive.
    pub welcome_timeout: Duration,
    /// Time without a message after which the connection counts as lost.
    pub idle_timeout: Duration,
}

impl Default for ClientConfig {
    fn default() -> Self {
        Self {
            scene: String::new(),
            token: None,
            max_blob_bytes: MAX_BLOB_BYTES,
            budget_bytes: 512 << 20,
            min_in_flight_bytes: 16 * 1024,
            max_in_flight_bytes: 4 << 20,
            welcome_timeout: Duration::from_secs(10),
            idle_timeout: Duration::from_secs(20),
        }
    }
}

/// What a client has from an earlier session.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Resume {
    /// Fingerprint of the scene.
    pub fingerprint: Fingerprint,
    /// Base meshes and index pages in the client's memory ([`lodestream_select::AssetState::held`]). Chunks need not be
    /// listed: the server pushes them only to clients that have nothing.
    pub have: Vec<BlobId>,
}
