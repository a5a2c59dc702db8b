//! Numbers in 0..=1 in fixed point.

/// A share in 65535ths.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to the range first")]
pub(super) fn to_u16(x: f32) -> u16 {
    (x.clamp(0.0, 1.0) * 65_535.0).round() as u16
}

/// A share in 255ths.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to the range first")]
pub(super) fn to_u8(x: f32) -> u8 {
    (x.clamp(0.0, 1.0) * 255.0).round() as u8
}

/// The share that 255ths are.
pub(super) fn from_u8(x: u8) -> f32 {
    f32::from(x) / 255.0
}
