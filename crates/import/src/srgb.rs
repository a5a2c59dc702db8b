//! sRGB (IEC 61966-2-1) to and from 16-bit linear light, by tables.
//!
//! `powf` may differ in its last bit from one machine to another; the tables are rounded to integers
//! and a test shows that no entry is near enough to a tie for that to matter.

use std::sync::LazyLock;

const SCALE: f64 = 65_535.0;

/// Linear light in `0..=1` of an encoded value in `0..=1`.
fn decode(encoded: f64) -> f64 {
    if encoded <= 0.04045 { encoded / 12.92 } else { ((encoded + 0.055) / 1.055).powf(2.4) }
}

static TO_LINEAR: LazyLock<[u16; 256]> =
    LazyLock::new(|| std::array::from_fn(|i| (decode(i as f64 / 255.0) * SCALE).round() as u16));

static FROM_LINEAR: LazyLock<Vec<u8>> = LazyLock::new(|| {
    // Between two encoded values the border lies at the linear light of their middle.
    let borders: Vec<u32> =
        (0..255).map(|i| (decode((f64::from(i) + 0.5) / 255.0) * SCALE).round() as u32).collect();
    let mut encoded = 0usize;
    (0..=u32::from(u16::MAX))
        .map(|linear| {
            while encoded < borders.len() && linear >= borders[encoded] {
                encoded += 1;
            }
            encoded as u8
        })
        .collect()
});

/// 16-bit linear light of an sRGB byte.
pub(crate) fn to_linear(encoded: u8) -> u16 {
    TO_LINEAR[usize::from(encoded)]
}

/// The sRGB byte nearest to a 16-bit linear light.
pub(crate) fn from_linear(linear: u16) -> u8 {
    FROM_LINEAR[usize::from(linear)]
}

/// Linear light of an sRGB-encoded value in `0..=1`, in steps of 1/255 of the encoded value, so that
/// every machine gets the same bits.
#[must_use]
pub fn srgb_to_linear(encoded: f32) -> f32 {
    let byte = (encoded.clamp(0.0, 1.0) * 255.0).round() as u8;
    f32::from(to_linear(byte)) / 65_535.0
}

/// The sRGB byte nearest to a linear light in `0..=1`, likewise.
#[must_use]
pub fn linear_to_srgb(linear: f64) -> u8 {
    from_linear((linear.clamp(0.0, 1.0) * 65_535.0).round() as u16)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_survive_the_round_trip() {
        for byte in 0..=u8::MAX {
            assert_eq!(from_linear(to_linear(byte)), byte);
        }
        assert_eq!((to_linear(0), to_linear(255)), (0, 65_535));
    }

    #[test]
    fn no_entry_depends_on_the_last_bits_of_powf() {
        for half in 0..=510 {
            let exact = decode(f64::from(half) / 510.0) * SCALE;
            let to_tie = (exact.fract() - 0.5).abs();
            assert!(to_tie > 1e-6, "entry {half}/2 is {exact}");
        }
    }
}
