//! Progressive filling: the level at which weighted claims add up to a capacity.
//!
//! Bertsekas and Gallager, *Data Networks*, 2nd ed. (1992), §6.5.2: all claims are raised together until one is
//! satisfied, which stays there, and so on until the capacity is used up. The result is the unique max-min fair
//! allocation: no claim can be raised without lowering one that has no more, by weight.

/// Bits per second per unit of weight, in units of 1/65,536.
pub(super) type Level = u128;

const FRACTION_BITS: u32 = 16;

/// Level without a limit. Larger than the level of any limit; clocks that advance by it take weeks to saturate.
pub(super) const UNBOUNDED: Level = 1 << 80;

/// The level at which a claim of `weight` has `bits_per_s`.
pub(super) fn level_of(bits_per_s: u64, weight: u32) -> Level {
    (u128::from(bits_per_s) << FRACTION_BITS) / u128::from(weight.max(1))
}

/// Bits per second of a claim of `weight` at a level, rounded down.
pub(super) fn rate_at(level: Level, weight: u32) -> u64 {
    u64::try_from(level.saturating_mul(u128::from(weight)) >> FRACTION_BITS).unwrap_or(u64::MAX)
}

/// One claim on the capacity.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Claim {
    /// The level at which the claim is satisfied.
    pub(super) max_level: Level,
    pub(super) weight: u32,
}

/// The level at which claims, sorted by `max_level`, add up to a capacity; `None` if all of them are satisfied by it.
/// One pass.
pub(super) fn fill<'a>(
    sorted: impl Iterator<Item = &'a Claim> + Clone,
    capacity_bits_per_s: u64,
) -> Option<Level> {
    let mut weight: u128 = sorted.clone().map(|claim| u128::from(claim.weight)).sum();
    let mut rest = level_of(capacity_bits_per_s, 1);
    for claim in sorted {
        if claim.max_level.saturating_mul(weight) > rest {
            return Some(rest / weight.max(1));
        }
        rest -= claim.max_level * u128::from(claim.weight);
        weight -= u128::from(claim.weight);
    }
    None
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn filled(claims: &[(Option<u64>, u32)], capacity: u64) -> Option<u64> {
        let max_level = |rate: Option<u64>, weight| rate.map_or(Level::MAX, |rate| level_of(rate, weight));
        let mut claims: Vec<_> =
            claims.iter().map(|&(m, weight)| Claim { max_level: max_level(m, weight), weight }).collect();
        claims.sort_unstable_by_key(|claim| claim.max_level);
        fill(claims.iter(), capacity).map(|level| rate_at(level, 1))
    }

    #[test]
    fn unused_capacity_goes_to_the_other_claims() {
        assert_eq!(filled(&[(None, 1), (None, 1), (None, 1)], 9000), Some(3000));
        assert_eq!(filled(&[(None, 1), (Some(1000), 1), (None, 1)], 9000), Some(4000));
        assert_eq!(filled(&[(None, 1), (None, 2), (None, 5)], 8000), Some(1000));
        assert_eq!(filled(&[(None, 1), (Some(6000), 2), (Some(2000), 5)], 9000), Some(2333));
        assert_eq!(filled(&[(Some(5000), 1), (Some(3000), 7)], 8000), None, "all claims are satisfied");
        assert_eq!(filled(&[], 8000), None);
        assert_eq!(filled(&[(Some(0), 1), (None, 1)], 8000), Some(8000));
    }

    #[test]
    fn extremes_do_not_overflow() {
        for capacity in [0, 1, u64::MAX] {
            for most in [None, Some(0), Some(1), Some(u64::MAX)] {
                let _ = filled(&[(most, 100), (most, 1), (None, u32::MAX)], capacity);
            }
        }
    }

    proptest! {
        #[test]
        fn allocation_uses_the_capacity_and_exceeds_no_claim(
            claims in prop::collection::vec((prop::option::of(0_u64..1 << 40), 1_u32..=100), 1..40),
            capacity in 1_u64..1 << 44,
        ) {
            let max_level = |rate: Option<u64>, weight| rate.map_or(Level::MAX, |rate| level_of(rate, weight));
            let mut claims: Vec<_> =
                claims.iter().map(|&(m, weight)| Claim { max_level: max_level(m, weight), weight }).collect();
            claims.sort_unstable_by_key(|claim| claim.max_level);
            let given = |level: Level| -> u128 {
                claims.iter().map(|c| level.min(c.max_level).saturating_mul(u128::from(c.weight))).sum()
            };
            match fill(claims.iter(), capacity) {
                Some(level) => {
                    // A level is rounded down, by less than one unit for each unit of weight.
                    let slack: u128 = claims.iter().map(|c| u128::from(c.weight)).sum();
                    let short = level_of(capacity, 1).checked_sub(given(level)).unwrap();
                    prop_assert!(short <= slack, "{short}");
                }
                None => prop_assert!(given(1 << 100) <= level_of(capacity, 1)),
            }
        }
    }
}
