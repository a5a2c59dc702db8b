//! Estimate of the bandwidth-delay product: how many bytes to keep in flight. More would reduce the effect of later
//! priorities, since requests queued at the server can be reordered but bytes in flight cannot.

use std::time::Duration;

use crate::time::Time;

/// Time over which throughput is averaged.
const WINDOW: Duration = Duration::from_millis(400);
/// Time after which a window with a higher rate than the last one counts before its end, so that a fast link is used
/// after some tens of milliseconds.
const RISE: Duration = Duration::from_millis(50);
/// Time from an arrival to the request that follows it (a frame, decoding), added to the round trip.
const REACTION: Duration = Duration::from_millis(100);
/// Round trip assumed before one is measured.
const FIRST_RTT: Duration = Duration::from_millis(200);

/// Estimates of throughput and round-trip time.
#[derive(Clone, Debug)]
pub struct Estimate {
    rtt: Option<Duration>,
    window_start: Time,
    window_bytes: u64,
    /// Throughput of the last window; before the first one, the server's stated limit.
    bytes_per_s: f64,
}

impl Estimate {
    /// Without measurements yet.
    #[must_use]
    pub fn new(now: Time) -> Self {
        Self { rtt: None, window_start: now, window_bytes: 0, bytes_per_s: 0.0 }
    }

    /// Takes the rate limit that the server states.
    #[expect(clippy::cast_precision_loss, reason = "an estimate")]
    pub fn rate_hint(&mut self, bits_per_s: u64) {
        self.bytes_per_s = self.bytes_per_s.max(bits_per_s as f64 / 8.0);
    }

    /// Takes a measured round trip.
    pub fn measured_rtt(&mut self, rtt: Duration) {
        // Falls at once and rises slowly: higher values come from queues, not from the path.
        self.rtt = Some(self.rtt.map_or(rtt, |old| if rtt < old { rtt } else { (old * 7 + rtt) / 8 }));
    }

    /// Takes the arrival of bytes.
    pub fn received(&mut self, now: Time, bytes: usize) {
        let elapsed = now.since(self.window_start);
        if elapsed >= WINDOW {
            #[expect(clippy::cast_precision_loss, reason = "an estimate")]
            let rate = self.window_bytes as f64 / elapsed.as_secs_f64();
            // A window during which the link was not saturated says nothing about it: fall slowly.
            self.bytes_per_s = rate.max(self.bytes_per_s * 0.8);
            self.window_start = now;
            self.window_bytes = 0;
        }
        self.window_bytes += bytes as u64;
        let elapsed = now.since(self.window_start);
        if elapsed >= RISE {
            #[expect(clippy::cast_precision_loss, reason = "an estimate")]
            let rate = self.window_bytes as f64 / elapsed.as_secs_f64();
            self.bytes_per_s = self.bytes_per_s.max(rate);
        }
    }

    /// The round trip, once measured.
    #[must_use]
    pub fn rtt(&self) -> Option<Duration> {
        self.rtt
    }

    /// The throughput.
    #[must_use]
    pub fn bytes_per_s(&self) -> f64 {
        self.bytes_per_s
    }

    /// Bytes to keep in flight, clamped to `bounds`.
    #[must_use]
    pub fn depth_bytes(&self, bounds: std::ops::RangeInclusive<u64>) -> u64 {
        let covered = self.rtt.unwrap_or(FIRST_RTT) + REACTION;
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "saturates, and is clamped"
        )]
        let depth = (self.bytes_per_s * covered.as_secs_f64() * 1.25) as u64;
        depth.clamp(*bounds.start(), (*bounds.end()).max(*bounds.start()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fast_link_is_detected_within_a_window() {
        let mut estimate = Estimate::new(Time::ZERO);
        estimate.measured_rtt(Duration::from_millis(50));
        for ms in 0..=60 {
            estimate.received(Time::from_ms(ms), 2000);
        }
        assert!((1.9e6..2.2e6).contains(&estimate.bytes_per_s()), "{}", estimate.bytes_per_s());
    }

    #[test]
    fn depth_follows_rate_and_round_trip_within_bounds() {
        let mut estimate = Estimate::new(Time::ZERO);
        estimate.measured_rtt(Duration::from_millis(50));
        assert_eq!(estimate.depth_bytes(10_000..=1_000_000), 10_000);
        for ms in 0..2000 {
            estimate.received(Time::from_ms(ms), 2000);
        }
        let depth = estimate.depth_bytes(10_000..=1_000_000);
        // 2 MB/s over 150 ms, with a quarter on top.
        assert!((350_000..400_000).contains(&depth), "{depth}");
        assert_eq!(estimate.depth_bytes(10_000..=100_000), 100_000);
    }
}
