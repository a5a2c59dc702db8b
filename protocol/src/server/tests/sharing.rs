//! Sessions under a shared rate limit, in virtual time. Drivers have timers of whole milliseconds, which are late, and
//! clocks with different starts.

use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::sync::Arc;
use std::time::Duration;

use super::super::pace::Pace;
use super::MBIT;
use crate::limiter::LimiterConfig;
use crate::shared_rate_limit::{Limits, SharedRateLimit, Weight};
use crate::time::Time;

/// A session's link, with a socket buffer that accepts bytes when at most half full.
#[derive(Clone, Copy)]
struct Link {
    bytes_per_s: u64,
    buffer_bytes: u64,
    waiting_bytes: u64,
    at: Time,
}

impl Link {
    fn new(bits_per_s: u64, buffer_bytes: u64) -> Self {
        Self { bytes_per_s: bits_per_s / 8, buffer_bytes, waiting_bytes: 0, at: Time::ZERO }
    }

    fn take(&mut self, now: Time, bytes: u64) {
        let ms = u64::try_from(now.since(self.at).as_millis()).unwrap();
        self.waiting_bytes = self.waiting_bytes.saturating_sub(ms * self.bytes_per_s / 1000);
        self.at = self.at + Duration::from_millis(ms);
        self.waiting_bytes += bytes;
    }

    /// Milliseconds until the link accepts bytes again.
    fn blocked_ms(&self) -> u64 {
        if self.waiting_bytes < self.buffer_bytes {
            return 0;
        }
        (self.waiting_bytes - self.buffer_bytes / 2) * 1000 / self.bytes_per_s
    }
}

/// Times with data to send: `on_ms` of every `period_ms`.
#[derive(Clone, Copy)]
struct Shift {
    period_ms: u64,
    on_ms: u64,
    phase_ms: u64,
}

impl Shift {
    /// Whether there is data to send, and when that changes.
    fn at(self, now: Time) -> (bool, Time) {
        let now_ms = now.as_ns() / 1_000_000;
        let into = (now_ms + self.phase_ms) % self.period_ms;
        let on = into < self.on_ms;
        (on, Time::from_ms(now_ms + if on { self.on_ms } else { self.period_ms } - into))
    }
}

/// A session that has data to send always or periodically.
struct Sender {
    pace: Pace,
    piece: usize,
    began: Time,
    shift: Option<Shift>,
    link: Option<Link>,
    /// When its driver wakes.
    wakes: Time,
    sent: Vec<(Time, u64)>,
}

impl Sender {
    fn of(
        shared_rate_limit: &Arc<SharedRateLimit>,
        n: u64,
        own: Option<u64>,
        group: Option<u128>,
        weight: u64,
    ) -> Self {
        // Every third is over WebSocket.
        let (limiter, piece) = match n % 3 {
            2 => (LimiterConfig::websocket(own), 2800),
            _ => (LimiterConfig::quic(own), 1200),
        };
        let began = Time::from_ms(n * 7 % 100);
        let mut pace = Pace::new(limiter);
        pace.join(shared_rate_limit.join(group, Weight::new(weight).unwrap(), began));
        Self { pace, piece, began, shift: None, link: None, wakes: Time::ZERO, sent: Vec::new() }
    }

    fn plain(shared_rate_limit: &Arc<SharedRateLimit>, n: u64) -> Self {
        Self::of(shared_rate_limit, n, None, Some(n.into()), 1)
    }

    fn in_shifts(mut self, period_ms: u64, on_ms: u64, phase_ms: u64) -> Self {
        self.shift = Some(Shift { period_ms, on_ms, phase_ms: phase_ms % period_ms });
        self
    }

    fn behind(mut self, link: Link) -> Self {
        self.link = Some(link);
        self
    }

    /// Sends what is admitted; returns when to continue.
    fn go_on(&mut self, now: Time) -> Time {
        let own = Time::ZERO + now.since(self.began);
        let (busy, changes) = self.shift.map_or((true, Time::from_ns(u64::MAX)), |shift| shift.at(now));
        while self.pace.admits(own, busy) && busy {
            let wire = self.pace.spend(own, self.piece);
            self.sent.push((now, wire * 8));
            if let Some(link) = &mut self.link {
                link.take(now, wire);
                if link.blocked_ms() > 0 {
                    return now + Duration::from_millis(link.blocked_ms());
                }
            }
        }
        if !busy {
            return changes;
        }
        let ready = now + self.pace.ready_at().since(own);
        changes.min(Time::from_ms(ready.as_ns() / 1_000_000 + 1))
    }

    fn bits(&self, from_ms: u64, until_ms: u64) -> f64 {
        let window = Time::from_ms(from_ms)..Time::from_ms(until_ms);
        self.sent.iter().filter(|(at, _)| window.contains(at)).map(|(_, bits)| *bits as f64).sum()
    }
}

/// Runs senders between two moments, from a second on, when their clocks have all begun.
fn run(senders: &mut [Sender], from_ms: u64, until_ms: u64) {
    let from = Time::from_ms(from_ms);
    let mut wakes: BinaryHeap<_> =
        (0..).zip(&*senders).map(|(n, s)| Reverse((s.wakes.max(from), n))).collect();
    while let Some(Reverse((now, n))) = wakes.pop()
        && now < Time::from_ms(until_ms)
    {
        let sender: &mut Sender = &mut senders[n];
        sender.wakes = sender.go_on(now);
        wakes.push(Reverse((sender.wakes, n)));
    }
}

/// Asserts that the sum keeps to a rate within two percent over each 3 s of a span.
fn keeps_to(senders: &[Sender], rate: u64, span_ms: std::ops::Range<u64>, what: &str) {
    let mut sent: Vec<_> = senders.iter().flat_map(|sender| sender.sent.iter().copied()).collect();
    sent.sort_unstable();
    for from in (span_ms.start..=span_ms.end - 3000).step_by(37) {
        let until = Time::from_ms(from + 3000);
        let first = sent.partition_point(|(at, _)| *at < Time::from_ms(from));
        let bits: u64 = sent[first..].iter().take_while(|(at, _)| *at < until).map(|(_, bits)| bits).sum();
        let ratio = bits as f64 / (3 * rate) as f64;
        assert!((0.98..=1.02).contains(&ratio), "{what}: {ratio} of the rate from {from} ms");
    }
}

/// Jain, Chiu and Hawe 1984: 1 where all have the same, 1/n where one has all.
fn jain(parts: &[f64]) -> f64 {
    let (sum, squares): (f64, f64) = (parts.iter().sum(), parts.iter().map(|part| part * part).sum());
    sum * sum / (parts.len() as f64 * squares)
}

fn total(rate: u64) -> Arc<SharedRateLimit> {
    SharedRateLimit::new(Limits { total_bits_per_s: Some(rate), group_bits_per_s: None })
}

#[test]
fn rate_is_shared_fairly_in_every_three_seconds() {
    for (count, rate) in
        [(2, 20 * MBIT), (3, 2 * MBIT), (10, 20 * MBIT), (60, 20 * MBIT), (200, 20 * MBIT), (200, 200 * MBIT)]
    {
        let shared_rate_limit = total(rate);
        let mut senders: Vec<_> = (0..count).map(|n| Sender::plain(&shared_rate_limit, n)).collect();
        run(&mut senders, 1000, 8000);
        let what = format!("{count} at {rate}");
        keeps_to(&senders, rate, 1000..8000, &what);
        for from in (1000..=5000).step_by(111) {
            let parts: Vec<_> = senders.iter().map(|sender| sender.bits(from, from + 3000)).collect();
            assert!(jain(&parts) >= 0.98, "{what}: {} from {from} ms", jain(&parts));
        }
    }
}

#[test]
fn shares_are_proportional_to_weights() {
    let shared_rate_limit = total(16 * MBIT);
    let weights = [1, 2, 5, 5, 2, 1];
    let mut senders: Vec<_> = (0..)
        .zip(weights)
        .map(|(n, weight)| Sender::of(&shared_rate_limit, n, None, Some(n.into()), weight))
        .collect();
    run(&mut senders, 1000, 8000);
    keeps_to(&senders, 16 * MBIT, 1000..8000, "weights");
    // The first was alone for a moment, and had the burst of all.
    for from in (1100..=5000).step_by(111) {
        for (sender, weight) in senders.iter().zip(weights) {
            let ratio = sender.bits(from, from + 3000) / (3 * weight * MBIT) as f64;
            assert!((0.98..=1.02).contains(&ratio), "weight {weight}: {ratio} from {from} ms");
        }
    }
    // One is given more from now on.
    senders[0].pace.set_weight(Time::from_ms(8000), Weight::new(5).unwrap());
    run(&mut senders, 8000, 12_000);
    let ratio = senders[0].bits(9000, 12_000) / (3.0 * 4.0 * MBIT as f64);
    assert!((0.98..=1.02).contains(&ratio), "{ratio}");
}

#[test]
fn total_stays_at_the_limit_while_sessions_come_and_go() {
    let shared_rate_limit = total(20 * MBIT);
    // Half of them have data to send for 500 ms of every 1500.
    let mut senders: Vec<_> = (0..60)
        .map(|n| {
            let sender = Sender::plain(&shared_rate_limit, n);
            if n % 2 == 0 { sender } else { sender.in_shifts(1500, 500, 50 * n) }
        })
        .collect();
    run(&mut senders, 1000, 9000);
    keeps_to(&senders, 20 * MBIT, 1000..9000, "coming and going");
    let stayed: Vec<_> = senders.iter().step_by(2).map(|sender| sender.bits(2000, 5000)).collect();
    assert!(jain(&stayed) >= 0.98, "{}", jain(&stayed));
}

#[test]
fn short_pauses_do_not_exceed_the_shared_rate_limit() {
    let rate = 20 * MBIT;
    let shared_rate_limit = total(rate);
    // Each saves a burst in each pause.
    let mut senders: Vec<_> =
        (0..40).map(|n| Sender::plain(&shared_rate_limit, n).in_shifts(60, 30, 11 * n)).collect();
    run(&mut senders, 1000, 8000);
    keeps_to(&senders, rate, 1000..8000, "pauses");
}

#[test]
fn address_keeps_to_its_group_limit() {
    let shared_rate_limit =
        SharedRateLimit::new(Limits { total_bits_per_s: Some(20 * MBIT), group_bits_per_s: Some(4 * MBIT) });
    let of_one = (0..20).map(|n| Sender::of(&shared_rate_limit, n, None, Some(1), 1));
    let mut senders: Vec<_> = of_one.chain((20..25).map(|n| Sender::plain(&shared_rate_limit, n))).collect();
    run(&mut senders, 1000, 9000);
    keeps_to(&senders, 20 * MBIT, 1000..9000, "all");
    keeps_to(&senders[..20], 4 * MBIT, 1000..9000, "one address");
    for from in (1000..=6000).step_by(111) {
        let parts: Vec<_> = senders.iter().map(|sender| sender.bits(from, from + 3000)).collect();
        assert!(jain(&parts[..20]) >= 0.98, "{}", jain(&parts[..20]));
        for part in &parts[20..] {
            let ratio = part / (3.0 * 3.2 * MBIT as f64);
            assert!((0.98..=1.02).contains(&ratio), "{ratio}");
        }
    }
    // Without a shared rate limit of all, an address has its own.
    let shared_rate_limit =
        SharedRateLimit::new(Limits { total_bits_per_s: None, group_bits_per_s: Some(4 * MBIT) });
    let mut senders: Vec<_> =
        (0..6).map(|n| Sender::of(&shared_rate_limit, n, None, Some((n / 3).into()), 1)).collect();
    run(&mut senders, 1000, 5000);
    keeps_to(&senders[..3], 4 * MBIT, 1000..5000, "the first address");
    keeps_to(&senders[3..], 4 * MBIT, 1000..5000, "the second address");
}

#[test]
fn unused_share_goes_to_the_others() {
    // Its own rate is low.
    let shared_rate_limit = total(12 * MBIT);
    let mut senders: Vec<_> = (0..4).map(|n| Sender::plain(&shared_rate_limit, n)).collect();
    senders[0] = Sender::of(&shared_rate_limit, 0, Some(MBIT), Some(0), 1);
    run(&mut senders, 1000, 6000);
    keeps_to(&senders, 12 * MBIT, 1000..6000, "own rate");
    let others = senders[1].bits(2000, 5000) / (3.0 * 11.0 / 3.0 * MBIT as f64);
    assert!((0.98..=1.02).contains(&others), "{others}");
}

#[test]
fn share_of_a_slow_link_goes_to_the_others() {
    for buffer_bytes in [4_000, 64_000, 400_000] {
        let shared_rate_limit = total(12 * MBIT);
        let mut senders: Vec<_> = (0..4).map(|n| Sender::plain(&shared_rate_limit, n)).collect();
        senders[3] = Sender::plain(&shared_rate_limit, 3).behind(Link::new(MBIT, buffer_bytes));
        run(&mut senders, 1000, 12_000);
        keeps_to(&senders, 12 * MBIT, 3000..12_000, &format!("buffer of {buffer_bytes}"));
        // It gets all that its link takes, apart from what is in the socket buffer.
        let slow = senders[3].bits(5000, 11_000) - (6 * MBIT) as f64;
        assert!(
            slow.abs() <= (buffer_bytes * 8) as f64 / 2.0 + 0.02 * (6 * MBIT) as f64,
            "{buffer_bytes}: {slow}"
        );
        // The link becomes fast: it has its part of 3 Mbit/s within a second.
        senders[3].link = None;
        run(&mut senders, 12_000, 16_000);
        let fast = senders[3].bits(13_000, 16_000) / (9 * MBIT) as f64;
        assert!((0.98..=1.02).contains(&fast), "buffer of {buffer_bytes}: {fast}");
        keeps_to(&senders, 12 * MBIT, 10_000..16_000, "when the link becomes fast");
    }
}

#[test]
fn slow_links_below_the_limit_are_not_delayed() {
    let shared_rate_limit = total(12 * MBIT);
    let mut senders: Vec<_> =
        (0..10).map(|n| Sender::plain(&shared_rate_limit, n).behind(Link::new(MBIT, 16_000))).collect();
    run(&mut senders, 1000, 8000);
    for sender in &senders {
        let ratio = sender.bits(3000, 8000) / (5 * MBIT) as f64;
        assert!((0.97..=1.03).contains(&ratio), "{ratio}");
    }
    assert!(shared_rate_limit.allocated_bits_per_s(Time::from_ms(8000)) < 11 * MBIT);
}

#[test]
fn session_with_a_new_address_shares_its_group_limit() {
    let shared_rate_limit =
        SharedRateLimit::new(Limits { total_bits_per_s: None, group_bits_per_s: Some(6 * MBIT) });
    let mut senders: Vec<_> =
        (0..3).map(|n| Sender::of(&shared_rate_limit, n, None, Some((n / 2).into()), 1)).collect();
    run(&mut senders, 1000, 5000);
    let parts = |senders: &[Sender], from| -> Vec<u64> {
        senders.iter().map(|s| (s.bits(from, from + 3000) / 3e6).round() as u64).collect()
    };
    assert_eq!(parts(&senders, 2000), [3, 3, 6]);
    let own = Time::ZERO + Time::from_ms(5000).since(senders[0].began);
    senders[0].pace.set_group(own, Some(1));
    run(&mut senders, 5000, 9000);
    assert_eq!(parts(&senders, 6000), [3, 6, 3]);
    // In none it has no shared rate limit of a group, and none of all here.
    senders.iter_mut().for_each(|sender| sender.pace.set_group(Time::from_ms(9000), None));
    let [sender, ..] = &mut senders[..] else { unreachable!() };
    for _ in 0..10_000 {
        assert!(sender.pace.admits(Time::from_ms(9001), true));
        sender.pace.spend(Time::from_ms(9001), 1200);
    }
}

#[test]
fn session_with_a_raised_share_wakes_in_time() {
    let rate = 80_000;
    let shared_rate_limit = total(rate);
    let mut senders: Vec<_> = (0..19).map(|n| Sender::plain(&shared_rate_limit, n)).collect();
    for (sender, n) in senders.iter_mut().zip(1..) {
        sender.wakes = Time::from_ms(1000 + 130 * n);
    }
    // A piece takes it 2.5 s; the others end when it has just sent one.
    run(&mut senders, 1000, 11_500);
    let mut last = senders.remove(9);
    let before = last.sent.len();
    let until = last.sent[before - 1].0 + Duration::from_millis(2300);
    assert!(until > Time::from_ms(11_500), "it would have gone on soon: {:?}", last.sent);
    drop(senders);
    run(std::slice::from_mut(&mut last), 11_500, 16_000);
    // What is left of the piece's debt takes 130 ms at most, it looks again within 25, and the shared rate limit's
    // own bucket may be overdrawn by a piece of another. At the old rate it would have slept for a second and a half.
    let first = last.sent[before].0;
    assert!(first <= Time::from_ms(11_700), "{first:?}");
    let ratio = last.bits(12_000, 15_000) / (3 * rate) as f64;
    assert!((0.95..=1.05).contains(&ratio), "{ratio}");
}

#[test]
fn extreme_limits_and_rates_do_not_overflow() {
    for total_bits_per_s in [None, Some(0), Some(1), Some(u64::MAX)] {
        for group_bits_per_s in [None, Some(0), Some(1), Some(u64::MAX)] {
            let shared_rate_limit = SharedRateLimit::new(Limits { total_bits_per_s, group_bits_per_s });
            let own = [None, Some(0), Some(1), Some(u64::MAX)];
            let mut senders: Vec<_> = (0..)
                .zip(own)
                .map(|(n, own)| {
                    Sender::of(&shared_rate_limit, n, own, Some((n / 2).into()), [1, 100][n as usize % 2])
                })
                .collect();
            for moment in [1000, 1001, 2000, 1 << 40, u64::MAX / 2_000_000, u64::MAX] {
                for sender in &mut senders {
                    let now = Time::from_ms(moment);
                    for _ in 0..3 {
                        if sender.pace.admits(now, true) {
                            sender.pace.spend(now, usize::MAX >> 8);
                        }
                    }
                    sender.pace.set_group(now, Some(u128::MAX));
                    sender.pace.set_weight(now, Weight::new(50).unwrap());
                    let _ = sender.pace.ready_at();
                }
                let _ = shared_rate_limit.allocated_bits_per_s(Time::from_ms(moment));
            }
        }
    }
}
