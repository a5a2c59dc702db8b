//! Estimate of the rate that a session can use, where that is less than its share: its link is slow or its client
//! requests little.
//!
//! A session whose bucket overflows while it has something to send is limited by something else. The overflow and the
//! bits sent are measured over half a second at a time. The estimate only decides what other sessions may have; the
//! session itself may use its whole share at any time.

use super::filling::{Level, level_of};

/// Length of a measurement, in nanoseconds during which there was something to send.
const WINDOW_NS: u64 = 500_000_000;
/// A session that leaves less than 1/8 of its share counts as using all of it.
const MIN_LOST_DIVISOR: u128 = 8;
/// Margin of the estimate above the measured rate: 1/32. More would be left unused; less would make other sessions wait
/// whenever this one sends a little more.
const MARGIN_DIVISOR: u64 = 32;

/// The measurement of one session.
#[derive(Clone, Debug, Default)]
pub(super) struct Demand {
    measured_ns: u64,
    sent_bits: u64,
    /// What each unit of weight was given during the measurement, and how much of that overflowed, in clock readings.
    given: u128,
    lost: u128,
    /// Bits per second; `None` if the session uses all that it is given.
    estimate: Option<u64>,
}

impl Demand {
    /// Adds `ns` during which there was something to send, what was given in that time and what of it overflowed.
    pub(super) fn add_interval(&mut self, ns: u64, given: u128, lost: u128) {
        self.measured_ns = self.measured_ns.saturating_add(ns);
        self.given = self.given.saturating_add(given);
        self.lost = self.lost.saturating_add(lost);
    }

    /// Adds bits that were sent.
    pub(super) fn add_sent(&mut self, bits: u64) {
        self.sent_bits = self.sent_bits.saturating_add(bits);
    }

    /// Updates the estimate and starts a new measurement, if the current one is long enough.
    pub(super) fn update(&mut self) {
        if self.measured_ns < WINDOW_NS {
            return;
        }
        let sent = u128::from(self.sent_bits) * 1_000_000_000 / u128::from(self.measured_ns);
        let sent = u64::try_from(sent).unwrap_or(u64::MAX);
        let unused = self.lost > self.given / MIN_LOST_DIVISOR;
        *self =
            Self { estimate: unused.then(|| sent.saturating_add(sent / MARGIN_DIVISOR)), ..Self::default() };
    }

    /// The level at which a session with this weight and own rate has all that it can use.
    pub(super) fn max_level(&self, own_bits_per_s: Option<u64>, weight: u32) -> Level {
        let rate = [self.estimate, own_bits_per_s].into_iter().flatten().min();
        rate.map_or(Level::MAX, |rate| level_of(rate, weight))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn estimate_follows_the_measured_rate_until_the_share_is_used() {
        let mut demand = Demand::default();
        demand.add_interval(WINDOW_NS - 1, 800, 700);
        demand.add_sent(1_000_000);
        demand.update();
        assert_eq!(demand.estimate, None, "not measured for long enough");
        demand.add_interval(1, 0, 0);
        demand.update();
        assert_eq!(demand.estimate, Some(2_062_500));
        demand.add_interval(WINDOW_NS, 800, 100);
        demand.update();
        assert_eq!(demand.estimate, None, "late timers lose a little");
    }
}
