//! The cases that goodput is measured for.

use std::num::NonZeroU64;

use lodestream_netsim::link::LinkSettings;

use crate::plan::Transport;

/// A link, and the rate limit that the server applies.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Case {
    /// Transport between client and server.
    pub transport: Transport,
    /// Rate of the link in both directions.
    pub rate_bits_per_s: NonZeroU64,
    /// Round trip without queueing.
    pub rtt_ms: u64,
    /// Queue length of the link.
    pub queue_bytes: u64,
    /// The server's limit as a share of the rate; `None` for no limit.
    pub limiter_share: Option<f64>,
}

impl Case {
    pub(super) fn limiter_bits_per_s(&self) -> Option<u64> {
        self.limiter_share.map(|share| (self.rate_bits_per_s.get() as f64 * share).round() as u64)
    }

    pub(super) fn link(&self) -> LinkSettings {
        LinkSettings::constant(self.rate_bits_per_s, self.rtt_ms * 500_000, self.queue_bytes, 0)
    }

    /// A number of bytes over a time, as a share of the link's capacity.
    pub(super) fn share(&self, bytes: f64, ns: u64) -> f64 {
        let share = bytes * 8.0 / (ns as f64 / 1e9 * self.rate_bits_per_s.get() as f64);
        (share * 1e5).round() / 1e5
    }
}
