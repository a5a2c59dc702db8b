//! What a client session tells.

use std::time::Duration;

use bytes::Bytes;

use crate::message::{Close, RefusedReason, Welcome};
use lodestream_scene::blob::BlobId;
use lodestream_scene::description::ScenePage;
use lodestream_scene::punctual_lights::PunctualLights;

/// What happened.
#[derive(Clone, Debug, PartialEq)]
pub enum ClientEvent {
    /// The server has answered. A fingerprint other than before means another scene: start over.
    Connected(Welcome),
    /// A page of the scene description came.
    ScenePage(ScenePage),
    /// The scene has punctual lights; before the first page.
    PunctualLights(PunctualLights),
    /// A blob, or the part of it that was sent, is complete, asked for or not. Told after
    /// [`ClientEvent::Connected`] even where it came before.
    Blob {
        /// The blob.
        id: BlobId,
        /// Where in the blob the bytes begin: 0, or the `held` of what was wanted.
        offset: u32,
        /// Length of the whole blob.
        total: u32,
        /// The bytes.
        bytes: Bytes,
    },
    /// A blob will not come; [`RefusedReason::QueueFull`] means: ask again later.
    Refused {
        /// The blob.
        id: BlobId,
        /// Why.
        reason: RefusedReason,
    },
    /// The server has handed over all visible base meshes.
    BasesSent,
    /// The server has nothing queued.
    Done,
    /// The session has ended; the last event.
    Closed(Close),
}

/// Counters of a session.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ClientStats {
    /// Blob bytes received, duplicates and cancelled ones included.
    pub blob_bytes: u64,
    /// Blobs completed.
    pub blobs: u64,
    /// Bytes asked for that have not arrived.
    pub in_flight_bytes: u64,
    /// Blobs asked for that have not arrived.
    pub in_flight_blobs: usize,
    /// Round trip, once measured.
    pub rtt: Option<Duration>,
    /// Estimated throughput.
    pub bytes_per_s: f64,
}
