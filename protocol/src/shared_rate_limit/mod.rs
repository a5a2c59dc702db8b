//! Ceilings that sessions share: of all, and of each group of sessions that count as one (those of an address).
//!
//! Who has something to send is given what is max-min fair by weight: what one leaves, because of its own rate or its link,
//! goes to the others, and no bit is left over while somebody could use it. The idea is told in `docs/design/session.md`.
//!
//! | module | idea |
//! |---|---|
//! | `filling` | the level at which weighted claims come to a capacity |
//! | `member` | one session's bucket, in virtual time |
//! | `demand` | what a session can use, where that is less than its part |
//! | `gate` | the bucket of a shared rate limit, and the line before it |
//! | `table` | all of it together |
//!
//! Over any time T sessions send at most the shared rate limit × (T + 20 ms), one piece, and control messages, which are charged and
//! never held back. Sessions that always have something to send come to the shared rate limit, less what was that of one which stops
//! for 5 ms (and a millisecond for every 200 sessions). A session that waits goes on at most 25 ms (or 0.1 ms for each
//! session that sends) after it could, where its part has risen. Each call takes a lock for a short time; finding the
//! levels is O(n log n) for n sessions, at most every 5 ms and a millisecond for every 200 sessions.

mod demand;
mod filling;
mod gate;
mod member;
mod table;
#[cfg(test)]
mod tests;

use std::num::NonZeroU8;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use self::table::Table;
use crate::time::Time;

/// What may be sent in all, as [`crate::limiter`] counts: bits per second on the wire.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Limits {
    /// By all sessions; `None` for no limit.
    pub total_bits_per_s: Option<u64>,
    /// By the sessions of each group; `None` for no limit.
    pub group_bits_per_s: Option<u64>,
}

/// How much a session counts beside others: 1 to 100, by default 1. One of weight 5 is given five times as much as one of
/// weight 1 where both could use more.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Weight(NonZeroU8);

impl Weight {
    /// The least, and that of who says nothing.
    pub const ONE: Self = Self(NonZeroU8::MIN);
    /// The most.
    pub const MAX: u8 = 100;

    /// A weight; `None` for 0, and beyond 100.
    #[must_use]
    pub fn new(weight: u64) -> Option<Self> {
        let weight = u8::try_from(weight).ok().filter(|weight| *weight <= Self::MAX)?;
        NonZeroU8::new(weight).map(Self)
    }

    /// The number.
    #[must_use]
    pub fn get(self) -> u32 {
        u32::from(self.0.get())
    }
}

impl Default for Weight {
    fn default() -> Self {
        Self::ONE
    }
}

/// What a session would do.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct SendRequest {
    /// It has something to send.
    pub(crate) active: bool,
    /// Its own rate; `None` for no limit.
    pub(crate) own_bits_per_s: Option<u64>,
    /// Its own rate admits something now.
    pub(crate) own_ready: bool,
}

/// See the module.
#[derive(Debug)]
pub struct SharedRateLimit(Mutex<Table>);

impl SharedRateLimit {
    /// A shared rate limit that nobody shares yet.
    #[must_use]
    pub fn new(limits: Limits) -> Arc<Self> {
        Arc::new(Self(Mutex::new(Table::new(limits))))
    }

    /// A thread that panicked while it held the lock left levels that hold until they are found anew.
    fn table(&self) -> MutexGuard<'_, Table> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// A session's part in it, with nothing to send at first. `group` is a number of what counts as one, `None` for who is
    /// bounded by the shared rate limit of all alone; `began` is when, by the shared rate limit's clock, the session's began.
    #[must_use]
    pub fn join(self: &Arc<Self>, group: Option<u128>, weight: Weight, began: Time) -> RateShare {
        let member = self.table().join(group, weight, began);
        RateShare { shared_rate_limit: Arc::clone(self), member, group, weight, began }
    }

    /// Holds all who share it to other limits from `now` on, which is the shared rate limit's. Sessions that joined while groups had no
    /// limit stay bounded by the shared rate limit of all alone.
    pub fn set_limits(&self, limits: Limits, now: Time) {
        self.table().set_limits(limits, now);
    }

    /// What the sessions that have something to send are given together, as far as they can use it, in bits per second;
    /// `now` is the shared rate limit's.
    #[must_use]
    pub fn given_bits_per_s(&self, now: Time) -> u64 {
        self.table().given_bits_per_s(now)
    }
}

/// One session's part in a [`SharedRateLimit`]; given back when dropped. Times are the session's.
#[derive(Debug)]
pub struct RateShare {
    shared_rate_limit: Arc<SharedRateLimit>,
    member: usize,
    group: Option<u128>,
    weight: Weight,
    began: Time,
}

impl RateShare {
    fn of_shared_rate_limit(&self, now: Time) -> Time {
        self.began + Duration::from(now)
    }

    /// The session belongs to this group now.
    pub(crate) fn move_to(&mut self, now: Time, group: Option<u128>) {
        if self.group != group {
            self.group = group;
            self.shared_rate_limit.table().move_to(self.member, group, self.of_shared_rate_limit(now));
        }
    }

    /// The session has this weight now.
    pub(crate) fn set_weight(&mut self, now: Time, weight: Weight) {
        if self.weight != weight {
            self.weight = weight;
            self.shared_rate_limit.table().set_weight(self.member, weight, self.of_shared_rate_limit(now));
        }
    }

    /// From when on something is admitted: now, or a moment at which to ask again.
    pub(crate) fn ask(&mut self, now: Time, wish: SendRequest) -> Time {
        now + self.shared_rate_limit.table().ask(self.member, wish, self.of_shared_rate_limit(now))
    }

    /// Takes the tokens of so many bytes on the wire.
    pub(crate) fn spend(&mut self, now: Time, wire_bytes: u64) {
        self.shared_rate_limit.table().spend(
            self.member,
            wire_bytes.saturating_mul(8),
            self.of_shared_rate_limit(now),
        );
    }
}

impl Drop for RateShare {
    fn drop(&mut self) {
        self.shared_rate_limit.table().leave(self.member);
    }
}
