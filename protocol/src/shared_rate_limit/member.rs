//! One session's account with a shared_rate_limit: what it was given, sent and saved.

use std::time::Duration;

use super::demand::Demand;
use super::filling::Level;
use crate::limiter::BURST;
use crate::time::Time;

/// Readings of a clock that has gone on by what each unit of weight was given since it began: the virtual time of
/// generalised processor sharing (Parekh and Gallager 1993), in 1/65,536 of a billionth of a bit.
pub(super) type Virtual = u128;

/// Where clocks begin: what a full bucket holds at any level lies behind it.
pub(super) const BEGINNING: Virtual = 1 << 110;

/// What so many bits are at a weight.
pub(super) fn cost(bits: u64, weight: u32) -> Virtual {
    // 2^64 bits are 2^110 units.
    ((u128::from(bits) * 1_000_000_000) << 16) / u128::from(weight.max(1))
}

/// A clock that goes on at a level.
#[derive(Clone, Copy, Debug)]
pub(super) struct Clock {
    reading: Virtual,
    at: Time,
    level: Level,
}

impl Clock {
    pub(super) const fn new(now: Time, level: Level) -> Self {
        Self { reading: BEGINNING, at: now, level }
    }

    pub(super) const fn level(&self) -> Level {
        self.level
    }

    pub(super) fn reading(&self, now: Time) -> Virtual {
        let ns = now.as_ns().saturating_sub(self.at.as_ns());
        self.reading.saturating_add(self.level.saturating_mul(u128::from(ns)))
    }

    /// Goes on at another level from now on.
    pub(super) fn set_level(&mut self, now: Time, level: Level) {
        *self = Self { reading: self.reading(now), at: now, level };
    }

    /// When the clock will read this, if the level stays.
    pub(super) fn time_of(&self, now: Time, reading: Virtual) -> Time {
        let left = reading.saturating_sub(self.reading(now));
        let ns = left.div_ceil(self.level.max(1));
        now + Duration::from_nanos(u64::try_from(ns).unwrap_or(u64::MAX))
    }

    /// The reading at which who has a full bucket would have found it empty.
    fn full(&self, now: Time) -> Virtual {
        self.reading(now).saturating_sub(self.level.saturating_mul(BURST.as_nanos()))
    }
}

/// A place in the lines before gates that were not open, of the group's and that of all.
#[derive(Clone, Copy, Debug)]
pub(super) struct Turn {
    pub(super) at: Time,
    pub(super) before: [bool; 2],
}

/// Who took something and has not asked for more for so long cannot: its link takes nothing.
const BLOCKED: Duration = Duration::from_millis(20);

/// See the module.
#[derive(Clone, Debug)]
pub(super) struct Member {
    pub(super) weight: u32,
    pub(super) group: usize,
    /// There is something to send.
    pub(super) active: bool,
    pub(super) own_bits_per_s: Option<u64>,
    pub(super) demand: Demand,
    /// From which reading of the group's clock on something is admitted: the bucket's level is what the clock is beyond it.
    pub(super) ready: Virtual,
    /// When it may come again to gates that were not open.
    pub(super) turn: Option<Turn>,
    /// It has waited at a gate since it sent last: what overflows is not left by it.
    pub(super) held_up: bool,
    /// When it took something, if it has not asked for more since then.
    pub(super) took_at: Option<Time>,
    /// What was measured of it last.
    settled: (Time, Virtual),
}

impl Member {
    /// With a full bucket, and nothing to send.
    pub(super) fn new(weight: u32, group: usize, clock: &Clock, now: Time) -> Self {
        Self {
            weight,
            group,
            active: false,
            own_bits_per_s: None,
            demand: Demand::default(),
            ready: clock.full(now),
            turn: None,
            held_up: false,
            took_at: None,
            settled: (now, clock.reading(now)),
        }
    }

    /// Whether its link takes nothing now.
    pub(super) fn is_blocked(&self, now: Time) -> bool {
        self.took_at.is_some_and(|at| now.since(at) >= BLOCKED)
    }

    /// Brings bucket and measurement up to now.
    pub(super) fn settle(&mut self, clock: &Clock, now: Time) {
        let (reading, full) = (clock.reading(now), clock.full(now));
        if self.active && !self.is_blocked(now) {
            let (at, before) = self.settled;
            let ns = now.as_ns().saturating_sub(at.as_ns());
            let lost = if self.held_up { 0 } else { full.saturating_sub(self.ready) };
            self.demand.passed(ns, reading.saturating_sub(before), lost);
        }
        self.ready = self.ready.max(full);
        self.settled = (now, reading);
    }

    /// Goes over to another group's clock; what was saved or overdrawn stays, in bits.
    pub(super) fn move_to(&mut self, group: usize, from: &Clock, to: &Clock, now: Time) {
        self.settle(from, now);
        let (old, new) = (from.reading(now), to.reading(now));
        self.ready =
            new.saturating_add(self.ready.saturating_sub(old)).saturating_sub(old.saturating_sub(self.ready));
        self.group = group;
        self.settled = (now, new);
    }

    /// What was saved or overdrawn stays, in bits.
    pub(super) fn set_weight(&mut self, weight: u32, clock: &Clock, now: Time) {
        self.settle(clock, now);
        let scaled = |part: Virtual| part / u128::from(weight.max(1)) * u128::from(self.weight);
        let reading = clock.reading(now);
        let debt = scaled(self.ready.saturating_sub(reading));
        let saved = scaled(reading.saturating_sub(self.ready));
        self.ready = reading.saturating_add(debt).saturating_sub(saved);
        self.weight = weight;
    }

    /// Takes the tokens of so many bits.
    pub(super) fn spend(&mut self, bits: u64, clock: &Clock, now: Time) {
        self.settle(clock, now);
        self.ready = self.ready.saturating_add(cost(bits, self.weight));
        self.turn = None;
        self.held_up = false;
        self.took_at = Some(now);
        self.demand.sent(bits);
    }
}
