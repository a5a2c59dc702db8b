//! Settings that all sessions share.

use std::sync::Arc;
use std::time::Duration;

use lodestream_protocol::shared_rate_limit::{Limits, SharedRateLimit};

use crate::limits::leases::default_per_address;
use crate::limits::session_rate::SessionRateLimit;

/// Default of [`SessionSettings::drain`] in seconds: long enough for transfers under way on a thin link, short enough for
/// an operator at a terminal.
pub const DRAIN_SECONDS: u64 = 3;

/// Settings that all sessions share.
#[derive(Clone, Copy, Debug)]
pub struct SessionSettings {
    /// Limit of each session in bits per second; `None` for no limit.
    pub rate_bits_per_s: Option<u64>,
    /// Limit of all sessions of one address (IPv6: one /64 network) together in bits per second, shared as described in
    /// [`lodestream_protocol::shared_rate_limit`]; `None` for no limit.
    pub rate_per_address_bits_per_s: Option<u64>,
    /// Limit of all sessions together in bits per second, shared in the same way; `None` for no limit.
    pub total_rate_bits_per_s: Option<u64>,
    /// Most sessions at once, at least one; more are refused.
    pub max_sessions: u64,
    /// Most sessions at once of one address (IPv6: one /64 network). `None`: an eighth of
    /// [`SessionSettings::max_sessions`], but at least eight.
    pub max_sessions_per_address: Option<u64>,
    /// Sessions that one such address may start at once; an eighth of them is refilled per second. `None`: as many as it
    /// may have, but at least 32.
    pub new_sessions_per_address: Option<SessionRateLimit>,
    /// Longest time for which sessions finish requests after shutdown has begun.
    pub drain: Duration,
}

impl SessionSettings {
    /// The rate of a session whose token grants `granted_bits_per_s`: the lower of both limits.
    pub(crate) fn capped_rate(&self, granted_bits_per_s: Option<u64>) -> Option<u64> {
        [self.rate_bits_per_s, granted_bits_per_s].into_iter().flatten().min()
    }

    /// Limits per address: most sessions, and the rate at which they may start.
    pub(super) fn address_limits(&self) -> (u64, SessionRateLimit) {
        let max_sessions = self.max_sessions_per_address.unwrap_or(default_per_address(self.max_sessions));
        let session_rate =
            self.new_sessions_per_address.unwrap_or(SessionRateLimit::default_for(max_sessions));
        (max_sessions, session_rate)
    }

    /// The limits that sessions share.
    pub(super) fn limits(&self) -> Limits {
        Limits {
            total_bits_per_s: self.total_rate_bits_per_s,
            group_bits_per_s: self.rate_per_address_bits_per_s,
        }
    }

    /// The shared rate limit; `None` if there are no limits to share.
    pub(super) fn shared_rate_limit(&self) -> Option<Arc<SharedRateLimit>> {
        let limits = self.limits();
        (limits != Limits::default()).then(|| SharedRateLimit::new(limits))
    }
}

impl Default for SessionSettings {
    fn default() -> Self {
        Self {
            rate_bits_per_s: None,
            rate_per_address_bits_per_s: None,
            total_rate_bits_per_s: None,
            max_sessions: 1000,
            max_sessions_per_address: None,
            new_sessions_per_address: None,
            drain: Duration::from_secs(DRAIN_SECONDS),
        }
    }
}
