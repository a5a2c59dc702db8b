//! Events and counters of a client session.

use std::time::Duration;

use bytes::Bytes;

use crate::message::{Close, RefusedReason, Welcome};
use lodestream_scene::animation::AnimationTable;
use lodestream_scene::blob::BlobId;
use lodestream_scene::description::ScenePage;
use lodestream_scene::parts::PartTable;
use lodestream_scene::punctual_lights::PunctualLights;

/// An event of a client session.
#[derive(Clone, Debug, PartialEq)]
pub enum ClientEvent {
    /// `Welcome` has arrived. A changed fingerprint means another scene: discard all blobs.
    Connected(Welcome),
    /// A page of the scene description has arrived.
    ScenePage(ScenePage),
    /// The scene has punctual lights; comes before the first page.
    PunctualLights(PunctualLights),
    /// The scene has a table of what its parts are called; comes before the first page.
    Parts(PartTable),
    /// The scene has animated models; comes before the first page.
    Animations(AnimationTable),
    /// A blob or a part of one, requested or pushed, is complete. Comes after [`ClientEvent::Connected`] even if the
    /// bytes arrived earlier.
    Blob {
        /// The blob.
        id: BlobId,
        /// Where in the blob the bytes begin: 0, or the request's `held`.
        offset: u32,
        /// Length of the whole blob.
        total: u32,
        /// The bytes.
        bytes: Bytes,
    },
    /// The server refused a blob; after [`RefusedReason::QueueFull`], request it again later.
    Refused {
        /// The blob.
        id: BlobId,
        /// Why.
        reason: RefusedReason,
    },
    /// The server has sent all visible base meshes.
    BasesSent,
    /// The server has nothing queued.
    Done,
    /// The session has ended. This is the last event.
    Closed(Close),
}

/// Counters of a session.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ClientStats {
    /// Blob bytes received, with duplicates and cancelled ones.
    pub blob_bytes: u64,
    /// Blobs completed.
    pub blobs: u64,
    /// Requested bytes that have not arrived.
    pub in_flight_bytes: u64,
    /// Requested blobs that have not arrived.
    pub in_flight_blobs: usize,
    /// Round-trip time, once measured.
    pub rtt: Option<Duration>,
    /// Estimated throughput.
    pub bytes_per_s: f64,
}
