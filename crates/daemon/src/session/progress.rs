//! What is measured of a session while it runs: when its first blob's first byte was handed over, what waits, and how
//! often its loop turns.

use std::time::Duration;

use lodestream_protocol::Time;
use lodestream_protocol::message::ClientMessage;
use lodestream_protocol::server::ServerSession;

use crate::metrics::Metrics;

/// Least time between two looks at all that waits in a session: each looks at each request.
const LOOK_INTERVAL: Duration = Duration::from_millis(250);

/// See the module. Dropped, nothing waits any more.
#[derive(Debug)]
pub(crate) struct Progress<'a> {
    metrics: &'a Metrics,
    /// From when on the first byte is waited for; `None` once it was handed over.
    since: Option<Time>,
    told_bytes: u64,
    next_look: Time,
    /// Turns of the loop that were not told yet, and those by timers.
    turns: u32,
    alarms: u32,
    next_told: Time,
}

impl<'a> Progress<'a> {
    /// Of a session that begins now.
    pub(crate) const fn new(metrics: &'a Metrics, now: Time) -> Self {
        Self { metrics, since: Some(now), told_bytes: 0, next_look: now, turns: 0, alarms: 0, next_told: now }
    }

    /// The client has said something: who says `Hello` before there is a byte counts from then on, since some transports
    /// send nothing earlier.
    pub(crate) fn heard(&mut self, now: Time, message: &ClientMessage) {
        if let (Some(since), ClientMessage::Hello(_)) = (&mut self.since, message) {
            *since = now;
        }
    }

    /// A piece of a blob was handed over.
    pub(crate) fn piece_sent(&mut self, now: Time) {
        if let Some(since) = self.since.take() {
            self.metrics.first_byte(now.since(since));
        }
    }

    /// A timer has run out.
    pub(crate) const fn alarm(&mut self) {
        self.alarms += 1;
    }

    /// The loop has turned. Looks at what waits, if it is time or nothing does.
    pub(crate) fn look(&mut self, now: Time, session: &ServerSession) {
        self.turns += 1;
        if now >= self.next_told {
            self.next_told = now + LOOK_INTERVAL;
            self.tell_turns();
        }
        if session.nothing_waits() {
            self.tell(0);
        } else if now >= self.next_look {
            self.next_look = now + LOOK_INTERVAL;
            self.tell(session.waiting_bytes());
        }
    }

    /// Not at each turn: all sessions count in one place.
    fn tell_turns(&mut self) {
        self.metrics.turned(std::mem::take(&mut self.turns), std::mem::take(&mut self.alarms));
    }

    fn tell(&mut self, bytes: u64) {
        if bytes != self.told_bytes {
            self.metrics.waiting_changed(self.told_bytes, bytes);
            self.told_bytes = bytes;
        }
    }
}

impl Drop for Progress<'_> {
    fn drop(&mut self) {
        self.tell(0);
        self.tell_turns();
    }
}
