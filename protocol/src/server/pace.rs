//! How fast a session may send: its own limiter and its part in a ceiling that sessions share.

use crate::limiter::{CeilingShare, LimiterConfig, TokenBucket};
use crate::time::Time;

/// See the module.
#[derive(Debug)]
pub(super) struct Pace {
    bucket: TokenBucket,
    share: Option<CeilingShare>,
}

impl Pace {
    /// Only its own limiter.
    pub(super) const fn new(limiter: LimiterConfig) -> Self {
        Self { bucket: TokenBucket::new(limiter), share: None }
    }

    /// Makes the session share a ceiling with others.
    pub(super) fn join(&mut self, share: CeilingShare) {
        self.share = Some(share);
    }

    /// Leaves the ceiling to the others.
    pub(super) fn leave(&mut self) {
        self.share = None;
    }

    /// Whether blobs are admitted now; `active`: there are some to send. `own` is the session's own rate.
    pub(super) fn admits(&mut self, now: Time, active: bool, own: Option<u64>) -> bool {
        if let Some(share) = &mut self.share {
            share.set_active(active);
            self.bucket.set_rate(Some(share.limit(own)));
        }
        self.bucket.admits(now)
    }

    /// From when on something is admitted.
    pub(super) fn ready_at(&self) -> Time {
        self.bucket.ready_at()
    }

    /// Takes the tokens of so many bytes of payload; gives their bytes on the wire.
    pub(super) fn spend(&mut self, now: Time, payload: usize) -> u64 {
        self.bucket.spend(now, payload)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::limiter::SharedCeiling;

    #[test]
    fn a_session_takes_its_part_while_it_has_something_to_send_and_leaves_it_when_over() {
        let ceiling = SharedCeiling::new(8_000_000);
        let mut pace = Pace::new(LimiterConfig::quic(None));
        pace.join(ceiling.join());
        assert!(pace.admits(Time::from_ms(100), true, None));
        assert_eq!(ceiling.active(), 1);
        pace.spend(Time::from_ms(100), 1_000_000);
        assert!(!pace.admits(Time::from_ms(101), true, None), "a megabyte at a megabyte a second");
        pace.leave();
        assert_eq!(ceiling.active(), 0);
    }
}
