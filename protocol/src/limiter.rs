//! Token bucket: how fast a session may send.

use std::time::Duration;

/// What the limiter admits, and how it counts bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LimiterConfig {
    /// Bits per second on the wire; `None` for no limit.
    pub rate_bits_per_s: Option<u64>,
    /// How much may be sent at once after a pause, as time at the full rate. Longer bursts waste less
    /// of the link when timers are late, shorter ones queue less in the network.
    pub burst: Duration,
    /// Payload bytes that a packet carries, for counting headers.
    pub packet_payload_bytes: u32,
    /// Bytes that each packet costs beside its payload (IP, UDP or TCP, QUIC or TLS headers).
    pub packet_overhead_bytes: u32,
    /// Bytes that each frame or stream costs beside its payload.
    pub frame_overhead_bytes: u32,
}
