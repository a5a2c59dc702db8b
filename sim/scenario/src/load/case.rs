//! The cases that a server's load is measured for.

use std::time::Duration;

use lodestream_protocol::server::ServerConfig;

use crate::plan::Transport;

/// A number of clients under a rate limit each.
#[derive(Clone, Copy, Debug)]
pub struct Case {
    /// Transport between clients and server.
    pub transport: Transport,
    /// Number of simultaneous clients.
    pub clients: u32,
    /// Rate limit of each session.
    pub rate_bits_per_s: u64,
    /// Length of the measured window.
    pub seconds: u32,
}

impl Case {
    pub(super) fn window(&self) -> Duration {
        Duration::from_secs(u64::from(self.seconds))
    }

    /// Bytes that the rate limit admits to a client within the window.
    pub(super) fn allowed_bytes(&self) -> f64 {
        self.rate_bits_per_s as f64 / 8.0 * self.window().as_secs_f64()
    }

    /// Share of these bytes that can be payload of blobs: the rate limit counts headers too.
    pub(super) fn blob_share(&self) -> f64 {
        let config = match self.transport {
            Transport::Quic => ServerConfig::quic(None),
            Transport::Ws => ServerConfig::websocket(None),
        };
        f64::from(config.piece_bytes) / config.limiter.wire_bytes(config.piece_bytes as usize) as f64
    }
}
