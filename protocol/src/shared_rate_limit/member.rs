//! One session's token bucket under a shared rate limit, in virtual time.

use std::time::Duration;

use super::demand::Demand;
use super::filling::Level;
use crate::limiter::BURST;
use crate::time::Time;

/// Virtual time of generalised processor sharing (Parekh and Gallager 1993): what each unit of weight was given since
/// the clock began, in units of 1/65,536 nanobit.
pub(super) type Virtual = u128;

/// First reading of a clock: larger than the capacity of a bucket at any level, so that subtraction does not saturate.
pub(super) const BEGINNING: Virtual = 1 << 110;

/// Virtual time that `bits` cost a session of `weight`.
pub(super) fn cost(bits: u64, weight: u32) -> Virtual {
    // 2^64 bits are 2^110 units.
    ((u128::from(bits) * 1_000_000_000) << 16) / u128::from(weight.max(1))
}

/// A virtual clock that advances at a level.
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

    /// Changes the level from now on.
    pub(super) fn set_level(&mut self, now: Time, level: Level) {
        *self = Self { reading: self.reading(now), at: now, level };
    }

    /// When the clock will show `reading` if the level stays the same.
    pub(super) fn time_of(&self, now: Time, reading: Virtual) -> Time {
        let left = reading.saturating_sub(self.reading(now));
        let ns = left.div_ceil(self.level.max(1));
        now + Duration::from_nanos(u64::try_from(ns).unwrap_or(u64::MAX))
    }

    /// `Member::ready` of a full bucket.
    fn full(&self, now: Time) -> Virtual {
        self.reading(now).saturating_sub(self.level.saturating_mul(BURST.as_nanos()))
    }
}

/// A turn at the gates that were not open.
#[derive(Clone, Copy, Debug)]
pub(super) struct Turn {
    pub(super) at: Time,
    /// Whether a turn is reserved at the group's gate and at the total's.
    pub(super) reserved: [bool; 2],
}

/// A session that sent something and has not asked for more after this time is blocked: its link accepts nothing.
const BLOCKED_AFTER: Duration = Duration::from_millis(20);

/// The account of one session.
#[derive(Clone, Debug)]
pub(super) struct Member {
    pub(super) weight: u32,
    pub(super) group: usize,
    /// Whether there is something to send.
    pub(super) active: bool,
    pub(super) own_bits_per_s: Option<u64>,
    pub(super) demand: Demand,
    /// Reading of the group's clock from which something is admitted. The bucket holds what the clock shows beyond it.
    pub(super) ready: Virtual,
    /// The reserved turn at gates that were not open.
    pub(super) turn: Option<Turn>,
    /// Whether it has waited at a gate since it last sent; then its overflow does not count as unused.
    pub(super) waited: bool,
    /// When it last sent something, if it has not asked for more since.
    pub(super) sent_at: Option<Time>,
    /// Time and clock reading of the last call of `settle`.
    settled: (Time, Virtual),
}

impl Member {
    /// A session with a full bucket and nothing to send.
    pub(super) fn new(weight: u32, group: usize, clock: &Clock, now: Time) -> Self {
        Self {
            weight,
            group,
            active: false,
            own_bits_per_s: None,
            demand: Demand::default(),
            ready: clock.full(now),
            turn: None,
            waited: false,
            sent_at: None,
            settled: (now, clock.reading(now)),
        }
    }

    /// Whether its link accepts nothing at present.
    pub(super) fn is_blocked(&self, now: Time) -> bool {
        self.sent_at.is_some_and(|at| now.since(at) >= BLOCKED_AFTER)
    }

    /// Updates bucket and measurement to `now`.
    pub(super) fn settle(&mut self, clock: &Clock, now: Time) {
        let (reading, full) = (clock.reading(now), clock.full(now));
        if self.active && !self.is_blocked(now) {
            let (at, before) = self.settled;
            let ns = now.as_ns().saturating_sub(at.as_ns());
            let lost = if self.waited { 0 } else { full.saturating_sub(self.ready) };
            self.demand.add_interval(ns, reading.saturating_sub(before), lost);
        }
        self.ready = self.ready.max(full);
        self.settled = (now, reading);
    }

    /// Moves to another group's clock. Saved tokens and debt keep their value in bits.
    pub(super) fn move_to(&mut self, group: usize, from: &Clock, to: &Clock, now: Time) {
        self.settle(from, now);
        let (old, new) = (from.reading(now), to.reading(now));
        self.ready =
            new.saturating_add(self.ready.saturating_sub(old)).saturating_sub(old.saturating_sub(self.ready));
        self.group = group;
        self.settled = (now, new);
    }

    /// Changes the weight. Saved tokens and debt keep their value in bits.
    pub(super) fn set_weight(&mut self, weight: u32, clock: &Clock, now: Time) {
        self.settle(clock, now);
        let scaled = |part: Virtual| part / u128::from(weight.max(1)) * u128::from(self.weight);
        let reading = clock.reading(now);
        let debt = scaled(self.ready.saturating_sub(reading));
        let saved = scaled(reading.saturating_sub(self.ready));
        self.ready = reading.saturating_add(debt).saturating_sub(saved);
        self.weight = weight;
    }

    /// Takes the tokens of `bits`, if necessary on credit.
    pub(super) fn spend(&mut self, bits: u64, clock: &Clock, now: Time) {
        self.settle(clock, now);
        self.ready = self.ready.saturating_add(cost(bits, self.weight));
        self.turn = None;
        self.waited = false;
        self.sent_at = Some(now);
        self.demand.add_sent(bits);
    }
}
