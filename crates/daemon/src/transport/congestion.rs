//! Congestion control of the server's QUIC connections: CUBIC (RFC 9438), and on top of it a bound on the queue that
//! the connection itself keeps in the path.
//!
//! CUBIC alone fills a path's queue until packets are dropped. What waits there cannot be overtaken, so at 2 Mbit/s
//! and 64 KiB of queue every change of mind costs a quarter of a second. `QueueBound` therefore looks, round trip
//! by round trip, at the shortest one of the round: what that lies above the shortest ever seen is time spent in queues
//! that never emptied. Where it is too long, the window shrinks to what the path carries within the time allowed
//! (the window law of FAST TCP, Wei et al. 2006, eq. 1, without its constant share).
//!
//! A window that empties only the connection's own queue costs no throughput. Where it does, the queue is that of
//! others, to whom the connection would give way until it starved, or what looks like a queue is jitter: CUBIC
//! then decides alone for a while (Copa changes its mode likewise: Arun and Balakrishnan 2018, §2.2). So others who fill
//! the queue are met as CUBIC would meet them. A path that becomes slower looks the same at first.

use std::any::Any;
use std::sync::Arc;
use std::time::{Duration, Instant};

use quinn::congestion::{Controller, ControllerFactory, ControllerMetrics, Cubic, CubicConfig};
use quinn_proto::RttEstimator;

/// First congestion window in bytes. The usual 14,720 would cost a round trip on the way to the first
/// frame; 60,000 is a quarter of a second at 2 Mbit/s and fits into common router queues.
pub(crate) const INITIAL_WINDOW_BYTES: u64 = 60_000;
/// Time in the path's queue that is allowed: enough for the jitter of clocks, radio links and delayed acknowledgements.
const QUEUE_ALLOWED: Duration = Duration::from_millis(25);
/// The window is not bound below so many of the largest packets: fewer cannot be told from delayed acknowledgements.
const LEAST_WINDOW_PACKETS: u64 = 8;
/// Growth of a bound in a round trip at most.
const GROWTH: f64 = 1.25;
/// Under a bound, a round in which less than this share of what came before is delivered is slow; …
const SLOW: f64 = 0.75;
/// … so many more slow ones than others, and the queue is left to CUBIC …
const PATIENCE_ROUNDS: u32 = 4;
/// … for so long.
const SHARED_FOR: Duration = Duration::from_secs(10);

/// Makes the controllers of a server's connections.
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
            least_window: LEAST_WINDOW_PACKETS * u64::from(current_mtu),
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
        // What is held back by the bound says nothing of what the path would carry, and where a queue is too long
        // already a larger window would only make it longer: slow start ends there, before it overruns the queue.
        let bound = self.window() < self.cubic.window();
        let held = app_limited || bound || self.bound.is_too_long(now, sent);
        self.cubic.on_ack(now, sent, bytes, held, rtt);
        let acknowledged = Acknowledged { sent, bytes, app_limited };
        self.bound.on_ack(now, &acknowledged, self.cubic.window(), self.least_window);
    }

    fn on_congestion_event(&mut self, now: Instant, sent: Instant, is_persistent: bool, lost_bytes: u64) {
        self.cubic.on_congestion_event(now, sent, is_persistent, lost_bytes);
    }

    fn on_mtu_update(&mut self, new_mtu: u16) {
        self.cubic.on_mtu_update(new_mtu);
        self.least_window = LEAST_WINDOW_PACKETS * u64::from(new_mtu);
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

/// A packet of which the client has said that it is there.
struct Acknowledged {
    sent: Instant,
    bytes: u64,
    /// Whether there was nothing more to send.
    app_limited: bool,
}

/// How many bytes may be in flight so that the path's queue stays short; see the module.
#[derive(Clone, Debug)]
struct QueueBound {
    /// `None`: as many as CUBIC says.
    bytes: Option<u64>,
    /// Shortest round trip ever.
    least: Duration,
    /// When this round began; it ends with the first acknowledgement of something sent later.
    round_began: Instant,
    /// Bytes that were allowed in flight then: those that the round's packets queued behind.
    round_window: u64,
    /// Shortest round trip of this round.
    shortest: Duration,
    /// Bytes acknowledged in this round, and whether there was always something to send.
    acknowledged: u64,
    busy: bool,
    /// Bytes a second delivered in the round that brought the bound.
    before: f64,
    /// Slow rounds more than others since then.
    slow_rounds: u32,
    /// Until when the queue is taken for somebody else's.
    shared_until: Option<Instant>,
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
            before: 0.0,
            slow_rounds: 0,
            shared_until: None,
        }
    }

    /// So many bytes that were sent at `sent` have been acknowledged, under a window of CUBIC's of `cubic` bytes.
    fn on_ack(&mut self, now: Instant, acknowledged: &Acknowledged, cubic: u64, least_window: u64) {
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

    /// Whether a packet acknowledged now waited for longer than is allowed, in a queue that is not somebody else's.
    fn is_too_long(&self, now: Instant, sent: Instant) -> bool {
        self.shared_until.is_none_or(|until| until <= now)
            && now.saturating_duration_since(sent) > self.least.saturating_add(QUEUE_ALLOWED)
    }

    fn end_round(&mut self, now: Instant, cubic: u64, least_window: u64) {
        if self.shared_until.is_some_and(|until| now < until) {
            return;
        }
        self.shared_until = None;
        let took = now.saturating_duration_since(self.round_began);
        let delivered = self.acknowledged as f64 / took.as_secs_f64().max(1e-6);
        if self.bytes.is_some() && self.busy {
            let slow = delivered < SLOW * self.before;
            self.slow_rounds = if slow { self.slow_rounds + 1 } else { self.slow_rounds.saturating_sub(1) };
            if self.slow_rounds >= PATIENCE_ROUNDS {
                self.bytes = None;
                self.shared_until = Some(now + SHARED_FOR);
                return;
            }
        }
        let allowed = self.least + QUEUE_ALLOWED;
        let share = allowed.as_secs_f64() / self.shortest.as_secs_f64().max(1e-6);
        if share < 1.0 {
            if self.bytes.is_none() {
                (self.before, self.slow_rounds) = (delivered, 0);
            }
            let bound = (self.round_window as f64 * share) as u64;
            self.bytes = Some(bound.max(least_window));
        } else {
            self.bytes = self
                .bytes
                .map(|bytes| (bytes as f64 * share.min(GROWTH)) as u64)
                .filter(|bytes| *bytes < cubic);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LEAST_WINDOW: u64 = 8 * 1200;

    /// Rounds of a bound over a path whose queue holds what the path cannot carry within the least round trip; gives
    /// the window of each round, and the time at the end.
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
            let acknowledged = Acknowledged { sent, bytes: window, app_limited: false };
            bound.on_ack(now, &acknowledged, cubic, LEAST_WINDOW);
        }
        (windows, now)
    }

    /// A path of 50 ms that carries so many bytes a second.
    fn path(bytes_per_s: f64) -> impl Fn(u64) -> Duration {
        move |window| Duration::from_secs_f64((window as f64 / bytes_per_s).max(0.05))
    }

    #[test]
    fn the_queue_becomes_as_long_as_allowed_and_the_bound_goes_when_the_path_widens() {
        let start = Instant::now();
        let mut bound = QueueBound::new(start);
        let (_, now) = rounds(&mut bound, start, 2, 5000, path(250_000.0));
        assert_eq!(bound.bytes, None, "a short queue needs no bound");
        let (windows, now) = rounds(&mut bound, now, 10, 60_000, path(250_000.0));
        // 75 ms at 250,000 bytes a second; the first round is judged by the window before it, which was small.
        assert!(windows[4..].iter().all(|window| window.abs_diff(18_750) < 200), "{windows:?}");
        let (windows, _) = rounds(&mut bound, now, 20, 60_000, path(2e6));
        assert!(windows.is_sorted() && bound.bytes.is_none(), "{windows:?}");
    }

    #[test]
    fn the_queue_of_others_is_left_to_cubic() {
        let start = Instant::now();
        let mut bound = QueueBound::new(start);
        let (_, now) = rounds(&mut bound, start, 2, 5000, path(250_000.0));
        let full = |_| Duration::from_millis(300);
        let (windows, now) = rounds(&mut bound, now, 8, 60_000, full);
        assert!(windows[1] < 60_000 && windows.iter().all(|window| *window >= LEAST_WINDOW), "{windows:?}");
        // Ten seconds without a bound, then another try.
        let (windows, _) = rounds(&mut bound, now, 40, 60_000, full);
        assert!(windows[1..30].iter().all(|window| *window == 60_000), "{windows:?}");
        assert!(windows[30..].iter().any(|window| *window < 60_000), "{windows:?}");
    }

    #[test]
    fn extremes_give_windows() {
        let start = Instant::now();
        for (least, later) in [(0, 0), (0, 1 << 40), (1 << 40, 0), (1 << 40, 1 << 41)] {
            let mut bound = QueueBound::new(start);
            let (_, now) = rounds(&mut bound, start, 2, u64::MAX, |_| Duration::from_nanos(least));
            let (windows, _) = rounds(&mut bound, now, 20, u64::MAX, |_| Duration::from_nanos(later));
            assert!(windows.iter().all(|window| *window >= LEAST_WINDOW));
        }
    }
}
