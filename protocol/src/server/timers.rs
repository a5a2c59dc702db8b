//! Deadlines of a session: handshake, idle and stall timeouts, and the limiter's next moment.

use std::time::Duration;

use super::config::ServerConfig;
use crate::time::Time;

/// The moments from which the deadlines count.
#[derive(Debug)]
pub(super) struct Timers {
    started: Time,
    last_message: Time,
    /// Since when there is work that the driver has not taken.
    offered: Time,
    /// When the driver last polled: an admission by the limiter before that causes no further wake-up.
    polled: Time,
    hello_timeout: Duration,
    idle_timeout: Duration,
    stall_timeout: Duration,
}

/// The state of a session that its deadlines depend on.
#[derive(Clone, Copy, Debug)]
pub(super) struct SessionState {
    /// Whether `Hello` has not arrived.
    pub(super) awaiting_hello: bool,
    /// Whether there is something to send.
    pub(super) has_work: bool,
    /// The first moment at which the limiter admits something.
    pub(super) ready_at: Time,
}

impl Timers {
    /// The deadlines of a session that begins now.
    pub(super) fn new(config: &ServerConfig, now: Time) -> Self {
        let &ServerConfig { hello_timeout, idle_timeout, stall_timeout, .. } = config;
        Self {
            started: now,
            last_message: now,
            offered: now,
            polled: now,
            hello_timeout,
            idle_timeout,
            stall_timeout,
        }
    }

    /// Records a message of the client.
    pub(super) fn message_received(&mut self, now: Time) {
        self.last_message = now;
    }

    /// Records that there is work again.
    pub(super) fn work_offered(&mut self, now: Time) {
        self.offered = now;
    }

    /// Records that the driver polls the session.
    pub(super) fn driver_polled(&mut self, now: Time) {
        self.polled = now;
    }

    /// The reason to close the session, if a deadline has passed.
    pub(super) fn overdue(&self, now: Time, state: SessionState) -> Option<String> {
        if state.awaiting_hello && now >= self.started + self.hello_timeout {
            Some(format!("no Hello within {} s", self.hello_timeout.as_secs_f32()))
        } else if now >= self.last_message + self.idle_timeout {
            Some(format!("no message from the client for {} s", self.idle_timeout.as_secs_f32()))
        } else if state.has_work && now >= self.stalled_at(state) + self.stall_timeout {
            Some(format!("the transport has accepted nothing for {} s", self.stall_timeout.as_secs_f32()))
        } else {
            None
        }
    }

    /// The next moment at which [`overdue`](Self::overdue) or the limiter can change.
    pub(super) fn next(&self, state: SessionState) -> Time {
        let mut next = self.last_message + self.idle_timeout;
        if state.awaiting_hello {
            next = next.min(self.started + self.hello_timeout);
        }
        if state.has_work {
            next = next.min(self.stalled_at(state) + self.stall_timeout);
            // After a poll at that moment, the session waits for the driver's transport.
            if state.ready_at > self.polled {
                next = next.min(state.ready_at);
            }
        }
        next
    }

    fn stalled_at(&self, state: SessionState) -> Time {
        self.offered.max(state.ready_at)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn driver_wakes_once_for_the_limiter_and_otherwise_for_deadlines() {
        let mut timers = Timers::new(&ServerConfig::quic(None), Time::ZERO);
        let state = SessionState { awaiting_hello: true, has_work: true, ready_at: Time::from_ms(7) };
        assert_eq!(timers.next(state), Time::from_ms(7));
        timers.driver_polled(Time::from_ms(7));
        assert_eq!(timers.next(state), Time::from_ms(10_000));
        assert_eq!(timers.overdue(Time::from_ms(9_999), state), None);
        assert!(timers.overdue(Time::from_ms(10_000), state).unwrap().contains("Hello"));
        let open = SessionState { awaiting_hello: false, has_work: false, ready_at: Time::ZERO };
        timers.message_received(Time::from_ms(500));
        assert_eq!(timers.next(open), Time::from_ms(30_500));
    }
}
