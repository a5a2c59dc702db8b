//! Congestion control of the server's QUIC connections: CUBIC (RFC 9438), and on top of it a bound on the queue that
//! the connection itself keeps in the path.
//!
//! CUBIC alone fills a path's queue until packets are dropped. Queued data cannot be overtaken by more urgent data: at
//! 2 Mbit/s and 64 KiB of queue, each change of priorities is delayed by a quarter of a second. `QueueBound` therefore
//! takes the shortest round-trip time of each round. Its excess over the shortest ever measured is a standing queue. If
//! that is too long, the window shrinks to what the path carries within the allowed time (the window law of FAST TCP, Wei
//! et al. 2006, eq. 1, without its constant term).
//!
//! Emptying the connection's own queue costs no throughput. If throughput drops, the queue belongs to other flows, to
//! which the connection would yield until it starved, or the delay is jitter: then CUBIC decides alone for a while
//! (compare the mode switch of Copa, Arun and Balakrishnan 2018, §2.2). Against flows that fill the queue, the connection
//! so behaves like CUBIC. A path that becomes slower looks the same at first.

use std::any::Any;
use std::sync::Arc;
use std::time::{Duration, Instant};

use quinn::congestion::{Controller, ControllerFactory, ControllerMetrics, Cubic, CubicConfig};
use quinn_proto::RttEstimator;

/// First congestion window in bytes. The usual 14,720 would cost a round trip on the way to the first
/// frame; 60,000 is a quarter of a second at 2 Mbit/s and fits into common router queues.
pub(crate) const INITIAL_WINDOW_BYTES: u64 = 60_000;
/// Allowed time in the path's queue: enough for the jitter of clocks, radio links and delayed acknowledgements.
const QUEUE_ALLOWED: Duration = Duration::from_millis(25);
/// Least bounded window in packets of full size: a smaller one cannot be told from delayed acknowledgements.
const MIN_WINDOW_PACKETS: u64 = 8;
/// Largest growth of a bound in a round trip.
const MAX_GROWTH: f64 = 1.25;
/// Under a bound, a round is slow if it delivers less than this share of the rate before the bound; …
const SLOW_SHARE: f64 = 0.75;
/// … after this many more slow rounds than others, CUBIC decides alone …
const MAX_SLOW_ROUNDS: u32 = 4;
/// … for this long.
const CUBIC_PERIOD: Duration = Duration::from_secs(10);

/// The congestion controller of the server's connections: CUBIC with a bounded queue.
#[must_use]
pub fn bounded_queue() -> Arc<dyn ControllerFactory + Send + Sync> {
    let mut cubic = CubicConfig::default();
    cubic.initial_window(INITIAL_WINDOW_BYTES);
    Arc::new(BoundedQueueConfig { cubic: Arc::new(cubic) })
}

#[derive(Debug)]
struct BoundedQueueConfig {
    cubic: Arc<CubicConfig>,
}

impl ControllerFactory for BoundedQueueConfig {
    fn build(self: Arc<Self>, now: Instant, current_mtu: u16) -> Box<dyn Controller> {
        Box::new(BoundedQueue {
            cubic: Cubic::new(Arc::clone(&self.cubic), now, current_mtu),
            bound: QueueBound::new(now),
            least_window: MIN_WINDOW_PACKETS * u64::from(current_mtu),
        })
    }
}

/// CUBIC under a [`QueueBound`].
#[derive(Clone, Debug)]
struct BoundedQueue {
    cubic: Cubic,
    bound: QueueBound,
    least_window: u64,
}

impl Controller for BoundedQueue {
    fn on_ack(&mut self, now: Instant, sent: Instant, bytes: u64, app_limited: bool, rtt: &RttEstimator) {
        // A window limited by the bound is no evidence of the path's capacity. With a queue that is too long already, a
        // larger window would only lengthen it: slow start ends before it overruns the queue.
        let bound = self.window() < self.cubic.window();
        let held = app_limited || bound || self.bound.is_too_long(now, sent);
        self.cubic.on_ack(now, sent, bytes, held, rtt);
        let acknowledged = AckedPacket { sent, bytes, app_limited };
        self.bound.on_ack(now, &acknowledged, self.cubic.window(), self.least_window);
    }

    fn on_congestion_event(&mut self, now: Instant, sent: Instant, is_persistent: bool, lost_bytes: u64) {
        self.cubic.on_congestion_event(now, sent, is_persistent, lost_bytes);
    }

    fn on_mtu_update(&mut self, new_mtu: u16) {
        self.cubic.on_mtu_update(new_mtu);
        self.least_window = MIN_WINDOW_PACKETS * u64::from(new_mtu);
    }

    fn window(&self) -> u64 {
        self.bound.bytes.map_or(self.cubic.window(), |bound| bound.min(self.cubic.window()))
    }

    fn metrics(&self) -> ControllerMetrics {
        let mut metrics = self.cubic.metrics();
        metrics.congestion_window = self.window();
        metrics
    }

    fn clone_box(&self) -> Box<dyn Controller> {
        Box::new(self.clone())
    }

    fn initial_window(&self) -> u64 {
        self.cubic.initial_window()
    }

    fn into_any(self: Box<Self>) -> Box<dyn Any> {
        self
    }
}

/// An acknowledged packet.
struct AckedPacket {
    sent: Instant,
    bytes: u64,
    /// Whether the connection had nothing more to send.
    app_limited: bool,
}

/// Bound on the bytes in flight that keeps the path's queue short; see the module.
#[derive(Clone, Debug)]
struct QueueBound {
    /// The bound; `None` for CUBIC's window.
    bytes: Option<u64>,
    /// Shortest round-trip time of the connection.
    least: Duration,
    /// Start of this round; it ends with the first acknowledgement of a packet sent later.
    round_began: Instant,
    /// Window at the start of the round: the bytes that the round's packets queue behind.
    round_window: u64,
    /// Shortest round-trip time of this round.
    shortest: Duration,
    /// Bytes acknowledged in this round, and whether there was data to send throughout.
    acknowledged: u64,
    busy: bool,
    /// Bytes per second delivered in the round before the bound.
    rate_before_bound: f64,
    /// Number of slow rounds minus others since then.
    slow_rounds: u32,
    /// End of the period in which CUBIC decides alone.
    cubic_until: Option<Instant>,
}

impl QueueBound {
    fn new(now: Instant) -> Self {
        Self {
            bytes: None,
            least: Duration::MAX,
            round_began: now,
            round_window: 0,
            shortest: Duration::MAX,
            acknowledged: 0,
            busy: true,
            rate_before_bound: 0.0,
            slow_rounds: 0,
            cubic_until: None,
        }
    }

    /// Processes an acknowledgement while CUBIC's window is `cubic` bytes.
    fn on_ack(&mut self, now: Instant, acknowledged: &AckedPacket, cubic: u64, least_window: u64) {
        let took = now.saturating_duration_since(acknowledged.sent);
        self.least = self.least.min(took);
        self.shortest = self.shortest.min(took);
        self.acknowledged += acknowledged.bytes;
        self.busy &= !acknowledged.app_limited;
        if acknowledged.sent >= self.round_began {
            self.end_round(now, cubic, least_window);
            self.round_began = now;
            self.round_window = self.bytes.unwrap_or(cubic).min(cubic);
            self.shortest = Duration::MAX;
            (self.acknowledged, self.busy) = (0, true);
        }
    }

    /// Whether a packet acknowledged now was queued for too long, unless CUBIC decides alone.
    fn is_too_long(&self, now: Instant, sent: Instant) -> bool {
        self.cubic_until.is_none_or(|until| until <= now)
            && now.saturating_duration_since(sent) > self.least.saturating_add(QUEUE_ALLOWED)
    }

    fn end_round(&mut self, now: Instant, cubic: u64, least_window: u64) {
        if self.cubic_until.is_some_and(|until| now < until) {
            return;
        }
        self.cubic_until = None;
        let took = now.saturating_duration_since(self.round_began);
        let delivered = self.acknowledged as f64 / took.as_secs_f64().max(1e-6);
        if self.bytes.is_some() && self.busy {
            let slow = delivered < SLOW_SHARE * self.rate_before_bound;
            self.slow_rounds = if slow { self.slow_rounds + 1 } else { self.slow_rounds.saturating_sub(1) };
            if self.slow_rounds >= MAX_SLOW_ROUNDS {
                self.bytes = None;
                self.cubic_until = Some(now + CUBIC_PERIOD);
                return;
            }
        }
        let allowed = self.least + QUEUE_ALLOWED;
        let share = allowed.as_secs_f64() / self.shortest.as_secs_f64().max(1e-6);
        if share < 1.0 {
            if self.bytes.is_none() {
                (self.rate_before_bound, self.slow_rounds) = (delivered, 0);
            }
            let bound = (self.round_window as f64 * share) as u64;
            self.bytes = Some(bound.max(least_window));
        } else {
            self.bytes = self
                .bytes
                .map(|bytes| (bytes as f64 * share.min(MAX_GROWTH)) as u64)
                .filter(|bytes| *bytes < cubic);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LEAST_WINDOW: u64 = 8 * 1200;

    /// Runs rounds of a bound over a path with a round-trip time by window; returns the window of each round, and the end
    /// time.
    fn rounds(
        bound: &mut QueueBound,
        mut now: Instant,
        count: usize,
        cubic: u64,
        rtt_of: impl Fn(u64) -> Duration,
    ) -> (Vec<u64>, Instant) {
        let mut windows = Vec::new();
        for _ in 0..count {
            let window = bound.bytes.unwrap_or(cubic).min(cubic);
            windows.push(window);
            let sent = now;
            now += rtt_of(window);
            let acknowledged = AckedPacket { sent, bytes: window, app_limited: false };
            bound.on_ack(now, &acknowledged, cubic, LEAST_WINDOW);
        }
        (windows, now)
    }

    /// A path with a delay of 50 ms and a rate.
    fn path(bytes_per_s: f64) -> impl Fn(u64) -> Duration {
        move |window| Duration::from_secs_f64((window as f64 / bytes_per_s).max(0.05))
    }

    #[test]
    fn the_queue_settles_at_the_allowed_length_and_the_bound_ends_when_the_path_widens() {
        let start = Instant::now();
        let mut bound = QueueBound::new(start);
        let (_, now) = rounds(&mut bound, start, 2, 5000, path(250_000.0));
        assert_eq!(bound.bytes, None, "a short queue needs no bound");
        let (windows, now) = rounds(&mut bound, now, 10, 60_000, path(250_000.0));
        // 75 ms at 250,000 bytes per second. The first round is measured against the small window before it.
        assert!(windows[4..].iter().all(|window| window.abs_diff(18_750) < 200), "{windows:?}");
        let (windows, _) = rounds(&mut bound, now, 20, 60_000, path(2e6));
        assert!(windows.is_sorted() && bound.bytes.is_none(), "{windows:?}");
    }

    #[test]
    fn a_queue_of_other_flows_is_left_to_cubic() {
        let start = Instant::now();
        let mut bound = QueueBound::new(start);
        let (_, now) = rounds(&mut bound, start, 2, 5000, path(250_000.0));
        let full = |_| Duration::from_millis(300);
        let (windows, now) = rounds(&mut bound, now, 8, 60_000, full);
        assert!(windows[1] < 60_000 && windows.iter().all(|window| *window >= LEAST_WINDOW), "{windows:?}");
        // Ten seconds without a bound, then a new one.
        let (windows, _) = rounds(&mut bound, now, 40, 60_000, full);
        assert!(windows[1..30].iter().all(|window| *window == 60_000), "{windows:?}");
        assert!(windows[30..].iter().any(|window| *window < 60_000), "{windows:?}");
    }

    #[test]
    fn extreme_round_trips_give_valid_windows() {
        let start = Instant::now();
        for (least, later) in [(0, 0), (0, 1 << 40), (1 << 40, 0), (1 << 40, 1 << 41)] {
            let mut bound = QueueBound::new(start);
            let (_, now) = rounds(&mut bound, start, 2, u64::MAX, |_| Duration::from_nanos(least));
            let (windows, _) = rounds(&mut bound, now, 20, u64::MAX, |_| Duration::from_nanos(later));
            assert!(windows.iter().all(|window| *window >= LEAST_WINDOW));
        }
    }
}
