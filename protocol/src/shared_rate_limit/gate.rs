//! The token bucket of a rate that many sessions share, and the queue of the sessions that found it empty.
//!
//! A session that must wait is given a turn: a moment of its own to ask again. Turns follow each other at the
//! bucket's rate, so that the waiting sessions do not all wake for the one piece that fits, and later arrivals do not
//! overtake them.

use std::time::Duration;

use crate::limiter::{BURST, TokenBucket};
use crate::time::Time;

/// Turns are spaced by the mean cost of a piece less 1/16: a session that comes a little early waits for the bucket,
/// while wider spacing would leave some of the rate unused.
const EARLY: u64 = 16;
/// Weight of a new piece in the moving mean of the cost: 1/8.
const MEAN_OF: u64 = 8;

/// A token bucket with turns for waiting sessions.
#[derive(Clone, Debug)]
pub(super) struct Gate {
    bucket: TokenBucket,
    /// The next moment that no session has as its turn.
    next_turn: Time,
    /// Moving mean of the time that a piece costs.
    mean_cost_ns: u64,
}

impl Gate {
    /// With a full bucket.
    pub(super) const fn new(rate_bits_per_s: u64) -> Self {
        let bucket = TokenBucket::new(Some(rate_bits_per_s), BURST);
        Self { bucket, next_turn: Time::ZERO, mean_cost_ns: 0 }
    }

    /// The first moment at which the bucket is not overdrawn.
    pub(super) fn ready_at(&self) -> Time {
        self.bucket.ready_at()
    }

    /// Whether the bucket is full.
    pub(super) fn is_full(&self, now: Time) -> bool {
        self.bucket.is_full(now)
    }

    /// Whether a session without a turn may send now: the bucket admits it and no turn is outstanding.
    pub(super) fn is_open(&self, now: Time) -> bool {
        self.is_full(now) || (self.ready_at() <= now && self.next_turn <= now)
    }

    fn turn_spacing(&self) -> Duration {
        Duration::from_nanos(self.mean_cost_ns - self.mean_cost_ns / EARLY)
    }

    /// Reserves the next turn.
    pub(super) fn reserve_turn(&mut self, now: Time) -> Time {
        let turn = self.next_turn.max(self.ready_at()).max(now);
        self.next_turn = turn + self.turn_spacing();
        turn
    }

    /// Gives back a turn that was reserved and not used.
    pub(super) fn cancel_turn(&mut self) {
        self.next_turn = self.next_turn - self.turn_spacing();
    }

    /// Changes the rate from now on. All turns must have been cancelled.
    pub(super) fn set_rate(&mut self, rate_bits_per_s: u64, now: Time) {
        self.bucket.set_rate(now, Some(rate_bits_per_s));
        self.mean_cost_ns = 0;
        self.next_turn = now;
    }

    /// Takes the tokens of `bits`, if necessary on credit.
    pub(super) fn spend(&mut self, now: Time, bits: u64) {
        let cost = u64::try_from(self.bucket.take(now, bits).as_nanos()).unwrap_or(u64::MAX);
        self.mean_cost_ns = match self.mean_cost_ns {
            0 => cost,
            mean => mean - mean / MEAN_OF + cost / MEAN_OF,
        };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn waiting_sessions_take_turns_before_later_arrivals() {
        let mut gate = Gate::new(8_000_000);
        let at = |us: u64| Time::from_ns(1_000_000_000 + us * 1000);
        // A burst of 20 ms, in pieces of 1 ms.
        let passed = (0..).take_while(|_| {
            gate.is_open(at(0)) && {
                gate.spend(at(0), 8000);
                true
            }
        });
        assert_eq!(passed.count(), 21);
        let turns: Vec<_> = (0..4).map(|_| gate.reserve_turn(at(0)).since(at(0)).as_micros()).collect();
        assert!(turns.is_sorted_by(|a, b| *b - *a >= 900 && *b - *a <= 1000), "{turns:?}");
        assert!(!gate.is_open(at(1500)), "the bucket admits a piece, but others wait for it");
        assert!(gate.ready_at() <= at(1500));
        // One of the four cancels its turn, which goes to the next.
        gate.cancel_turn();
        assert_eq!(gate.reserve_turn(at(0)).since(at(0)).as_micros(), turns[3]);
        // The waiting sessions never came.
        assert!(gate.is_open(at(21_000)));
    }

    #[test]
    fn extremes_do_not_overflow() {
        for rate in [0, 1, u64::MAX] {
            let mut gate = Gate::new(rate);
            for _ in 0..3 {
                gate.spend(Time::from_ms(1), u64::MAX);
                let _ =
                    (gate.reserve_turn(Time::from_ms(1)), gate.ready_at(), gate.is_open(Time::from_ms(2)));
            }
        }
    }
}
