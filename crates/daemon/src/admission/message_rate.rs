//! How many messages a client may send: a token bucket.

use lodestream_protocol::Time;

/// Messages that a client may send at once, and per second after that.
const MESSAGE_BURST: u32 = 2000;
const MESSAGES_PER_S: u32 = 500;

/// See the module.
#[derive(Debug)]
pub(crate) struct MessageRateLimiter {
    tokens: u32,
    refilled: Time,
}

impl MessageRateLimiter {
    /// A full bucket.
    pub(crate) const fn new(now: Time) -> Self {
        Self { tokens: MESSAGE_BURST, refilled: now }
    }

    /// Takes one message that is as much work as `cost` others.
    pub(crate) fn take(&mut self, now: Time, cost: u32) -> bool {
        let earned = now.since(self.refilled).as_millis() * u128::from(MESSAGES_PER_S) / 1000;
        if earned > 0 {
            self.refilled = now;
            let earned = u32::try_from(earned).unwrap_or(MESSAGE_BURST);
            self.tokens = self.tokens.saturating_add(earned).min(MESSAGE_BURST);
        }
        let admitted = self.tokens >= cost;
        self.tokens = self.tokens.saturating_sub(cost);
        admitted
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn messages_are_allowed_at_their_rate() {
        let mut allowance = MessageRateLimiter::new(Time::ZERO);
        let burst = (0..10_000).filter(|_| allowance.take(Time::from_ms(1), 1)).count();
        assert_eq!(burst, MESSAGE_BURST as usize);
        let later = (0..10_000).filter(|_| allowance.take(Time::from_ms(1001), 1)).count();
        assert_eq!(later, MESSAGES_PER_S as usize);
    }
}
