//! Token bucket: how fast a session may send. What sessions share is in [`crate::shared_rate_limit`].
//!
//! The bucket is kept as a *theoretical arrival time* (the generic cell rate algorithm, ITU-T I.371),
//! which is the same thing in integer nanoseconds: no rounding drifts, however small the pieces. A piece
//! is admitted while the bucket is not empty and may overdraw it, so that any piece passes sooner or later
//! and a piece's size never decides whether it is admitted.

use std::time::Duration;

use crate::time::Time;

/// What the limiter admits, and how it counts bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LimiterConfig {
    /// Bits per second on the wire; `None` for no limit.
    pub rate_bits_per_s: Option<u64>,
    /// How much may be sent at once after a pause, as time at the full rate. Longer bursts waste less
    /// of the link when timers are late, shorter ones queue less in the network.
    pub burst: Duration,
    /// Payload bytes that a packet carries, for counting headers.
    pub packet_payload_bytes: u32,
    /// Bytes that each packet costs beside its payload (IP, UDP or TCP, QUIC or TLS headers).
    pub packet_overhead_bytes: u32,
    /// Bytes that each frame or stream costs beside its payload.
    pub frame_overhead_bytes: u32,
}

/// Burst of the presets: above the lateness of ordinary timers, below what would be felt as delay.
pub(crate) const BURST: Duration = Duration::from_millis(20);

impl LimiterConfig {
    /// For QUIC over IPv4: IP 20, UDP 8, short header about 13 and tag 16 bytes on packets of 1200 to
    /// 1452 bytes; a stream frame costs about 6 and a stream's end little.
    #[must_use]
    pub const fn quic(rate_bits_per_s: Option<u64>) -> Self {
        Self {
            rate_bits_per_s,
            burst: BURST,
            packet_payload_bytes: 1250,
            packet_overhead_bytes: 57,
            frame_overhead_bytes: 8,
        }
    }

    /// For WebSocket over TCP over IPv4: IP 20 and TCP with timestamps 32 bytes on segments of 1448
    /// bytes; a WebSocket header costs up to 4 and the frame's own head about 14.
    #[must_use]
    pub const fn websocket(rate_bits_per_s: Option<u64>) -> Self {
        Self {
            rate_bits_per_s,
            burst: BURST,
            packet_payload_bytes: 1448,
            packet_overhead_bytes: 52,
            frame_overhead_bytes: 18,
        }
    }

    /// Bytes on the wire that a frame or piece of this many bytes costs, estimated: headers are shared
    /// with what travels in the same packet, so they are charged in proportion.
    #[must_use]
    pub fn wire_bytes(&self, payload: usize) -> u64 {
        let bytes = payload as u64 + u64::from(self.frame_overhead_bytes);
        let headers = bytes * u64::from(self.packet_overhead_bytes);
        bytes + headers.div_ceil(u64::from(self.packet_payload_bytes.max(1)))
    }
}

/// A token bucket.
#[derive(Clone, Debug)]
pub struct TokenBucket {
    config: LimiterConfig,
    /// When the bucket would be full again if nothing more were sent.
    full_at: Time,
}

impl TokenBucket {
    /// A full bucket.
    #[must_use]
    pub const fn new(config: LimiterConfig) -> Self {
        Self { config, full_at: Time::ZERO }
    }

    /// What the bucket admits.
    #[must_use]
    pub const fn config(&self) -> &LimiterConfig {
        &self.config
    }

    /// Changes the rate; what was saved or overdrawn stays so in bytes, as far as the bucket holds them: a debt that was
    /// seconds at a low rate is less at a higher one.
    pub fn set_rate(&mut self, now: Time, rate_bits_per_s: Option<u64>) {
        if let (Some(old), Some(new)) = (self.config.rate_bits_per_s, rate_bits_per_s) {
            let scaled = |span: Duration| {
                let ns = span.as_nanos().saturating_mul(u128::from(old.max(1))) / u128::from(new.max(1));
                Duration::from_nanos(u64::try_from(ns).unwrap_or(u64::MAX))
            };
            // An empty bucket is full after the time of a burst.
            let empty = now + self.config.burst;
            self.full_at = if self.full_at > empty {
                empty + scaled(self.full_at.since(empty))
            } else {
                empty - scaled(empty.since(self.full_at.max(now)))
            };
        }
        self.config.rate_bits_per_s = rate_bits_per_s;
    }

    /// From when on something is admitted.
    #[must_use]
    pub fn ready_at(&self) -> Time {
        match self.config.rate_bits_per_s {
            Some(_) => self.full_at - self.config.burst,
            None => Time::ZERO,
        }
    }

    /// Whether something is admitted now.
    #[must_use]
    pub fn admits(&self, now: Time) -> bool {
        self.ready_at() <= now
    }

    /// Takes the tokens of a frame or piece of this many payload bytes; gives its bytes on the wire.
    /// The bucket may be overdrawn.
    pub fn spend(&mut self, now: Time, payload: usize) -> u64 {
        let wire = self.config.wire_bytes(payload);
        if let Some(rate) = self.config.rate_bits_per_s {
            let ns = u128::from(wire) * 8_000_000_000 / u128::from(rate.max(1));
            let cost = Duration::from_nanos(u64::try_from(ns).unwrap_or(u64::MAX));
            self.full_at = self.full_at.max(now) + cost;
        }
        wire
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Sends pieces as fast as a bucket admits them; gives (time, bytes on the wire).
    fn saturate(mut bucket: TokenBucket, piece: usize, until: Time) -> Vec<(Time, u64)> {
        let mut now = Time::from_ms(3);
        let mut sent = Vec::new();
        while now < until {
            while bucket.admits(now) {
                sent.push((now, bucket.spend(now, piece)));
            }
            // Timers of real drivers tick in whole milliseconds, late.
            now = Time::from_ms(bucket.ready_at().as_ns() / 1_000_000 + 1);
        }
        sent
    }

    #[test]
    fn every_three_second_window_is_within_two_percent_of_the_rate() {
        for rate in [2_000_000, 8_000_000, 16_000_000_u64] {
            for config in [LimiterConfig::quic(Some(rate)), LimiterConfig::websocket(Some(rate))] {
                for piece in [300, 1200, 4096] {
                    let sent = saturate(TokenBucket::new(config), piece, Time::from_ms(12_000));
                    for start_ms in (3..8_900).step_by(37) {
                        let window = Time::from_ms(start_ms)..Time::from_ms(start_ms + 3000);
                        let bits: u64 =
                            sent.iter().filter(|(t, _)| window.contains(t)).map(|(_, b)| b * 8).sum();
                        let ratio = bits as f64 / (3.0 * rate as f64);
                        assert!((0.98..=1.02).contains(&ratio), "{rate} {piece} {start_ms}: {ratio}");
                    }
                }
            }
        }
    }

    #[test]
    fn a_pause_earns_one_burst_and_no_more() {
        let config = LimiterConfig::quic(Some(8_000_000));
        let mut bucket = TokenBucket::new(config);
        let now = Time::from_ms(60_000);
        let mut bytes = 0;
        while bucket.admits(now) {
            bytes += bucket.spend(now, 1000);
        }
        // 20 ms at 1 MB/s, and the piece that overdraws.
        assert!((20_000..=20_000 + config.wire_bytes(1000)).contains(&bytes), "{bytes}");
    }

    #[test]
    fn no_rate_admits_everything() {
        let mut bucket = TokenBucket::new(LimiterConfig::quic(None));
        for _ in 0..1000 {
            assert!(bucket.admits(Time::ZERO));
            bucket.spend(Time::ZERO, 1 << 20);
        }
    }

    #[test]
    fn extreme_rates_do_not_overflow() {
        for rate in [0, 1, 1000, u64::MAX] {
            let mut bucket = TokenBucket::new(LimiterConfig::quic(Some(rate)));
            bucket.spend(Time::from_ms(1), usize::MAX >> 8);
            let _ = bucket.ready_at();
            for other in [0, 1, u64::MAX] {
                bucket.set_rate(Time::from_ms(2), Some(other));
                let _ = bucket.ready_at();
            }
        }
    }
    #[test]
    fn a_debt_of_seconds_at_an_old_rate_held_a_session_up_at_a_new_one() {
        let mut bucket = TokenBucket::new(LimiterConfig::quic(Some(8_000)));
        let now = Time::from_ms(5000);
        let wire = bucket.spend(now, 5000);
        assert!(bucket.ready_at().since(now) > Duration::from_secs(5));
        bucket.set_rate(now, Some(8_000_000));
        let debt = bucket.ready_at().since(now);
        // A thousand bytes take a millisecond; at the old rate 20 bytes had been saved.
        assert_eq!(debt.as_micros(), u128::from(wire) - 20);
        bucket.set_rate(now, Some(8_000));
        assert_eq!(bucket.ready_at().since(now).as_millis(), u128::from(wire) - 20);
    }

    #[test]
    fn what_was_saved_stays_so_in_bytes_as_far_as_the_bucket_holds_them() {
        let admitted = |from: u64, to: u64| {
            let mut bucket = TokenBucket::new(LimiterConfig::quic(Some(from)));
            let now = Time::from_ms(5000);
            bucket.set_rate(now, Some(to));
            let mut bytes = 0;
            while bucket.admits(now) {
                bytes += bucket.spend(now, 100);
            }
            bytes
        };
        let piece = LimiterConfig::quic(None).wire_bytes(100);
        for (from, to, saved) in [(8_000_000, 80_000_000, 20_000), (80_000_000, 8_000_000, 20_000)] {
            let bytes = admitted(from, to);
            assert!((saved..=saved + piece).contains(&bytes), "{from} to {to}: {bytes}");
        }
    }
}
