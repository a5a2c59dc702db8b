//! What a session can use of its part, where that is less than all: a slow link, a client that asks for little.
//!
//! A session whose bucket overflows while it has something to send is held up by something else. How much overflowed, and
//! how much it sent meanwhile, is measured over half a second at a time. The answer only tells what others may have: the
//! session itself may take its part at any time.

use super::filling::{Level, level_of};

/// Time over which is measured, of that in which there is something to send, in nanoseconds.
const WINDOW_NS: u64 = 500_000_000;
/// Who leaves less than this share of his part is held up by nothing but that: one in so many.
const LEFT: u128 = 8;
/// What is set aside for who leaves some, beyond what he took: one part in so many. More would be left unused, less would
/// make others wait for each other when he takes a little more.
const BEYOND: u64 = 32;

/// See the module.
#[derive(Clone, Debug, Default)]
pub(super) struct Demand {
    measured_ns: u64,
    sent_bits: u64,
    /// What each unit of weight was given while it was measured, and what of that overflowed, in readings of the clock.
    given: u128,
    lost: u128,
    /// Bits per second; `None`: all that it is given.
    estimate: Option<u64>,
}

impl Demand {
    /// So much time passed in which there was something to send, and so much was given, of which some overflowed.
    pub(super) fn passed(&mut self, ns: u64, given: u128, lost: u128) {
        self.measured_ns = self.measured_ns.saturating_add(ns);
        self.given = self.given.saturating_add(given);
        self.lost = self.lost.saturating_add(lost);
    }

    /// So many bits were sent.
    pub(super) fn sent(&mut self, bits: u64) {
        self.sent_bits = self.sent_bits.saturating_add(bits);
    }

    /// Draws the sum where enough was measured.
    pub(super) fn conclude(&mut self) {
        if self.measured_ns < WINDOW_NS {
            return;
        }
        let sent = u128::from(self.sent_bits) * 1_000_000_000 / u128::from(self.measured_ns);
        let sent = u64::try_from(sent).unwrap_or(u64::MAX);
        let leaves = self.lost > self.given / LEFT;
        *self = Self { estimate: leaves.then(|| sent.saturating_add(sent / BEYOND)), ..Self::default() };
    }

    /// The level at which a session with this weight and rate of its own has all that it can use.
    pub(super) fn most(&self, own_bits_per_s: Option<u64>, weight: u32) -> Level {
        let most = [self.estimate, own_bits_per_s].into_iter().flatten().min();
        most.map_or(Level::MAX, |most| level_of(most, weight))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn who_leaves_some_of_its_part_counts_with_what_it_took_until_it_takes_all() {
        let mut demand = Demand::default();
        demand.passed(WINDOW_NS - 1, 800, 700);
        demand.sent(1_000_000);
        demand.conclude();
        assert_eq!(demand.estimate, None, "not measured for long enough");
        demand.passed(1, 0, 0);
        demand.conclude();
        assert_eq!(demand.estimate, Some(2_062_500));
        demand.passed(WINDOW_NS, 800, 100);
        demand.conclude();
        assert_eq!(demand.estimate, None, "late timers lose a little");
    }
}
