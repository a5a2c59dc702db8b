//! Token bucket, and the limiter of a session's sending rate. The rate that sessions share is in
//! [`crate::shared_rate_limit`].
//!
//! The bucket is kept as a *theoretical arrival time* (the generic cell rate algorithm, ITU-T I.371): the moment at
//! which it would be full again. This is equivalent to counting tokens, in integer nanoseconds, so rounding does not
//! accumulate however small the pieces are.

use std::time::Duration;

use crate::time::Time;

/// A token bucket: admits `rate_per_s` units per second on average and a burst after a pause.
///
/// A unit is whatever the caller counts: bits, bytes, messages or sessions. Time is an argument. Calls are O(1), never
/// panic and saturate at extremes; a rate of 0 counts as 1. The bucket has 24 to 32 bytes of state and no allocation.
///
/// There are two ways to take tokens. [`admits`](Self::admits) and [`take`](Self::take) let the bucket be overdrawn: a
/// piece of any size is admitted while the bucket is not empty, and the debt delays the next one.
/// [`try_take`](Self::try_take) refuses what the bucket does not hold.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TokenBucket {
    rate_per_s: Option<u64>,
    burst: Duration,
    /// When the bucket would be full again if nothing more were taken.
    full_at: Time,
}

impl TokenBucket {
    /// A full bucket. `rate_per_s` is in units per second, `None` for no limit; `burst` is the capacity, as the time in
    /// which an empty bucket becomes full.
    #[must_use]
    pub const fn new(rate_per_s: Option<u64>, burst: Duration) -> Self {
        Self { rate_per_s, burst, full_at: Time::ZERO }
    }

    /// Units per second; `None` for no limit.
    #[must_use]
    pub const fn rate_per_s(&self) -> Option<u64> {
        self.rate_per_s
    }

    /// The time that the rate takes to earn `units`.
    fn cost(rate_per_s: u64, units: u64) -> Duration {
        let ns = u128::from(units) * 1_000_000_000 / u128::from(rate_per_s.max(1));
        Duration::from_nanos(u64::try_from(ns).unwrap_or(u64::MAX))
    }

    /// Changes the rate. Saved tokens and debt keep their value in units, up to the new capacity.
    pub fn set_rate(&mut self, now: Time, rate_per_s: Option<u64>) {
        if let (Some(old), Some(new)) = (self.rate_per_s, rate_per_s) {
            let scaled = |span: Duration| {
                let ns = span.as_nanos().saturating_mul(u128::from(old.max(1))) / u128::from(new.max(1));
                Duration::from_nanos(u64::try_from(ns).unwrap_or(u64::MAX))
            };
            // An empty bucket is full after the time of a burst.
            let empty = now + self.burst;
            self.full_at = if self.full_at > empty {
                empty + scaled(self.full_at.since(empty))
            } else {
                empty - scaled(empty.since(self.full_at.max(now)))
            };
        }
        self.rate_per_s = rate_per_s;
    }

    /// The first moment at which [`admits`](Self::admits) is true.
    #[must_use]
    pub fn ready_at(&self) -> Time {
        match self.rate_per_s {
            Some(_) => self.full_at - self.burst,
            None => Time::ZERO,
        }
    }

    /// Whether the bucket is not overdrawn.
    #[must_use]
    pub fn admits(&self, now: Time) -> bool {
        self.ready_at() <= now
    }

    /// Whether the bucket is full.
    #[must_use]
    pub fn is_full(&self, now: Time) -> bool {
        self.full_at <= now
    }

    /// Takes `units`, if necessary on credit; returns the time that the rate takes to earn them, zero without a limit.
    pub fn take(&mut self, now: Time, units: u64) -> Duration {
        let Some(rate) = self.rate_per_s else { return Duration::ZERO };
        let cost = Self::cost(rate, units);
        self.full_at = self.full_at.max(now) + cost;
        cost
    }

    /// Takes `units` if the bucket holds so many; returns whether it did.
    #[must_use]
    pub fn try_take(&mut self, now: Time, units: u64) -> bool {
        let Some(rate) = self.rate_per_s else { return true };
        let full_at = self.full_at.max(now) + Self::cost(rate, units);
        let holds = full_at.since(now) <= self.burst;
        if holds {
            self.full_at = full_at;
        }
        holds
    }
}

/// A session's sending rate, and how bytes on the wire are counted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LimiterConfig {
    /// Bits per second on the wire; `None` for no limit.
    pub rate_bits_per_s: Option<u64>,
    /// Capacity of the bucket, as time at the full rate. Longer bursts waste less of the link when timers are late,
    /// shorter ones queue less in the network.
    pub burst: Duration,
    /// Payload bytes that a packet carries, for counting headers.
    pub packet_payload_bytes: u32,
    /// Bytes that each packet costs beside its payload (IP, UDP or TCP, QUIC or TLS headers).
    pub packet_overhead_bytes: u32,
    /// Bytes that each frame or stream costs beside its payload.
    pub frame_overhead_bytes: u32,
}

/// Burst of the presets: longer than ordinary timers are late, shorter than a delay that a user notices.
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

    /// Estimated bytes on the wire of a frame or piece with `payload` bytes. Packets are shared with other frames, so
    /// their headers are charged in proportion.
    #[must_use]
    pub fn wire_bytes(&self, payload: usize) -> u64 {
        let bytes = (payload as u64).saturating_add(u64::from(self.frame_overhead_bytes));
        let headers = bytes.saturating_mul(u64::from(self.packet_overhead_bytes));
        bytes.saturating_add(headers.div_ceil(u64::from(self.packet_payload_bytes.max(1))))
    }
}

/// Limits the bits that a session puts on the wire: a [`TokenBucket`] that counts packet and frame headers.
#[derive(Clone, Debug)]
pub struct SendLimiter {
    config: LimiterConfig,
    bucket: TokenBucket,
}

impl SendLimiter {
    /// With a full bucket.
    #[must_use]
    pub const fn new(config: LimiterConfig) -> Self {
        Self { config, bucket: TokenBucket::new(config.rate_bits_per_s, config.burst) }
    }

    /// Bits per second on the wire; `None` for no limit.
    #[must_use]
    pub const fn rate_bits_per_s(&self) -> Option<u64> {
        self.bucket.rate_per_s()
    }

    /// Changes the rate. Saved tokens and debt keep their value in bits: a debt of seconds at a low rate is paid
    /// sooner at a higher one.
    pub fn set_rate(&mut self, now: Time, rate_bits_per_s: Option<u64>) {
        self.bucket.set_rate(now, rate_bits_per_s);
    }

    /// The first moment at which something is admitted.
    #[must_use]
    pub fn ready_at(&self) -> Time {
        self.bucket.ready_at()
    }

    /// Whether a frame or piece is admitted now. Its size does not matter, so that pieces of any size pass in time.
    #[must_use]
    pub fn admits(&self, now: Time) -> bool {
        self.bucket.admits(now)
    }

    /// Takes the tokens of a frame or piece with `payload` bytes, if necessary on credit; returns its bytes on the
    /// wire.
    pub fn spend(&mut self, now: Time, payload: usize) -> u64 {
        let wire_bytes = self.config.wire_bytes(payload);
        self.bucket.take(now, wire_bytes.saturating_mul(8));
        wire_bytes
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Sends pieces as fast as a limiter admits them; returns (time, bytes on the wire).
    fn saturate(mut limiter: SendLimiter, piece: usize, until: Time) -> Vec<(Time, u64)> {
        let mut now = Time::from_ms(3);
        let mut sent = Vec::new();
        while now < until {
            while limiter.admits(now) {
                sent.push((now, limiter.spend(now, piece)));
            }
            // Timers of real drivers tick in whole milliseconds, late.
            now = Time::from_ms(limiter.ready_at().as_ns() / 1_000_000 + 1);
        }
        sent
    }

    #[test]
    fn every_three_second_window_is_within_two_percent_of_the_rate() {
        for rate in [2_000_000, 8_000_000, 16_000_000_u64] {
            for config in [LimiterConfig::quic(Some(rate)), LimiterConfig::websocket(Some(rate))] {
                for piece in [300, 1200, 4096] {
                    let sent = saturate(SendLimiter::new(config), piece, Time::from_ms(12_000));
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
        let mut limiter = SendLimiter::new(config);
        let now = Time::from_ms(60_000);
        let mut bytes = 0;
        while limiter.admits(now) {
            bytes += limiter.spend(now, 1000);
        }
        // 20 ms at 1 MB/s, and the piece that overdraws.
        assert!((20_000..=20_000 + config.wire_bytes(1000)).contains(&bytes), "{bytes}");
    }

    #[test]
    fn no_rate_admits_everything() {
        let mut limiter = SendLimiter::new(LimiterConfig::quic(None));
        for _ in 0..1000 {
            assert!(limiter.admits(Time::ZERO));
            limiter.spend(Time::ZERO, 1 << 20);
        }
    }

    #[test]
    fn extreme_rates_do_not_overflow() {
        for rate in [0, 1, 1000, u64::MAX] {
            let mut limiter = SendLimiter::new(LimiterConfig::quic(Some(rate)));
            limiter.spend(Time::from_ms(1), usize::MAX);
            let _ = limiter.ready_at();
            for other in [0, 1, u64::MAX] {
                limiter.set_rate(Time::from_ms(2), Some(other));
                let _ = limiter.ready_at();
            }
        }
    }

    #[test]
    fn debt_of_seconds_at_an_old_rate_is_paid_at_the_new_rate() {
        let mut limiter = SendLimiter::new(LimiterConfig::quic(Some(8_000)));
        let now = Time::from_ms(5000);
        let wire = limiter.spend(now, 5000);
        assert!(limiter.ready_at().since(now) > Duration::from_secs(5));
        limiter.set_rate(now, Some(8_000_000));
        let debt = limiter.ready_at().since(now);
        // A thousand bytes take a millisecond; at the old rate 20 bytes had been saved.
        assert_eq!(debt.as_micros(), u128::from(wire) - 20);
        limiter.set_rate(now, Some(8_000));
        assert_eq!(limiter.ready_at().since(now).as_millis(), u128::from(wire) - 20);
    }

    #[test]
    fn saved_tokens_keep_their_value_up_to_the_capacity() {
        let admitted = |from: u64, to: u64| {
            let mut limiter = SendLimiter::new(LimiterConfig::quic(Some(from)));
            let now = Time::from_ms(5000);
            limiter.set_rate(now, Some(to));
            let mut bytes = 0;
            while limiter.admits(now) {
                bytes += limiter.spend(now, 100);
            }
            bytes
        };
        let piece = LimiterConfig::quic(None).wire_bytes(100);
        for (from, to, saved) in [(8_000_000, 80_000_000, 20_000), (80_000_000, 8_000_000, 20_000)] {
            let bytes = admitted(from, to);
            assert!((saved..=saved + piece).contains(&bytes), "{from} to {to}: {bytes}");
        }
    }

    #[test]
    fn try_take_admits_the_capacity_and_then_the_rate() {
        // 500 messages per second, 2000 at once.
        let mut bucket = TokenBucket::new(Some(500), Duration::from_secs(4));
        let now = Time::from_ms(1);
        assert!(!bucket.try_take(now, 2001) && bucket.is_full(now), "a refusal takes nothing");
        assert_eq!((0..10_000).filter(|_| bucket.try_take(now, 1)).count(), 2000);
        let later = now + Duration::from_secs(1);
        assert_eq!((0..10_000).filter(|_| bucket.try_take(later, 1)).count(), 500);
        assert!(TokenBucket::new(None, Duration::ZERO).try_take(now, u64::MAX));
    }

    #[test]
    fn extreme_units_and_bursts_do_not_overflow() {
        for (rate, burst) in [(0, Duration::ZERO), (1, Duration::MAX), (u64::MAX, Duration::MAX)] {
            let mut bucket = TokenBucket::new(Some(rate), burst);
            for now in [Time::ZERO, Time::from_ns(u64::MAX)] {
                bucket.take(now, u64::MAX);
                let _ = (bucket.try_take(now, u64::MAX), bucket.is_full(now), bucket.admits(now));
                bucket.set_rate(now, Some(u64::MAX - rate));
            }
        }
    }
}
