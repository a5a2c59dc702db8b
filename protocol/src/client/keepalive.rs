//! Keepalive: pings, round-trip measurement, and timeouts of a silent server.

use std::time::Duration;

use super::config::ClientConfig;
use crate::time::Time;

/// Interval of the first pings: short, to measure the round trip soon after the start.
const FIRST_PING: Duration = Duration::from_millis(500);
/// Silence after which an extra ping is sent, unless one is unanswered already.
const PROBE_AFTER: Duration = Duration::from_secs(1);
/// Time within which a ping must be answered before the server counts as silent; two round trips if that is more.
const ANSWER_WITHIN: Duration = Duration::from_millis(800);

/// Pings and deadlines of one session.
#[derive(Debug)]
pub(super) struct Keepalive {
    started: Time,
    last_received: Time,
    ping_due: Time,
    /// Number and time of the last ping, until it is answered.
    ping: Option<(u32, Time)>,
    pings: u32,
    welcome_timeout: Duration,
    idle_timeout: Duration,
    /// The server's idle timeout, once `Welcome` has arrived.
    server_idle: Option<Duration>,
}

impl Keepalive {
    pub(super) fn new(config: &ClientConfig, now: Time) -> Self {
        let &ClientConfig { welcome_timeout, idle_timeout, .. } = config;
        Self {
            started: now,
            last_received: now,
            ping_due: now,
            ping: None,
            pings: 0,
            welcome_timeout,
            idle_timeout,
            server_idle: None,
        }
    }

    /// Records a message or piece of the server.
    pub(super) fn received(&mut self, now: Time) {
        self.last_received = now;
    }

    /// Records `Welcome` with the server's idle timeout.
    pub(super) fn welcomed(&mut self, server_idle: Duration) {
        self.server_idle = Some(server_idle);
    }

    /// The reason to end the session, if a deadline has passed.
    pub(super) fn overdue(&self, now: Time) -> Option<String> {
        if self.server_idle.is_none() && now >= self.started + self.welcome_timeout {
            Some(format!("no answer within {} s", self.welcome_timeout.as_secs_f32()))
        } else if now >= self.last_received + self.idle_timeout {
            Some(format!("nothing heard for {} s", self.idle_timeout.as_secs_f32()))
        } else {
            None
        }
    }

    /// The next deadline or ping; `may_ping` says that `Hello` was sent.
    pub(super) fn next(&self, may_ping: bool) -> Time {
        let mut next = self.last_received + self.idle_timeout;
        if self.server_idle.is_none() {
            next = next.min(self.started + self.welcome_timeout);
        }
        if may_ping { next.min(self.ping_at()) } else { next }
    }

    /// When to send the next ping: at its interval, or earlier, once, because of silence.
    fn ping_at(&self) -> Time {
        let pinged = self.ping.is_some_and(|(_, sent)| sent >= self.last_received);
        if pinged || self.server_idle.is_none() {
            self.ping_due
        } else {
            self.ping_due.min(self.last_received + PROBE_AFTER)
        }
    }

    /// Time since the server's last message, if a ping is unanswered for longer than a few round trips (`rtt`). The
    /// connection does not count as lost.
    pub(super) fn silence(&self, now: Time, rtt: Option<Duration>) -> Option<Duration> {
        self.server_idle?;
        let (_, pinged_at) = self.ping.filter(|(_, sent)| *sent >= self.last_received)?;
        let within = rtt.map_or(ANSWER_WITHIN, |rtt| ANSWER_WITHIN.max(2 * rtt));
        (now >= pinged_at + within).then(|| now.since(self.last_received))
    }

    /// The number of a ping to send now, if one is due.
    pub(super) fn poll_ping(&mut self, now: Time) -> Option<u32> {
        if now < self.ping_at() {
            return None;
        }
        // Often at first, to measure the round trip; then well within both idle timeouts.
        let interval = self.server_idle.map_or(FIRST_PING, |idle| (idle / 3).max(FIRST_PING));
        let interval = interval.min(self.idle_timeout / 3);
        self.ping_due = now + if self.pings < 4 { FIRST_PING.min(interval) } else { interval };
        self.pings = self.pings.wrapping_add(1);
        self.ping = Some((self.pings, now));
        Some(self.pings)
    }

    /// Takes the answer to a ping; returns the round trip if it was the last ping.
    pub(super) fn pong(&mut self, now: Time, nonce: u32) -> Option<Duration> {
        let (_, sent) = self.ping.take_if(|(sent, _)| *sent == nonce)?;
        Some(now.since(sent))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_last_ping_measures_the_round_trip() {
        let mut keepalive = Keepalive::new(&ClientConfig::default(), Time::ZERO);
        assert_eq!(keepalive.poll_ping(Time::ZERO), Some(1));
        assert_eq!(keepalive.poll_ping(Time::from_ms(499)), None);
        assert_eq!(keepalive.poll_ping(Time::from_ms(500)), Some(2));
        assert_eq!(keepalive.pong(Time::from_ms(520), 1), None);
        assert_eq!(keepalive.pong(Time::from_ms(530), 2), Some(Duration::from_millis(30)));
        assert_eq!(keepalive.pong(Time::from_ms(540), 2), None);
    }

    #[test]
    fn pings_keep_well_within_the_servers_timeout() {
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
    fn silence_causes_one_ping_and_is_detected_within_two_seconds() {
        let mut keepalive = Keepalive::new(&ClientConfig::default(), Time::ZERO);
        keepalive.welcomed(Duration::from_secs(60));
        for ms in [0, 500, 1000, 1500, 2000] {
            assert!(keepalive.poll_ping(Time::from_ms(ms)).is_some());
            keepalive.received(Time::from_ms(ms + 20));
        }
        // The last message came at 2.02 s. The next regular ping is seconds away.
        assert_eq!(keepalive.next(true), Time::from_ms(3020));
        assert_eq!(keepalive.poll_ping(Time::from_ms(3019)), None);
        assert!(keepalive.poll_ping(Time::from_ms(3020)).is_some());
        assert!(keepalive.next(true) > Time::from_ms(6000), "one ping is enough");
        let rtt = Some(Duration::from_millis(20));
        assert_eq!(keepalive.silence(Time::from_ms(3819), rtt), None);
        assert_eq!(keepalive.silence(Time::from_ms(3820), rtt), Some(Duration::from_millis(1800)));
        let slow = Some(Duration::from_secs(3));
        assert_eq!(keepalive.silence(Time::from_ms(9019), slow), None, "a slow link is not silent");
        assert!(keepalive.silence(Time::from_ms(9020), slow).is_some());
        keepalive.received(Time::from_ms(9100));
        assert_eq!(keepalive.silence(Time::from_ms(9100), rtt), None);
        assert!(
            keepalive.next(true) <= Time::from_ms(10_100),
            "pinged again a second after the last message"
        );
    }
}
