//! Settings of a client session, and what it begins with.

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
    /// What shows that the client may see it, for servers that ask.
    pub token: Option<Token>,
    /// Longest blob taken, in bytes.
    pub max_blob_bytes: u32,
    /// Bytes that the client can hold in all.
    pub budget_bytes: u64,
    /// Least bytes kept in flight.
    pub min_in_flight_bytes: u64,
    /// Most bytes kept in flight.
    pub max_in_flight_bytes: u64,
    /// Time in which `Welcome` must come.
    pub welcome_timeout: Duration,
    /// Silence after which the connection counts as lost.
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

/// What a client keeps from one session to the next.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Resume {
    /// Fingerprint of the scene.
    pub fingerprint: Fingerprint,
    /// Base meshes and index pages that are still here ([`lodestream_select::AssetState::held`]). Chunks need
    /// not be listed: the server sends them unasked only to clients that hold nothing.
    pub have: Vec<BlobId>,
}
