//! How fast a session may send: its own limiter and its part in what sessions share.

use crate::limiter::{LimiterConfig, TokenBucket};
use crate::shared_rate_limit::{RateShare, SendRequest, Weight};
use crate::time::Time;

/// See the module.
#[derive(Debug)]
pub(super) struct Pace {
    bucket: TokenBucket,
    share: Option<RateShare>,
    /// From when on the share admits something, or is asked again.
    share_ready_at: Time,
}

impl Pace {
    /// Only its own limiter.
    pub(super) const fn new(limiter: LimiterConfig) -> Self {
        Self { bucket: TokenBucket::new(limiter), share: None, share_ready_at: Time::ZERO }
    }

    /// Makes the session share a shared rate limit with others.
    pub(super) fn join(&mut self, share: RateShare) {
        self.share = Some(share);
    }

    /// Leaves the shared rate limit to the others.
    pub(super) fn leave(&mut self) {
        self.share = None;
        self.share_ready_at = Time::ZERO;
    }

    /// Changes the session's own rate.
    pub(super) fn set_rate(&mut self, now: Time, rate_bits_per_s: Option<u64>) {
        self.bucket.set_rate(now, rate_bits_per_s);
    }

    /// Changes how much the session counts beside others.
    pub(super) fn set_weight(&mut self, now: Time, weight: Weight) {
        if let Some(share) = &mut self.share {
            share.set_weight(now, weight);
        }
    }

    /// Changes with whom the session counts as one.
    pub(super) fn set_group(&mut self, now: Time, group: Option<u128>) {
        if let Some(share) = &mut self.share {
            share.move_to(now, group);
        }
    }

    /// Whether blobs are admitted now; `active`: there are some to send.
    pub(super) fn admits(&mut self, now: Time, active: bool) -> bool {
        let own_ready = self.bucket.admits(now);
        if let Some(share) = &mut self.share {
            let own_bits_per_s = self.bucket.config().rate_bits_per_s;
            self.share_ready_at = share.ask(now, SendRequest { active, own_bits_per_s, own_ready });
        }
        own_ready && self.share_ready_at <= now
    }

    /// From when on something may be admitted: then ask again.
    pub(super) fn ready_at(&self) -> Time {
        self.bucket.ready_at().max(self.share_ready_at)
    }

    /// Takes the tokens of so many bytes of payload; gives their bytes on the wire.
    pub(super) fn spend(&mut self, now: Time, payload: usize) -> u64 {
        let wire = self.bucket.spend(now, payload);
        if let Some(share) = &mut self.share {
            share.spend(now, wire);
        }
        wire
    }
}
