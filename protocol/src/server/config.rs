//! Settings of a server session.

use std::time::Duration;

use crate::limiter::LimiterConfig;
use lodestream_scene::limits::MAX_QUEUED;

/// Settings of a server session.
#[derive(Clone, Debug)]
pub struct ServerConfig {
    /// Sending rate and burst.
    pub limiter: LimiterConfig,
    /// Most bytes of blobs and scene pages pushed before `Hello` arrives. On QUIC about 2.3 KB of base meshes fit
    /// before address validation (three times the client's first packet, less the handshake); more would only queue,
    /// for a view that may change. Unlimited on WebSocket.
    pub push_before_hello_bytes: u64,
    /// Most bytes in all up to which refinement of the start view follows the base meshes before `Hello` arrives:
    /// what the transport sends in a round trip. More would be in the socket when `Hello` brings another view. 0 on
    /// QUIC: before address validation, refinement would share packets with the base meshes and delay them, and
    /// untrusted peers could make the server run the selection.
    pub refine_before_hello_bytes: u64,
    /// Most bytes of index pages and first chunks pushed after the base meshes, so that refinement does not wait for
    /// a round trip. More covers longer round trips, but bytes that the client would not have requested are wasted.
    pub push_after_hello_bytes: u64,
    /// Most bytes of a blob handed over at once. Small pieces let urgent blobs overtake; each costs a
    /// frame's overhead.
    pub piece_bytes: u32,
    /// Most queued units, at least one; further requests are refused, pages and pushed units wait. A unit takes up to
    /// 128 bytes of memory.
    pub max_queued: usize,
    /// Time within which `Hello` must arrive.
    pub hello_timeout: Duration,
    /// Time without a message after which the session is closed.
    pub idle_timeout: Duration,
    /// Time after which the session is closed if there is something to send and the transport accepts nothing.
    pub stall_timeout: Duration,
    /// Size of the picture assumed before `Hello`, in pixels.
    pub start_viewport_px: [u32; 2],
}

impl ServerConfig {
    /// Defaults for QUIC at a rate in bits per second (`None`: no limit).
    #[must_use]
    pub const fn quic(rate_bits_per_s: Option<u64>) -> Self {
        Self {
            limiter: LimiterConfig::quic(rate_bits_per_s),
            push_before_hello_bytes: 3000,
            refine_before_hello_bytes: 0,
            push_after_hello_bytes: first_refinement_bytes(rate_bits_per_s),
            piece_bytes: 1200,
            max_queued: MAX_QUEUED,
            hello_timeout: Duration::from_secs(10),
            idle_timeout: Duration::from_secs(30),
            stall_timeout: Duration::from_secs(30),
            start_viewport_px: [1280, 720],
        }
    }

    /// Defaults for WebSocket at a rate in bits per second (`None`: no limit).
    #[must_use]
    pub const fn websocket(rate_bits_per_s: Option<u64>) -> Self {
        Self {
            limiter: LimiterConfig::websocket(rate_bits_per_s),
            push_before_hello_bytes: u64::MAX,
            // TCP's first window (RFC 6928: 14,600 bytes), less the upgrade's answer, `Welcome` and frames.
            refine_before_hello_bytes: 14_000,
            // Two TCP segments: 6 % less overhead in heads than one, 11 ms at 2 Mbit/s.
            piece_bytes: 2800,
            ..Self::quic(rate_bits_per_s)
        }
    }
}

impl ServerConfig {
    /// The same without a push before `Hello`: for a client that has something of the scene.
    #[must_use]
    pub fn resumed(&self) -> Self {
        Self { push_before_hello_bytes: 0, refine_before_hello_bytes: 0, ..self.clone() }
    }
}

/// What a limiter admits in 100 ms, a common round trip with some slack; at least 64 KiB, which costs slow links little
/// because the client would request the same chunks.
const fn first_refinement_bytes(rate_bits_per_s: Option<u64>) -> u64 {
    const LEAST: u64 = 64 * 1024;
    const MOST: u64 = 256 * 1024;
    match rate_bits_per_s {
        Some(rate) if rate / 80 < LEAST => LEAST,
        Some(rate) if rate / 80 < MOST => rate / 80,
        _ => MOST,
    }
}
