//! Conversions of coordinates and levels where the range is known, in addition to [`lodestream_geometry::numbers`].
//!
//! Values from an untrusted peer are converted with `try_from` and an error. A window has at most
//! [`MAX_WINDOW_POINTS`](crate::MAX_WINDOW_POINTS), and coordinates are at most 2^32 from the middle of the world.

/// Difference of two coordinates within a window as an index or count.
#[inline(always)]
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a window's points can be counted"
)]
pub(super) fn index(distance: i64) -> usize {
    debug_assert!(usize::try_from(distance).is_ok(), "{distance} is not an index");
    distance as usize
}

/// A count or index of points as a difference of coordinates.
#[inline(always)]
#[expect(clippy::cast_possible_wrap, reason = "a window's points can be counted")]
pub(super) fn span(count: usize) -> i64 {
    debug_assert!(i64::try_from(count).is_ok(), "{count} points");
    count as i64
}

/// A level from 0 on, or its negative, as a level of either sign.
#[inline(always)]
pub(super) fn signed(level: u8) -> i8 {
    debug_assert!(level < 32, "level {level}");
    level.cast_signed()
}

/// Converts an integer to f64; exact up to 2^53.
#[inline(always)]
#[expect(clippy::cast_precision_loss, reason = "lengths and their squares are shorter")]
pub(super) fn real(length: i64) -> f64 {
    debug_assert!(length.unsigned_abs() <= 1 << 53, "{length} as a real number");
    length as f64
}

/// Truncates towards zero, saturating; NaN becomes 0.
#[inline(always)]
#[expect(clippy::cast_possible_truncation, reason = "that is what it is for; such a cast saturates")]
pub(super) fn truncated(x: f64) -> i64 {
    x as i64
}

/// Saturates to 32 bits.
#[inline(always)]
#[expect(clippy::cast_possible_truncation, reason = "it is clamped to the range first")]
pub(super) fn saturate(value: i64) -> i32 {
    value.clamp(i64::from(i32::MIN), i64::from(i32::MAX)) as i32
}
