//! Delay before reconnecting after a lost session.

use std::time::Duration;

use crate::time::Time;

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

    /// The same with jitter from the time, which spreads clients that lose the same server at almost the same time.
    pub fn next_wait_at(&mut self, now: Time) -> Duration {
        self.next_wait(jitter(now))
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

/// Jitter for the length of a pause: Fibonacci hashing of the time (Knuth, The Art of Computer Programming, vol. 3,
/// section 6.4). Spreads clients that lose the same server at almost the same time.
fn jitter(now: Time) -> u32 {
    u32::try_from(now.as_ns().wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 32).unwrap_or(0)
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

    #[test]
    fn clients_that_were_started_together_reconnect_at_different_times() {
        // Fifty clients that lose the server within 50 ms of their clocks.
        let mut waits: Vec<Duration> =
            (0..50).map(|ms| Backoff::new().next_wait_at(Time::from_ms(30_000 + ms))).collect();
        waits.sort_unstable();
        // The pauses cover most of their range of 250 ms.
        assert!(waits[49] - waits[0] > Duration::from_millis(225), "{waits:?}");
        let together = waits.windows(6).map(|six| six[5] - six[0]).min().unwrap();
        assert!(together > Duration::from_millis(5), "six within {together:?}");
    }
}
