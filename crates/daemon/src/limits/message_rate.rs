//! Limit on the messages that a client may send.

use std::time::Duration;

use lodestream_protocol::Time;

use crate::limits::token_bucket::EventBucket;

/// Messages per second that a client may send in the long run.
const MESSAGES_PER_S: u32 = 500;
/// Time whose messages a client may send at once: 2000 messages.
const BURST: Duration = Duration::from_secs(4);

/// Token bucket over the messages of one client.
#[derive(Debug)]
pub(crate) struct MessageRateLimiter(EventBucket);

impl MessageRateLimiter {
    /// A full bucket.
    pub(crate) const fn new() -> Self {
        Self(EventBucket::new(MESSAGES_PER_S, BURST))
    }

    /// Takes the tokens of a message that is as much work as `cost` ordinary ones; returns whether there were enough.
    pub(crate) fn take(&mut self, now: Time, cost: usize) -> bool {
        self.0.take(now, cost)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn messages_are_admitted_at_their_rate() {
        let mut limiter = MessageRateLimiter::new();
        let burst = (0..10_000).filter(|_| limiter.take(Time::from_ms(1), 1)).count();
        assert_eq!(burst, 2000);
        let later = (0..10_000).filter(|_| limiter.take(Time::from_ms(1001), 1)).count();
        assert_eq!(later, MESSAGES_PER_S as usize);
    }
}
