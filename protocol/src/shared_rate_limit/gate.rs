//! A bound on a sum: a token bucket for many, and the line of those who found it empty.
//!
//! The bucket is kept as in [`crate::limiter`], as the moment at which it is full again. Who is refused is told a moment of
//! his own to come again, one after the other at the bucket's rate, so that those who wait do not all wake for the one
//! piece that fits, and nobody who came later passes before them.

use std::time::Duration;

use crate::limiter::BURST;
use crate::time::Time;

/// Moments in the line are apart by what pieces cost lately, less one part in so many: who comes a little early waits for
/// the bucket, while a line that is too slow would leave some of the rate unused.
const EARLY: u64 = 16;
/// The mean cost follows each piece by one part in so many.
const MEAN_OF: u64 = 8;

/// See the module.
#[derive(Clone, Debug)]
pub(super) struct Gate {
    rate_bits_per_s: u64,
    full_at: Time,
    /// The next moment that nobody was told.
    line_ends: Time,
    /// Nanoseconds that a piece costs.
    mean_cost_ns: u64,
}

impl Gate {
    /// A full bucket.
    pub(super) const fn new(rate_bits_per_s: u64) -> Self {
        Self { rate_bits_per_s, full_at: Time::ZERO, line_ends: Time::ZERO, mean_cost_ns: 0 }
    }

    /// From when on something passes.
    pub(super) fn ready_at(&self) -> Time {
        self.full_at - BURST
    }

    /// Whether the bucket is full: nobody has taken of it lately.
    pub(super) fn is_full(&self, now: Time) -> bool {
        self.full_at <= now
    }

    /// Whether who did not wait passes now: nobody waits, or those who did have gone.
    pub(super) fn is_open(&self, now: Time) -> bool {
        self.is_full(now) || (self.ready_at() <= now && self.line_ends <= now)
    }

    fn apart(&self) -> Duration {
        Duration::from_nanos(self.mean_cost_ns - self.mean_cost_ns / EARLY)
    }

    /// Takes the next moment in the line.
    pub(super) fn line_up(&mut self, now: Time) -> Time {
        let turn = self.line_ends.max(self.ready_at()).max(now);
        self.line_ends = turn + self.apart();
        turn
    }

    /// One of those in the line has gone before its turn.
    pub(super) fn step_out(&mut self) {
        self.line_ends = self.line_ends - self.apart();
    }

    /// Fills at another rate from now on. Nobody may stand in line.
    pub(super) fn set_rate(&mut self, rate_bits_per_s: u64, now: Time) {
        self.rate_bits_per_s = rate_bits_per_s;
        // What pieces cost is learnt anew; what was overdrawn is paid in time, as it was.
        self.mean_cost_ns = 0;
        self.line_ends = now;
    }

    /// Takes the tokens of so many bits; the bucket may be overdrawn.
    pub(super) fn spend(&mut self, now: Time, bits: u64) {
        let cost = u128::from(bits) * 1_000_000_000 / u128::from(self.rate_bits_per_s.max(1));
        let cost = u64::try_from(cost).unwrap_or(u64::MAX);
        self.full_at = self.full_at.max(now) + Duration::from_nanos(cost);
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
    fn who_is_refused_comes_again_one_after_the_other_and_before_who_comes_later() {
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
        let turns: Vec<_> = (0..4).map(|_| gate.line_up(at(0)).since(at(0)).as_micros()).collect();
        assert!(turns.is_sorted_by(|a, b| *b - *a >= 900 && *b - *a <= 1000), "{turns:?}");
        assert!(!gate.is_open(at(1500)), "the bucket admits one, and others wait for it");
        assert!(gate.ready_at() <= at(1500));
        // One of the four has gone: the next is there in its place.
        gate.step_out();
        assert_eq!(gate.line_up(at(0)).since(at(0)).as_micros(), turns[3]);
        // Those who waited never came.
        assert!(gate.is_open(at(21_000)));
    }

    #[test]
    fn extremes_overflow_nothing() {
        for rate in [0, 1, u64::MAX] {
            let mut gate = Gate::new(rate);
            for _ in 0..3 {
                gate.spend(Time::from_ms(1), u64::MAX);
                let _ = (gate.line_up(Time::from_ms(1)), gate.ready_at(), gate.is_open(Time::from_ms(2)));
            }
        }
    }
}
