//! Quantised numbers of punctual lights. Only bit operations and exactly rounded arithmetic (+ − × ÷ √) are used, so
//! the bytes are the same on every machine.

use std::f64::consts::FRAC_PI_2;

use super::PunctualLightsError;

/// Low bits of an `f32` that are dropped; 8 bits of exponent and 8 of mantissa remain.
const CUT: u32 = 15;

/// Quantises a positive number to 16 bits, with a relative error of 2⁻⁹. The caller checks its range.
pub(super) fn short_float(x: f32) -> u16 {
    let rounded = (x.to_bits() >> (CUT - 1)).div_ceil(2);
    u16::try_from(rounded).unwrap_or(u16::MAX)
}

/// Inverse of [`short_float`].
pub(super) fn long_float(short: u16) -> f32 {
    f32::from_bits(u32::from(short) << CUT)
}

/// Quantises a number from 0 to 1 in steps of 1/65535.
fn share(x: f64) -> u16 {
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to the range first")]
    let steps = (x.clamp(0.0, 1.0) * 65_535.0 + 0.5) as u16;
    steps
}

/// Quantises an angle from 0 to π/2 to 16 bits, within 0.0007°.
pub(super) fn short_angle(angle: f32) -> u16 {
    share(f64::from(angle) / FRAC_PI_2)
}

/// Inverse of [`short_angle`].
pub(super) fn long_angle(short: u16) -> f32 {
    #[expect(clippy::cast_possible_truncation, reason = "to the nearest f32")]
    let angle = (f64::from(short) / 65_535.0 * FRAC_PI_2) as f32;
    angle.min(std::f32::consts::FRAC_PI_2)
}

/// Octahedral encoding of a unit vector in 32 bits, within 0.004° (Cigolle et al., "A survey of efficient
/// representations for independent unit vectors", 2014).
pub(super) fn short_direction(direction: [f32; 3]) -> [u16; 2] {
    let [x, y, z] = direction.map(f64::from);
    let sum = x.abs() + y.abs() + z.abs();
    let (x, y, lower) = (x / sum, y / sum, z < 0.0);
    let sign = |v: f64| if v < 0.0 { -1.0 } else { 1.0 };
    let [u, v] = if lower { [(1.0 - y.abs()) * sign(x), (1.0 - x.abs()) * sign(y)] } else { [x, y] };
    [u, v].map(|c| share(0.5 + 0.5 * c))
}

/// Inverse of [`short_direction`].
pub(super) fn long_direction(short: [u16; 2]) -> [f32; 3] {
    let [u, v] = short.map(|c| 2.0 * f64::from(c) / 65_535.0 - 1.0);
    let z = 1.0 - u.abs() - v.abs();
    let sign = |v: f64| if v < 0.0 { -1.0 } else { 1.0 };
    let [x, y] = if z < 0.0 { [(1.0 - v.abs()) * sign(u), (1.0 - u.abs()) * sign(v)] } else { [u, v] };
    // Never zero: the octahedron's faces are at least 1/√3 from its centre.
    let length = (x * x + y * y + z * z).sqrt();
    #[expect(clippy::cast_possible_truncation, reason = "to the nearest f32")]
    [x, y, z].map(|c| (c / length) as f32)
}

/// Appends a signed number in zigzag LEB128.
pub(super) fn put_signed(value: i64, out: &mut Vec<u8>) {
    let mut code = ((value << 1) ^ (value >> 63)).cast_unsigned();
    while code >= 0x80 {
        let [low, ..] = code.to_le_bytes();
        out.push(low | 0x80);
        code >>= 7;
    }
    let [last, ..] = code.to_le_bytes();
    out.push(last);
}

/// Two to the power of `exponent`, exactly.
pub(super) fn power_of_two(exponent: i8) -> f64 {
    f64::from_bits(u64::from((1023 + i16::from(exponent)).unsigned_abs()) << 52)
}

/// A cursor over bytes.
pub(super) struct Input<'a>(pub(super) &'a [u8]);

impl Input<'_> {
    pub(super) fn bytes<const N: usize>(&mut self) -> Result<[u8; N], PunctualLightsError> {
        let (bytes, rest) = self.0.split_first_chunk().ok_or(PunctualLightsError::EndsEarly)?;
        self.0 = rest;
        Ok(*bytes)
    }

    pub(super) fn u8(&mut self) -> Result<u8, PunctualLightsError> {
        self.bytes().map(|[byte]| byte)
    }

    pub(super) fn u16(&mut self) -> Result<u16, PunctualLightsError> {
        self.bytes().map(u16::from_le_bytes)
    }

    /// Inverse of [`put_signed`]; at most 63 bits.
    pub(super) fn signed(&mut self) -> Result<i64, PunctualLightsError> {
        let mut code = 0_u64;
        for shift in (0..63).step_by(7) {
            let byte = self.u8()?;
            code |= u64::from(byte & 0x7f) << shift;
            if byte < 0x80 {
                return Ok((code >> 1).cast_signed() ^ -(code & 1).cast_signed());
            }
        }
        // Longer numbers exceed all valid positions.
        Err(PunctualLightsError::Position)
    }
}
