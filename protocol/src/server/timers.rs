//! What a session waits for, and for how long.

use std::time::Duration;

use super::config::ServerConfig;
use crate::time::Time;

/// Moments that deadlines count from.
#[derive(Debug)]
pub(super) struct Timers {
    started: Time,
    heard: Time,
    /// Since when there is something to send that the driver could have taken.
    offered: Time,
    /// When the driver last asked what to do: the limiter's wake-up call is not repeated after that.
    woken: Time,
    hello_timeout: Duration,
    idle_timeout: Duration,
    stall_timeout: Duration,
}

/// What a session is about when its deadlines are looked at.
#[derive(Clone, Copy, Debug)]
pub(super) struct Waiting {
    /// `Hello` has not been heard.
    pub(super) greeting: bool,
    /// There is something to send.
    pub(super) has_work: bool,
    /// From when on the limiter admits something.
    pub(super) ready_at: Time,
}

impl Timers {
    /// A session begins.
    pub(super) fn new(config: &ServerConfig, now: Time) -> Self {
        let &ServerConfig { hello_timeout, idle_timeout, stall_timeout, .. } = config;
        Self {
            started: now,
            heard: now,
            offered: now,
            woken: now,
            hello_timeout,
            idle_timeout,
            stall_timeout,
        }
    }

    /// The client has said something.
    pub(super) fn heard(&mut self, now: Time) {
        self.heard = now;
    }

    /// There is something to send again.
    pub(super) fn offered(&mut self, now: Time) {
        self.offered = now;
    }

    /// The driver asks what to do.
    pub(super) fn woken(&mut self, now: Time) {
        self.woken = now;
    }

    /// What has not come in time, if anything: a reason to close.
    pub(super) fn overdue(&self, now: Time, waiting: Waiting) -> Option<String> {
        if waiting.greeting && now >= self.started + self.hello_timeout {
            Some(format!("no Hello within {} s", self.hello_timeout.as_secs_f32()))
        } else if now >= self.heard + self.idle_timeout {
            Some(format!("nothing heard for {} s", self.idle_timeout.as_secs_f32()))
        } else if waiting.has_work && now >= self.stalled_at(waiting) + self.stall_timeout {
            Some(format!("nothing taken for {} s", self.stall_timeout.as_secs_f32()))
        } else {
            None
        }
    }

    /// When to look again.
    pub(super) fn next(&self, waiting: Waiting) -> Time {
        let mut next = self.heard + self.idle_timeout;
        if waiting.greeting {
            next = next.min(self.started + self.hello_timeout);
        }
        if waiting.has_work {
            next = next.min(self.stalled_at(waiting) + self.stall_timeout);
            // Once woken for it, the driver's transport is what is waited for.
            if waiting.ready_at > self.woken {
                next = next.min(waiting.ready_at);
            }
        }
        next
    }

    fn stalled_at(&self, waiting: Waiting) -> Time {
        self.offered.max(waiting.ready_at)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_driver_is_woken_for_the_limiter_once_and_for_the_nearest_deadline_otherwise() {
        let mut timers = Timers::new(&ServerConfig::quic(None), Time::ZERO);
        let waiting = Waiting { greeting: true, has_work: true, ready_at: Time::from_ms(7) };
        assert_eq!(timers.next(waiting), Time::from_ms(7));
        timers.woken(Time::from_ms(7));
        assert_eq!(timers.next(waiting), Time::from_ms(10_000));
        assert_eq!(timers.overdue(Time::from_ms(9_999), waiting), None);
        assert!(timers.overdue(Time::from_ms(10_000), waiting).unwrap().contains("Hello"));
        let open = Waiting { greeting: false, has_work: false, ready_at: Time::ZERO };
        timers.heard(Time::from_ms(500));
        assert_eq!(timers.next(open), Time::from_ms(30_500));
    }
}
