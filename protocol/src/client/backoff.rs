//! Delay before reconnecting after a lost session.

use std::time::Duration;

/// First wait, before jitter.
const FIRST: Duration = Duration::from_millis(500);
/// Longest wait, before jitter.
const LONGEST: Duration = Duration::from_secs(30);

/// Exponential backoff with jitter. Waits double from 0.5 s to 30 s; each is drawn from the upper half of its range,
/// so that the clients of a restarted server do not all reconnect at once.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Backoff {
    failures: u32,
}

impl Backoff {
    /// Without failures.
    #[must_use]
    pub const fn new() -> Self {
        Self { failures: 0 }
    }

    /// Records a failure and returns the wait before the next attempt. `random` is uniformly distributed.
    pub fn next_wait(&mut self, random: u32) -> Duration {
        let full = FIRST.saturating_mul(1 << self.failures.min(16)).min(LONGEST);
        self.failures = self.failures.saturating_add(1);
        full / 2 + (full / 2).mul_f64(f64::from(random) / f64::from(u32::MAX))
    }

    /// Failures since the last success.
    #[must_use]
    pub const fn failures(&self) -> u32 {
        self.failures
    }

    /// Records an established session.
    pub fn succeeded(&mut self) {
        self.failures = 0;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn waits_double_up_to_the_longest_with_jitter() {
        let mut backoff = Backoff::new();
        for n in 0..40_u32 {
            let full = FIRST.saturating_mul(1 << n.min(10)).min(LONGEST);
            let mut low = backoff;
            assert_eq!(low.next_wait(0), full / 2);
            assert_eq!(backoff.next_wait(u32::MAX), full / 2 * 2);
        }
        backoff.succeeded();
        assert_eq!(backoff.next_wait(0), FIRST / 2);
    }
}
