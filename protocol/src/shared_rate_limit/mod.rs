//! Sending rates that sessions share: one limit for all, and one for each group of sessions (those of an address).
//!
//! Rates are max-min fair by weight among the sessions that have something to send. What a session cannot use,
//! because of its own rate or its link, goes to the others. `docs/design/session.md` explains the method.
//!
//! | module | contents |
//! |---|---|
//! | `filling` | progressive filling: the level at which weighted claims add up to a capacity |
//! | `member` | one session's token bucket, in virtual time |
//! | `demand` | estimate of what a session can use, where that is less than its share |
//! | `gate` | the token bucket of a limit, and turns for waiting sessions |
//! | `limits` | the limits for all sessions and for each group |
//! | `weight` | a session's weight in the allocation |
//! | `send_request` | a session's demand when it asks to send |
//! | `table` | sessions, groups and gates of a limit |
//!
//! Bounds: in any time T, sessions send at most limit × (T + 20 ms), one piece, and control messages, which are
//! charged but never delayed. Sessions that always have something to send use the whole limit, except that the share
//! of a session that stops is unused for 5 ms plus 1 ms per 200 sessions. A waiting session whose share rises
//! continues at most 25 ms, or 0.1 ms per sending session, later than it could.
//!
//! Cost: each call takes a lock for a short time. Levels are computed in O(n log n) for n sessions, at most every 5
//! ms plus 1 ms per 200 sessions.

mod demand;
mod filling;
mod gate;
mod limits;
mod member;
mod send_request;
mod table;
#[cfg(test)]
mod tests;
mod weight;

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

pub use self::limits::Limits;
pub(crate) use self::send_request::SendRequest;
use self::table::Table;
pub use self::weight::Weight;
use crate::time::Time;

/// A rate that sessions share; see the module for its bounds.
#[derive(Debug)]
pub struct SharedRateLimit(Mutex<Table>);

impl SharedRateLimit {
    /// A shared rate limit without sessions.
    #[must_use]
    pub fn new(limits: Limits) -> Arc<Self> {
        Arc::new(Self(Mutex::new(Table::new(limits))))
    }

    /// Poisoning is ignored: after a panic the levels are stale until they are next computed.
    fn table(&self) -> MutexGuard<'_, Table> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Adds a session with nothing to send. `group` identifies the sessions that share a group's limit; `None` for a
    /// session under the total limit only. `began` is the start of the session's clock, on the shared rate limit's
    /// clock.
    #[must_use]
    pub fn join(self: &Arc<Self>, group: Option<u128>, weight: Weight, began: Time) -> RateShare {
        let member = self.table().join(group, weight, began);
        RateShare { shared_rate_limit: Arc::clone(self), member, group, weight, began }
    }

    /// Changes the limits from `now` on, on the shared rate limit's clock. Sessions that joined while groups had no
    /// limit stay under the total limit only.
    pub fn set_limits(&self, limits: Limits, now: Time) {
        self.table().set_limits(limits, now);
    }

    /// Sum of the rates allocated to the sessions that have something to send, in bits per second; `now` is on the
    /// shared rate limit's clock.
    #[must_use]
    pub fn allocated_bits_per_s(&self, now: Time) -> u64 {
        self.table().allocated_bits_per_s(now)
    }
}

/// One session's share of a [`SharedRateLimit`], returned on drop. Times are on the session's clock.
#[derive(Debug)]
pub struct RateShare {
    shared_rate_limit: Arc<SharedRateLimit>,
    member: usize,
    group: Option<u128>,
    weight: Weight,
    began: Time,
}

impl RateShare {
    fn shared_time(&self, now: Time) -> Time {
        self.began + Duration::from(now)
    }

    /// Moves the session to another group.
    pub(crate) fn move_to(&mut self, now: Time, group: Option<u128>) {
        if self.group != group {
            self.group = group;
            self.shared_rate_limit.table().move_to(self.member, group, self.shared_time(now));
        }
    }

    /// Changes the session's weight.
    pub(crate) fn set_weight(&mut self, now: Time, weight: Weight) {
        if self.weight != weight {
            self.weight = weight;
            self.shared_rate_limit.table().set_weight(self.member, weight, self.shared_time(now));
        }
    }

    /// The moment from which the session may send, or at which it should ask again.
    pub(crate) fn ask(&mut self, now: Time, request: SendRequest) -> Time {
        now + self.shared_rate_limit.table().ask(self.member, request, self.shared_time(now))
    }

    /// Takes the tokens of bytes on the wire.
    pub(crate) fn spend(&mut self, now: Time, wire_bytes: u64) {
        self.shared_rate_limit.table().spend(
            self.member,
            wire_bytes.saturating_mul(8),
            self.shared_time(now),
        );
    }
}

impl Drop for RateShare {
    fn drop(&mut self) {
        self.shared_rate_limit.table().leave(self.member);
    }
}
