//! Conversions between kinds of numbers where the range is known, so that no cast loses anything by surprise: beside
//! those of [`lodestream_geometry::numbers`], of coordinates and levels.
//!
//! What comes from an untrusted peer is converted with `try_from` and an error. A window has at most
//! [`MAX_WINDOW_POINTS`](crate::MAX_WINDOW_POINTS), and no coordinate is further than 2^32 from the middle of the world.

/// How far one coordinate lies beyond another within a window, as an index or a count.
#[inline(always)]
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a window's points can be counted"
)]
pub(super) fn index(distance: i64) -> usize {
    debug_assert!(usize::try_from(distance).is_ok(), "{distance} is no index");
    distance as usize
}

/// A count of points, or an index among them, as a distance between coordinates.
#[inline(always)]
#[expect(clippy::cast_possible_wrap, reason = "a window's points can be counted")]
pub(super) fn span(count: usize) -> i64 {
    debug_assert!(i64::try_from(count).is_ok(), "{count} points");
    count as i64
}

/// A level from 0 on, or the negative of one, among levels of either sign.
#[inline(always)]
pub(super) fn signed(level: u8) -> i8 {
    debug_assert!(level < 32, "level {level}");
    level.cast_signed()
}

/// A whole number as a real one; exact up to 2^53.
#[inline(always)]
#[expect(clippy::cast_precision_loss, reason = "lengths and their squares are shorter")]
pub(super) fn real(length: i64) -> f64 {
    debug_assert!(length.unsigned_abs() <= 1 << 53, "{length} as a real number");
    length as f64
}

/// A real number without its fraction (towards zero); the nearest integer that there is if it is out of range, and 0
/// for what is not a number.
#[inline(always)]
#[expect(clippy::cast_possible_truncation, reason = "that is what it is for; such a cast saturates")]
pub(super) fn truncated(x: f64) -> i64 {
    x as i64
}

/// The nearest 32-bit number.
#[inline(always)]
#[expect(clippy::cast_possible_truncation, reason = "it is clamped to the range first")]
pub(super) fn saturate(value: i64) -> i32 {
    value.clamp(i64::from(i32::MIN), i64::from(i32::MAX)) as i32
}
