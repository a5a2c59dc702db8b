//! Metrics of a running session: time to the first byte of a blob, queued bytes, and turns of its loop.

use std::time::Duration;

use lodestream_protocol::Time;
use lodestream_protocol::message::ClientMessage;
use lodestream_protocol::server::ServerSession;

use crate::metrics::Metrics;

/// Least time between two samples of the queued bytes, each of which visits all requests.
const SAMPLE_INTERVAL: Duration = Duration::from_millis(250);

/// Collects one session's metrics. When dropped, its queued bytes no longer count.
#[derive(Debug)]
pub(crate) struct SessionMetrics<'a> {
    metrics: &'a Metrics,
    /// Start of the wait for the first byte; `None` once it was sent.
    first_byte_since: Option<Time>,
    reported_bytes: u64,
    next_sample: Time,
    /// Turns of the loop since the last report, and those caused by timers.
    turns: u32,
    timer_turns: u32,
    next_report: Time,
}

impl<'a> SessionMetrics<'a> {
    /// Metrics of a session that starts at `now`.
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

    /// Notes a message. A `Hello` before the first byte restarts the wait, since some transports send nothing earlier.
    pub(crate) fn message_received(&mut self, now: Time, message: &ClientMessage) {
        if let (Some(first_byte_since), ClientMessage::Hello(_)) = (&mut self.first_byte_since, message) {
            *first_byte_since = now;
        }
    }

    /// Notes that a piece of a blob was sent.
    pub(crate) fn piece_sent(&mut self, now: Time) {
        if let Some(first_byte_since) = self.first_byte_since.take() {
            self.metrics.first_byte(now.since(first_byte_since));
        }
    }

    /// Notes a turn caused by a timer.
    pub(crate) const fn timer_fired(&mut self) {
        self.timer_turns += 1;
    }

    /// Notes a turn of the loop. Samples the queued bytes if a sample is due or none are queued.
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

    /// Reports turns in batches, because all sessions share the counters.
    fn report_turns(&mut self) {
        self.metrics.loop_turns(std::mem::take(&mut self.turns), std::mem::take(&mut self.timer_turns));
    }

    fn report_queued(&mut self, bytes: u64) {
        if bytes != self.reported_bytes {
            self.metrics.queued_changed(self.reported_bytes, bytes);
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
