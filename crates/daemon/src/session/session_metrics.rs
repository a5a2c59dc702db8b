//! What is measured of a session while it runs: when its first blob's first byte was handed over, what waits, and how
//! often its loop turns.

use std::time::Duration;

use lodestream_protocol::Time;
use lodestream_protocol::message::ClientMessage;
use lodestream_protocol::server::ServerSession;

use crate::metrics::Metrics;

/// Least time between two looks at all that waits in a session: each looks at each request.
const SAMPLE_INTERVAL: Duration = Duration::from_millis(250);

/// See the module. Dropped, nothing waits any more.
#[derive(Debug)]
pub(crate) struct SessionMetrics<'a> {
    metrics: &'a Metrics,
    /// From when on the first byte is waited for; `None` once it was handed over.
    first_byte_since: Option<Time>,
    reported_bytes: u64,
    next_sample: Time,
    /// Turns of the loop that were not told yet, and those by timers.
    turns: u32,
    timer_turns: u32,
    next_report: Time,
}

impl<'a> SessionMetrics<'a> {
    /// Of a session that begins now.
    pub(crate) const fn new(metrics: &'a Metrics, now: Time) -> Self {
        Self {
            metrics,
            first_byte_since: Some(now),
            reported_bytes: 0,
            next_sample: now,
            turns: 0,
            timer_turns: 0,
            next_report: now,
        }
    }

    /// The client has said something: who says `Hello` before there is a byte counts from then on, since some transports
    /// send nothing earlier.
    pub(crate) fn message_received(&mut self, now: Time, message: &ClientMessage) {
        if let (Some(first_byte_since), ClientMessage::Hello(_)) = (&mut self.first_byte_since, message) {
            *first_byte_since = now;
        }
    }

    /// A piece of a blob was handed over.
    pub(crate) fn piece_sent(&mut self, now: Time) {
        if let Some(first_byte_since) = self.first_byte_since.take() {
            self.metrics.first_byte(now.since(first_byte_since));
        }
    }

    /// A timer has run out.
    pub(crate) const fn timer_fired(&mut self) {
        self.timer_turns += 1;
    }

    /// The loop has turned. Looks at what waits, if it is time or nothing does.
    pub(crate) fn turn(&mut self, now: Time, session: &ServerSession) {
        self.turns += 1;
        if now >= self.next_report {
            self.next_report = now + SAMPLE_INTERVAL;
            self.report_turns();
        }
        if session.nothing_waits() {
            self.report_queued(0);
        } else if now >= self.next_sample {
            self.next_sample = now + SAMPLE_INTERVAL;
            self.report_queued(session.waiting_bytes());
        }
    }

    /// Not at each turn: all sessions count in one place.
    fn report_turns(&mut self) {
        self.metrics.turned(std::mem::take(&mut self.turns), std::mem::take(&mut self.timer_turns));
    }

    fn report_queued(&mut self, bytes: u64) {
        if bytes != self.reported_bytes {
            self.metrics.waiting_changed(self.reported_bytes, bytes);
            self.reported_bytes = bytes;
        }
    }
}

impl Drop for SessionMetrics<'_> {
    fn drop(&mut self) {
        self.report_queued(0);
        self.report_turns();
    }
}
