//! Signs of life: what was heard when, pings, and how long a server may be silent before somebody is told.

use std::time::Duration;

use super::config::ClientConfig;
use crate::time::Time;

/// Pings while nothing is heard otherwise; short enough for a round trip soon after the start.
const FIRST_PING: Duration = Duration::from_millis(500);
/// Silence after which a ping asks whether the server is still there, unless one is under way already.
const PROBE_AFTER: Duration = Duration::from_secs(1);
/// Time that the answer to a ping may take before the server counts as silent; on slow links two round trips, if that
/// is more.
const ANSWER_WITHIN: Duration = Duration::from_millis(800);

/// See the module.
#[derive(Debug)]
pub(super) struct Keepalive {
    started: Time,
    heard: Time,
    ping_due: Time,
    /// The last ping, not answered yet: its number and when it was sent.
    ping: Option<(u32, Time)>,
    pings: u32,
    welcome_timeout: Duration,
    idle_timeout: Duration,
    /// Silence after which the server closes, once known.
    server_idle: Option<Duration>,
}

impl Keepalive {
    pub(super) fn new(config: &ClientConfig, now: Time) -> Self {
        let &ClientConfig { welcome_timeout, idle_timeout, .. } = config;
        Self {
            started: now,
            heard: now,
            ping_due: now,
            ping: None,
            pings: 0,
            welcome_timeout,
            idle_timeout,
            server_idle: None,
        }
    }

    /// Something came from the server.
    pub(super) fn heard(&mut self, now: Time) {
        self.heard = now;
    }

    /// The server has answered, and says after which silence it closes.
    pub(super) fn welcomed(&mut self, server_idle: Duration) {
        self.server_idle = Some(server_idle);
    }

    /// What has not come in time, if anything: a reason to end the session.
    pub(super) fn overdue(&self, now: Time) -> Option<String> {
        if self.server_idle.is_none() && now >= self.started + self.welcome_timeout {
            Some(format!("no answer within {} s", self.welcome_timeout.as_secs_f32()))
        } else if now >= self.heard + self.idle_timeout {
            Some(format!("nothing heard for {} s", self.idle_timeout.as_secs_f32()))
        } else {
            None
        }
    }

    /// When to look again; `may_ping`: `Hello` has been sent.
    pub(super) fn next(&self, may_ping: bool) -> Time {
        let mut next = self.heard + self.idle_timeout;
        if self.server_idle.is_none() {
            next = next.min(self.started + self.welcome_timeout);
        }
        if may_ping { next.min(self.ping_at()) } else { next }
    }

    /// When to ping: in turn, or because nothing was heard; for that but once, until something is.
    fn ping_at(&self) -> Time {
        let asked = self.ping.is_some_and(|(_, sent)| sent >= self.heard);
        if asked || self.server_idle.is_none() {
            self.ping_due
        } else {
            self.ping_due.min(self.heard + PROBE_AFTER)
        }
    }

    /// For how long the server has been silent, if that is longer than an answer takes: nothing has come since a ping,
    /// whose answer took `rtt` before. The connection is not lost for that.
    pub(super) fn silence(&self, now: Time, rtt: Option<Duration>) -> Option<Duration> {
        self.server_idle?;
        let (_, asked) = self.ping.filter(|(_, sent)| *sent >= self.heard)?;
        let within = rtt.map_or(ANSWER_WITHIN, |rtt| ANSWER_WITHIN.max(2 * rtt));
        (now >= asked + within).then(|| now.since(self.heard))
    }

    /// The number of a ping to send now, if one is due.
    pub(super) fn poll_ping(&mut self, now: Time) -> Option<u32> {
        if now < self.ping_at() {
            return None;
        }
        // Often at first, for the round trip; then to stay well within the server's patience.
        let patience = self.server_idle.map_or(FIRST_PING, |idle| (idle / 3).max(FIRST_PING));
        let patience = patience.min(self.idle_timeout / 3);
        self.ping_due = now + if self.pings < 4 { FIRST_PING.min(patience) } else { patience };
        self.pings = self.pings.wrapping_add(1);
        self.ping = Some((self.pings, now));
        Some(self.pings)
    }

    /// The answer to a ping: the round trip, if it is the last ping's.
    pub(super) fn pong(&mut self, now: Time, nonce: u32) -> Option<Duration> {
        let (_, sent) = self.ping.take_if(|(sent, _)| *sent == nonce)?;
        Some(now.since(sent))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_last_pings_answer_tells_the_round_trip() {
        let mut keepalive = Keepalive::new(&ClientConfig::default(), Time::ZERO);
        assert_eq!(keepalive.poll_ping(Time::ZERO), Some(1));
        assert_eq!(keepalive.poll_ping(Time::from_ms(499)), None);
        assert_eq!(keepalive.poll_ping(Time::from_ms(500)), Some(2));
        assert_eq!(keepalive.pong(Time::from_ms(520), 1), None);
        assert_eq!(keepalive.pong(Time::from_ms(530), 2), Some(Duration::from_millis(30)));
        assert_eq!(keepalive.pong(Time::from_ms(540), 2), None);
    }

    #[test]
    fn pings_come_well_within_the_servers_patience() {
        let mut keepalive = Keepalive::new(&ClientConfig::default(), Time::ZERO);
        keepalive.welcomed(Duration::from_secs(12));
        let mut now = Time::ZERO;
        for _ in 0..6 {
            assert!(keepalive.poll_ping(now).is_some());
            assert!(keepalive.ping_due.since(now) <= Duration::from_secs(4));
            now = keepalive.ping_due;
        }
    }

    #[test]
    fn silence_is_asked_about_once_and_told_within_two_seconds() {
        let mut keepalive = Keepalive::new(&ClientConfig::default(), Time::ZERO);
        keepalive.welcomed(Duration::from_secs(60));
        for ms in [0, 500, 1000, 1500, 2000] {
            assert!(keepalive.poll_ping(Time::from_ms(ms)).is_some());
            keepalive.heard(Time::from_ms(ms + 20));
        }
        // Heard last after 2.02 s. The next ping in turn is seconds away.
        assert_eq!(keepalive.next(true), Time::from_ms(3020));
        assert_eq!(keepalive.poll_ping(Time::from_ms(3019)), None);
        assert!(keepalive.poll_ping(Time::from_ms(3020)).is_some());
        assert!(keepalive.next(true) > Time::from_ms(6000), "one ping is enough");
        let rtt = Some(Duration::from_millis(20));
        assert_eq!(keepalive.silence(Time::from_ms(3819), rtt), None);
        assert_eq!(keepalive.silence(Time::from_ms(3820), rtt), Some(Duration::from_millis(1800)));
        let slow = Some(Duration::from_secs(3));
        assert_eq!(keepalive.silence(Time::from_ms(9019), slow), None, "a slow link is no silence");
        assert!(keepalive.silence(Time::from_ms(9020), slow).is_some());
        keepalive.heard(Time::from_ms(9100));
        assert_eq!(keepalive.silence(Time::from_ms(9100), rtt), None);
        assert!(keepalive.next(true) <= Time::from_ms(10_100), "asked again a second after the last word");
    }
}
