//! Pacing of a session's blobs: its own limiter and its share of the rate that sessions have in common.

use crate::limiter::{LimiterConfig, SendLimiter};
use crate::shared_rate_limit::{RateShare, SendRequest, Weight};
use crate::time::Time;

/// A session's limiter and, if it shares a rate, its share.
#[derive(Debug)]
pub(super) struct Pace {
    limiter: SendLimiter,
    share: Option<RateShare>,
    /// The first moment at which the share admits something or must be asked again.
    share_ready_at: Time,
}

impl Pace {
    /// With the session's own limiter only.
    pub(super) const fn new(limiter: LimiterConfig) -> Self {
        Self { limiter: SendLimiter::new(limiter), share: None, share_ready_at: Time::ZERO }
    }

    /// Adds a share of a shared rate limit.
    pub(super) fn join(&mut self, share: RateShare) {
        self.share = Some(share);
    }

    /// Gives up the share of the shared rate limit.
    pub(super) fn leave(&mut self) {
        self.share = None;
        self.share_ready_at = Time::ZERO;
    }

    /// Changes the session's own rate.
    pub(super) fn set_rate(&mut self, now: Time, rate_bits_per_s: Option<u64>) {
        self.limiter.set_rate(now, rate_bits_per_s);
    }

    /// Changes the session's weight in the shared rate limit.
    pub(super) fn set_weight(&mut self, now: Time, weight: Weight) {
        if let Some(share) = &mut self.share {
            share.set_weight(now, weight);
        }
    }

    /// Changes the group with which the session shares a limit.
    pub(super) fn set_group(&mut self, now: Time, group: Option<u128>) {
        if let Some(share) = &mut self.share {
            share.move_to(now, group);
        }
    }

    /// Whether blobs are admitted now; `active` says that there are blobs to send.
    pub(super) fn admits(&mut self, now: Time, active: bool) -> bool {
        let own_ready = self.limiter.admits(now);
        if let Some(share) = &mut self.share {
            let own_bits_per_s = self.limiter.rate_bits_per_s();
            self.share_ready_at = share.ask(now, SendRequest { active, own_bits_per_s, own_ready });
        }
        own_ready && self.share_ready_at <= now
    }

    /// The earliest moment at which [`admits`](Self::admits) can be true.
    pub(super) fn ready_at(&self) -> Time {
        self.limiter.ready_at().max(self.share_ready_at)
    }

    /// Takes the tokens of `payload` bytes; returns their bytes on the wire.
    pub(super) fn spend(&mut self, now: Time, payload: usize) -> u64 {
        let wire = self.limiter.spend(now, payload);
        if let Some(share) = &mut self.share {
            share.spend(now, wire);
        }
        wire
    }
}
