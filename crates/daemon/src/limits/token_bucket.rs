//! Token bucket for events, which are admitted only for their whole cost.

use std::time::Duration;

use lodestream_protocol::Time;
use lodestream_protocol::limiter::TokenBucket;

/// A token bucket that admits an event only if it holds tokens for the event's whole cost.
///
/// The sender's bucket lets one piece overdraw it, so that large pieces pass; here the tokens are a client's, and a
/// client has no more than its burst.
#[derive(Clone, Debug)]
pub(crate) struct EventBucket(TokenBucket);

impl EventBucket {
    /// A full bucket of `per_s` tokens per second that holds the tokens of `burst`.
    pub(crate) const fn new(per_s: u32, burst: Duration) -> Self {
        Self(TokenBucket::new(Some(per_s as u64), burst))
    }

    /// Takes `cost` tokens if there are as many; otherwise returns `false` and takes none.
    pub(crate) fn take(&mut self, now: Time, cost: usize) -> bool {
        self.0.try_take(now, cost as u64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_event_is_admitted_only_for_its_whole_cost() {
        let mut bucket = EventBucket::new(500, Duration::from_secs(4));
        let now = Time::from_ms(1);
        assert!(bucket.take(now, 1990));
        assert!(!bucket.take(now, 50), "an overdraft");
        assert!(bucket.take(now, 10), "a refused event costs nothing");
        assert!(!bucket.take(now, 1));
        assert!(!bucket.take(Time::from_ms(100), 50));
        assert!(bucket.take(Time::from_ms(101), 50));
    }

    #[test]
    fn a_pause_fills_the_bucket_and_no_more() {
        let mut bucket = EventBucket::new(500, Duration::from_secs(4));
        assert!(!bucket.take(Time::from_ms(3_600_000), 2001));
        assert!(bucket.take(Time::from_ms(3_600_000), 2000));
    }
}
