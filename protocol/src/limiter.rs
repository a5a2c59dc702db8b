//! Token bucket: how fast a session may send, and the ceiling that sessions share.
//!
//! The bucket is kept as a *theoretical arrival time* (the generic cell rate algorithm, ITU-T I.371),
//! which is the same thing in integer nanoseconds: no rounding drifts, however small the pieces. A piece
//! is admitted while the bucket is not empty and may overdraw it, so that any piece passes sooner or later
//! and a piece's size never decides whether it is admitted.

use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};
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
const BURST: Duration = Duration::from_millis(20);

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

    /// Changes the rate; what has been spent stays spent.
    pub fn set_rate(&mut self, rate_bits_per_s: Option<u64>) {
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

/// A ceiling on the sum of all sessions, shared equally among those that have something to send.
///
/// What a session leaves of its share (because its own limit is lower) is not passed on to others.
#[derive(Debug)]
pub struct SharedCeiling {
    rate_bits_per_s: u64,
    active: AtomicU32,
}

impl SharedCeiling {
    /// A ceiling in bits per second.
    #[must_use]
    pub fn new(rate_bits_per_s: u64) -> Arc<Self> {
        Arc::new(Self { rate_bits_per_s, active: AtomicU32::new(0) })
    }

    /// A session's part in it, idle at first.
    #[must_use]
    pub fn join(self: &Arc<Self>) -> CeilingShare {
        CeilingShare { ceiling: Arc::clone(self), active: false }
    }

    /// Sessions that have something to send.
    #[must_use]
    pub fn active(&self) -> u32 {
        self.active.load(Ordering::Relaxed)
    }
}

/// One session's part in a [`SharedCeiling`]; given back when dropped.
#[derive(Debug)]
pub struct CeilingShare {
    ceiling: Arc<SharedCeiling>,
    active: bool,
}

impl CeilingShare {
    /// Says whether the session has something to send.
    pub fn set_active(&mut self, active: bool) {
        if self.active != active {
            self.active = active;
            if active {
                self.ceiling.active.fetch_add(1, Ordering::Relaxed);
            } else {
                self.ceiling.active.fetch_sub(1, Ordering::Relaxed);
            }
        }
    }

    /// The session's fair share now, in bits per second.
    #[must_use]
    pub fn rate_bits_per_s(&self) -> u64 {
        (self.ceiling.rate_bits_per_s / u64::from(self.ceiling.active().max(1))).max(1)
    }

    /// The lower of the session's own rate and its share.
    #[must_use]
    pub fn limit(&self, own: Option<u64>) -> u64 {
        own.unwrap_or(u64::MAX).min(self.rate_bits_per_s())
    }
}

impl Drop for CeilingShare {
    fn drop(&mut self) {
        self.set_active(false);
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
    fn every_three_second_window_is_within_five_percent_of_the_rate() {
        for rate in [2_000_000, 8_000_000, 16_000_000_u64] {
            for config in [LimiterConfig::quic(Some(rate)), LimiterConfig::websocket(Some(rate))] {
                for piece in [300, 1200, 4096] {
                    let sent = saturate(TokenBucket::new(config), piece, Time::from_ms(12_000));
                    for start_ms in (3..8_900).step_by(37) {
                        let window = Time::from_ms(start_ms)..Time::from_ms(start_ms + 3000);
                        let bits: u64 =
                            sent.iter().filter(|(t, _)| window.contains(t)).map(|(_, b)| b * 8).sum();
                        let ratio = bits as f64 / (3.0 * rate as f64);
                        assert!((0.95..=1.05).contains(&ratio), "{rate} {piece} {start_ms}: {ratio}");
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
        }
    }

    #[test]
    fn a_ceiling_is_shared_among_active_sessions_only() {
        let ceiling = SharedCeiling::new(12_000_000);
        let mut shares: Vec<_> = (0..4).map(|_| ceiling.join()).collect();
        for share in &mut shares[..3] {
            share.set_active(true);
            share.set_active(true);
        }
        assert_eq!(shares[0].limit(None), 4_000_000);
        assert_eq!(shares[0].limit(Some(2_000_000)), 2_000_000);
        shares.remove(0);
        assert_eq!(shares[0].limit(None), 6_000_000);
        shares.clear();
        assert_eq!(ceiling.active(), 0);
    }
}
