//! Conversions between number types where the range is known, so that no cast is lossy unnoticed.
//!
//! Values from an untrusted peer are converted with `try_from` and an error. These functions are for values that the
//! program itself has counted or bounded.

/// Converts a count or index of elements to a 32-bit id. Every list of elements holds fewer than 2^32; larger values
/// saturate at 2^32 − 1.
#[inline]
#[must_use]
pub fn id32(count: usize) -> u32 {
    debug_assert!(u32::try_from(count).is_ok(), "{count} elements");
    u32::try_from(count).unwrap_or(u32::MAX)
}

/// Converts a count to f64; exact below 2^53.
#[inline]
#[must_use]
#[expect(clippy::cast_precision_loss, reason = "no list of elements is that long")]
pub fn real(count: usize) -> f64 {
    count as f64
}

/// Truncates towards zero, saturating; NaN becomes 0.
#[inline]
#[must_use]
#[expect(clippy::cast_possible_truncation, reason = "that is what it is for; such a cast saturates")]
pub fn truncated(x: f64) -> i32 {
    x as i32
}

/// Rounds down, saturating as [`truncated`] does. Faster than `f64::floor`, which is a function call on baseline
/// x86-64.
#[inline]
#[must_use]
pub fn floored(x: f64) -> i32 {
    let whole = truncated(x);
    whole.saturating_sub(i32::from(f64::from(whole) > x))
}

/// The lowest 32 bits, for arithmetic modulo 2^32.
#[inline]
#[must_use]
pub fn low32(value: i128) -> i32 {
    let [a, b, c, d, ..] = value.to_le_bytes();
    i32::from_le_bytes([a, b, c, d])
}

/// Rounds to the nearest f32; infinite beyond its range.
#[inline]
#[must_use]
#[expect(clippy::cast_possible_truncation, reason = "that is what it is for")]
pub fn nearest_f32(x: f64) -> f32 {
    x as f32
}

/// Clamps a number to a class 0 … `classes` − 1.
#[inline]
#[must_use]
pub fn class(value: i32, classes: usize) -> usize {
    usize::try_from(value).unwrap_or(0).min(classes - 1)
}

/// Reciprocals of 1, 2, …, bit-identical to a division.
const INVERSE: [f64; 64] = {
    let mut table = [1.0; 64];
    let (mut k, mut x) = (2, 2.0);
    while k < 64 {
        table[k] = 1.0 / x;
        (k, x) = (k + 1, x + 1.0);
    }
    table
};

/// Reciprocal of a number that is not 0.
#[inline]
pub(crate) fn inverse(count: u32) -> f64 {
    INVERSE.get(count as usize).copied().unwrap_or_else(|| 1.0 / f64::from(count))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_and_classes_keep_to_their_ranges() {
        assert_eq!([0, 7, 0xffff_ffff].map(id32), [0, 7, u32::MAX]);
        assert_eq!([i32::MIN, -1, 0, 3, 4, i32::MAX].map(|x| class(x, 5)), [0, 0, 0, 3, 4, 4]);
        let wraps = [(5, 5), (-5, -5), (1 << 31, i32::MIN), ((1 << 32) + 3, 3), (-(1 << 32) - 1, -1)];
        assert!(wraps.into_iter().all(|(value, low)| low32(value) == low));
        assert!(real(1 << 52) + 1.0 == real((1 << 52) + 1));
    }

    #[test]
    fn real_numbers_lose_their_fraction_and_saturate() {
        let cases = [(2.9, 2), (-2.9, -2), (1e300, i32::MAX), (-1e300, i32::MIN), (f64::NAN, 0)];
        assert!(cases.into_iter().all(|(x, whole)| truncated(x) == whole));
        let cases =
            [(2.9, 2), (-2.9, -3), (-3.0, -3), (-0.0, 0), (-1e-9, -1), (1e300, i32::MAX), (-1e300, i32::MIN)];
        assert!(cases.into_iter().all(|(x, whole)| floored(x) == whole));
        assert_eq!((floored(f64::NAN), floored(f64::NEG_INFINITY)), (0, i32::MIN));
        assert_eq!(nearest_f32(0.1), 0.1_f32);
        assert_eq!(nearest_f32(1e300), f32::INFINITY);
    }
}
