//! Settings that all sessions share.

use std::sync::Arc;
use std::time::Duration;

use lodestream_protocol::shared_rate_limit::{Limits, SharedRateLimit};

use crate::admission::leases::default_per_address;
use crate::admission::session_rate::SessionRateLimit;

/// How long sessions may go on after shutdown has begun, by default, in seconds: what is under way on a thin link comes
/// to its end, and whoever stops a server by hand does not wait.
pub const DRAIN_SECONDS: u64 = 3;

/// Settings that all sessions share.
#[derive(Clone, Copy, Debug)]
pub struct SessionSettings {
    /// Limit of each session in bits per second; `None` for no limit.
    pub rate_bits_per_s: Option<u64>,
    /// Limit of all sessions together of one address (of IPv6: of one network of 64 bits) in bits per second, shared as
    /// [`lodestream_protocol::shared_rate_limit`] tells; `None` for no limit.
    pub rate_per_address_bits_per_s: Option<u64>,
    /// Limit of all sessions together in bits per second, shared likewise; `None` for no limit.
    pub total_rate_bits_per_s: Option<u64>,
    /// Most sessions at once, at least one; more are refused.
    pub max_sessions: u64,
    /// Most sessions at once of one address (of IPv6: of one network of 64 bits). `None`: an eighth of
    /// [`SessionSettings::max_sessions`], and at least eight.
    pub max_sessions_per_address: Option<u64>,
    /// Sessions that one such address may begin at once; an eighth of that is given back each second. `None`: as many as
    /// it may have, and at least 32.
    pub new_sessions_per_address: Option<SessionRateLimit>,
    /// How long sessions may go on with what they were asked for after shutdown has begun.
    pub drain: Duration,
}

impl SessionSettings {
    /// The rate of a session whose token says this of it.
    pub(crate) fn capped_rate(&self, granted_bits_per_s: Option<u64>) -> Option<u64> {
        [self.rate_bits_per_s, granted_bits_per_s].into_iter().flatten().min()
    }

    /// Most sessions of one address, and how many it may begin.
    pub(super) fn of_address(&self) -> (u64, SessionRateLimit) {
        let of_address = self.max_sessions_per_address.unwrap_or(default_per_address(self.max_sessions));
        (of_address, self.new_sessions_per_address.unwrap_or(SessionRateLimit::of_places(of_address)))
    }

    pub(super) fn limits(&self) -> Limits {
        Limits {
            total_bits_per_s: self.total_rate_bits_per_s,
            group_bits_per_s: self.rate_per_address_bits_per_s,
        }
    }

    /// What sessions share, if anything.
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
