//! Jitter: delay that varies from packet to packet.

use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64Mcg;

/// Delay added to each packet, uniformly distributed from 0 to a largest value.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Jitter {
    /// Largest additional delay, in nanoseconds.
    pub largest_ns: u64,
    /// Whether packets may overtake each other. If not, a packet waits for the one before it, as in a queue; arrivals
    /// are then later than uniformly distributed ones.
    pub reorders: bool,
}

/// Generates the delays of successive packets.
#[derive(Clone, Debug)]
pub(super) struct Delays {
    jitter: Jitter,
    random: Pcg64Mcg,
    last_arrival_ns: u64,
}

impl Delays {
    pub(super) fn new(jitter: Jitter, seed: u64) -> Self {
        // The generator of losses has the same seed and must not be correlated with this one.
        let random = Pcg64Mcg::seed_from_u64(seed ^ 0x6a09_e667_f3bc_c908);
        Self { jitter, random, last_arrival_ns: 0 }
    }

    /// The next packet's additional delay. Must be called for every packet, whatever its fate.
    pub(super) fn draw_ns(&mut self) -> u64 {
        if self.jitter.largest_ns == 0 { 0 } else { self.random.random_range(0..=self.jitter.largest_ns) }
    }

    /// The arrival time of a packet whose delays end at `at_ns`.
    pub(super) fn arrival_ns(&mut self, at_ns: u64) -> u64 {
        if self.jitter.reorders {
            return at_ns;
        }
        self.last_arrival_ns = self.last_arrival_ns.max(at_ns);
        self.last_arrival_ns
    }
}
