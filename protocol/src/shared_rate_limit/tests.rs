//! Tests of the table through its public interface.

use super::*;

const BUSY: SendRequest = SendRequest { active: true, own_bits_per_s: None, own_ready: true };
const IDLE: SendRequest = SendRequest { active: false, own_bits_per_s: None, own_ready: true };

fn both(total: u64, group: u64) -> Arc<SharedRateLimit> {
    SharedRateLimit::new(Limits { total_bits_per_s: Some(total), group_bits_per_s: Some(group) })
}

#[test]
fn sessions_that_left_use_no_memory() {
    let shared_rate_limit = both(8_000_000, 1_000_000);
    for round in 0..3 {
        let now = Time::from_ms(1000 * (round + 1));
        let mut shares: Vec<_> =
            (0..3000).map(|n| shared_rate_limit.join(Some(n), Weight::ONE, Time::ZERO)).collect();
        shares.iter_mut().for_each(|share| {
            share.ask(now, BUSY);
        });
        shares[0].move_to(now, Some(7));
        assert_eq!(shared_rate_limit.table().entries()[0], 3000);
        drop(shares);
        let mut last = shared_rate_limit.join(None, Weight::ONE, Time::ZERO);
        last.ask(now + Duration::from_millis(200), BUSY);
        // The group of sessions without a group stays.
        assert_eq!(shared_rate_limit.table().entries(), [1, 1, 0]);
    }
}

#[test]
fn returning_address_gets_no_new_burst() {
    let shared_rate_limit = both(u64::MAX, 8_000_000);
    let mut other = shared_rate_limit.join(Some(2), Weight::ONE, Time::ZERO);
    let mut bits = 0;
    for visit in 0..100 {
        let now = Time::from_ms(1000 + visit);
        // Levels are computed while the address has no session.
        other.ask(now, IDLE);
        let mut share = shared_rate_limit.join(Some(1), Weight::ONE, Time::ZERO);
        while share.ask(now, BUSY) <= now {
            share.spend(now, 1000);
            bits += 8000;
        }
    }
    // 8 Mbit/s for 99 ms, a burst of 20 ms, and a piece.
    assert!((944_000..=960_000).contains(&bits), "{bits}");
}

#[test]
fn allocated_rate_is_what_sessions_can_use() {
    let shared_rate_limit = both(9_000_000, 4_000_000);
    let mut shares: Vec<_> =
        (0..3).map(|n| shared_rate_limit.join(Some(n), Weight::ONE, Time::ZERO)).collect();
    let mut at = 1000;
    let mut allocated = |requests: [SendRequest; 3]| {
        at += 200;
        let now = Time::from_ms(at);
        shares.iter_mut().zip(requests).for_each(|(share, request)| {
            share.ask(now, request);
        });
        shared_rate_limit.allocated_bits_per_s(now + Duration::from_millis(50))
    };
    let slow = SendRequest { own_bits_per_s: Some(1_000_000), ..BUSY };
    assert_eq!(allocated([IDLE, IDLE, IDLE]), 0);
    assert_eq!(allocated([BUSY, IDLE, IDLE]), 4_000_000);
    assert_eq!(allocated([BUSY, slow, IDLE]), 5_000_000);
    assert_eq!(allocated([BUSY, BUSY, BUSY]), 9_000_000);
}

#[test]
fn weights_are_from_1_to_100() {
    assert_eq!([0, 101, u64::MAX].map(Weight::new), [None; 3]);
    assert_eq!([1, 100].map(|weight| Weight::new(weight).map(Weight::get)), [Some(1), Some(100)]);
    assert_eq!(Weight::default(), Weight::ONE);
}

#[test]
fn changed_limits_apply_to_existing_sessions() {
    let shared_rate_limit = both(8_000_000, 2_000_000);
    let mut shares: Vec<_> =
        (0..6).map(|n| shared_rate_limit.join(Some(n), Weight::ONE, Time::ZERO)).collect();
    let mut at = Time::from_ms(1000);
    // Rate of each session over two seconds, in Mbit/s, after the levels have settled.
    let mut sent = |shares: &mut [RateShare]| {
        let mut bits = vec![0.0; shares.len()];
        for step in 0..25_000 {
            at = at + Duration::from_micros(100);
            for (share, bits) in shares.iter_mut().zip(&mut bits) {
                while share.ask(at, BUSY) <= at {
                    share.spend(at, 1000);
                    *bits += if step >= 5000 { 8000.0 } else { 0.0 };
                }
            }
        }
        let rates: Vec<f64> = bits.iter().map(|bits| bits / 2e6).collect();
        (at, rates)
    };
    let near = |rates: &[f64], expected: f64| {
        assert!(rates.iter().all(|rate| (rate / expected - 1.0).abs() <= 0.02), "{rates:?} for {expected}");
    };
    let (now, rates) = sent(&mut shares);
    near(&rates, 8.0 / 6.0);
    for (total, group, expected) in [
        (Some(24_000_000), Some(3_000_000), 3.0),
        (Some(3_000_000), None, 0.5),
        (Some(6_000_000), Some(9_000_000), 1.0),
    ] {
        let now = now.max(at_of(&shared_rate_limit));
        shared_rate_limit.set_limits(Limits { total_bits_per_s: total, group_bits_per_s: group }, now);
        near(&sent(&mut shares).1, expected);
    }
    shared_rate_limit.set_limits(Limits::default(), at_of(&shared_rate_limit));
    // Debt is paid first.
    let soon = at_of(&shared_rate_limit) + Duration::from_millis(10);
    let waits: Vec<_> = shares.iter_mut().map(|share| share.ask(soon, BUSY).since(soon)).collect();
    assert!(waits.iter().all(|wait| *wait <= Duration::from_millis(1)), "{waits:?}");
}

/// The latest time passed to a shared rate limit.
fn at_of(shared_rate_limit: &SharedRateLimit) -> Time {
    shared_rate_limit.table().last()
}
