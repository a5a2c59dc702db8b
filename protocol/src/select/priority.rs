//! How urgent a blob is: numbers that all kinds of blobs share.
//!
//! A priority is the bit pattern of a positive `f32`, which orders as the float does. The exponent is the
//! octave of the screen error that the blob removes, so that everything above 4 px comes before anything
//! below it and the worst parts of the picture improve first; within the octave, the mantissa ranks by
//! screen error removed per byte, and by nearness to the centre of the picture.
//!
//! Base meshes of visible instances come before all refinement, those out of view after it.

/// How urgent a blob is; higher is first. The numbers of all kinds of blobs compare with each other.
pub type Priority = u32;

/// Above any screen error in pixels.
const BASE: f32 = 1e20;
/// Below any screen error worth refining.
const PREFETCH: f32 = 1e-17;
/// Bytes at which a chunk ranks in the middle of its octave.
const MIDDLE_BYTES: f32 = 1024.0;

const MANTISSA: u32 = (1 << 23) - 1;

/// Largest screen error that makes a difference: beyond the picture's height all is lost alike.
const MAX_ERROR_PX: f32 = 65_536.0;

/// Priority of a visible instance's base mesh (and of the scene page that places it): the larger on the
/// screen and the nearer to its centre, the sooner.
#[must_use]
pub fn base_priority(coverage_px: f32, centrality: f32) -> Priority {
    (BASE * (coverage_px.clamp(0.0, 1e9) + 1e-3) * centrality.clamp(0.1, 1.0)).to_bits()
}

/// Priority of a base mesh that is out of view: near and large first.
#[must_use]
pub fn prefetch_priority(coverage_px: f32) -> Priority {
    (PREFETCH * (coverage_px.clamp(0.0, 1e9) + 1e-3)).to_bits()
}

/// Whether the priority is that of something without which a visible instance cannot be drawn.
#[must_use]
pub const fn is_base(priority: Priority) -> bool {
    priority >= 0x5000_0000 // 8.6e9, between MAX_ERROR_PX and every base priority
}

/// Priority of something that removes `error_px` of screen error for `bytes`; `centrality` is 1 in the
/// middle of the picture and falls towards 0 outwards.
#[must_use]
pub fn refine_priority(error_px: f32, bytes: u32, centrality: f32) -> Priority {
    let error_px = error_px.clamp(1e-6, MAX_ERROR_PX);
    let bits = error_px.to_bits();
    let in_octave = f32::from_bits((bits & MANTISSA) | 1.0_f32.to_bits());
    #[allow(clippy::cast_precision_loss)]
    let gain = in_octave * centrality.clamp(0.01, 1.0) * MIDDLE_BYTES / bytes.max(1) as f32;
    // gain / (1 + gain) maps (0, ∞) to (0, 1) without losing the order.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, clippy::cast_precision_loss)]
    let rank = (gain / (1.0 + gain) * MANTISSA as f32) as u32;
    (bits & !MANTISSA) | rank.min(MANTISSA)
}

/// Priority of an index page whose chunks have a screen error of at most `error_px`: the first of its
/// octave, because nothing behind it can be asked for without it.
#[must_use]
pub fn index_priority(error_px: f32) -> Priority {
    error_px.clamp(1e-6, MAX_ERROR_PX).to_bits() | MANTISSA
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn octave_decides_then_error_per_byte_then_centrality() {
        assert!(refine_priority(4.0, 60_000, 0.1) > refine_priority(3.9, 10, 1.0));
        assert!(refine_priority(5.0, 500, 1.0) > refine_priority(7.9, 5000, 1.0));
        assert!(refine_priority(5.0, 500, 1.0) > refine_priority(5.0, 500, 0.5));
        assert!(index_priority(5.0) > refine_priority(7.9, 1, 1.0));
        assert!(index_priority(3.9) < refine_priority(4.1, 60_000, 0.1));
    }

    #[test]
    fn classes_do_not_mix() {
        for error in [1e-9, 1.0, 1e6, f32::MAX] {
            let refine = refine_priority(error, 1, 1.0).max(index_priority(error));
            assert!(base_priority(0.0, 0.0) > refine && !is_base(refine));
            assert!(prefetch_priority(f32::MAX) < refine_priority(error, u32::MAX, 0.0));
        }
        assert!(is_base(base_priority(0.0, 0.0)));
    }
}
