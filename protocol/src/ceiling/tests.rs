//! Who is remembered, and what each is told.

use super::*;

const BUSY: Wish = Wish { active: true, own_bits_per_s: None, own_ready: true };
const IDLE: Wish = Wish { active: false, own_bits_per_s: None, own_ready: true };

fn both(total: u64, group: u64) -> Arc<Ceiling> {
    Ceiling::new(Limits { total_bits_per_s: Some(total), group_bits_per_s: Some(group) })
}

#[test]
fn who_has_left_is_forgotten() {
    let ceiling = both(8_000_000, 1_000_000);
    for round in 0..3 {
        let now = Time::from_ms(1000 * (round + 1));
        let mut shares: Vec<_> = (0..3000).map(|n| ceiling.join(Some(n), Weight::ONE, Time::ZERO)).collect();
        shares.iter_mut().for_each(|share| {
            share.ask(now, BUSY);
        });
        shares[0].move_to(now, Some(7));
        assert_eq!(ceiling.table().entries()[0], 3000);
        drop(shares);
        let mut last = ceiling.join(None, Weight::ONE, Time::ZERO);
        last.ask(now + Duration::from_millis(200), BUSY);
        // The group of those in none stays.
        assert_eq!(ceiling.table().entries(), [1, 1, 0]);
    }
}

#[test]
fn an_address_that_comes_anew_has_no_new_burst() {
    let ceiling = both(u64::MAX, 8_000_000);
    let mut other = ceiling.join(Some(2), Weight::ONE, Time::ZERO);
    let mut bits = 0;
    for visit in 0..100 {
        let now = Time::from_ms(1000 + visit);
        // Levels are found anew while the address has nobody here.
        other.ask(now, IDLE);
        let mut share = ceiling.join(Some(1), Weight::ONE, Time::ZERO);
        while share.ask(now, BUSY) <= now {
            share.spend(now, 1000);
            bits += 8000;
        }
    }
    // 8 Mbit/s for 99 ms, 20 ms that were saved, and a piece.
    assert!((944_000..=960_000).contains(&bits), "{bits}");
}

#[test]
fn what_is_given_is_what_can_be_used() {
    let ceiling = both(9_000_000, 4_000_000);
    let mut shares: Vec<_> = (0..3).map(|n| ceiling.join(Some(n), Weight::ONE, Time::ZERO)).collect();
    let mut at = 1000;
    let mut given = |wishes: [Wish; 3]| {
        at += 200;
        let now = Time::from_ms(at);
        shares.iter_mut().zip(wishes).for_each(|(share, wish)| {
            share.ask(now, wish);
        });
        ceiling.given_bits_per_s(now + Duration::from_millis(50))
    };
    let slow = Wish { own_bits_per_s: Some(1_000_000), ..BUSY };
    assert_eq!(given([IDLE, IDLE, IDLE]), 0);
    assert_eq!(given([BUSY, IDLE, IDLE]), 4_000_000);
    assert_eq!(given([BUSY, slow, IDLE]), 5_000_000);
    assert_eq!(given([BUSY, BUSY, BUSY]), 9_000_000);
}

#[test]
fn weights_are_from_1_to_100() {
    assert_eq!([0, 101, u64::MAX].map(Weight::new), [None; 3]);
    assert_eq!([1, 100].map(|weight| Weight::new(weight).map(Weight::get)), [Some(1), Some(100)]);
    assert_eq!(Weight::default(), Weight::ONE);
}
