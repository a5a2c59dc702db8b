//! The order in which other techniques' pieces are asked for: octaves of screen error, so that everything above 4 px
//! comes before anything below it; within the octave, screen error removed per byte and nearness to the centre.

use lodestream_select::Priority;

/// Bytes at which a piece ranks in the middle of its octave.
const MIDDLE_BYTES: f32 = 1024.0;

const MANTISSA: u32 = (1 << 23) - 1;

/// Largest screen error that makes a difference: beyond the picture's height all is lost alike.
const MAX_RANKED_ERROR_PX: f32 = 65_536.0;

/// Priority of something that removes `error_px` of screen error for `bytes`; `foveation` is 1 in the middle of the
/// picture and falls towards 0 outwards. Below that of every base mesh.
pub(super) fn octave_priority(error_px: f32, bytes: u32, foveation: f32) -> Priority {
    let bits = error_px.clamp(1e-6, MAX_RANKED_ERROR_PX).to_bits();
    let in_octave = f32::from_bits((bits & MANTISSA) | 1.0_f32.to_bits());
    let gain = in_octave * foveation.clamp(0.01, 1.0) * MIDDLE_BYTES / bytes.max(1) as f32;
    // gain / (1 + gain) maps (0, ∞) to (0, 1) without losing the order.
    let rank = (gain / (1.0 + gain) * MANTISSA as f32) as u32;
    (bits & !MANTISSA) | rank.min(MANTISSA)
}

#[cfg(test)]
mod tests {
    use super::*;
    use lodestream_select::priority::{base_priority, is_base};

    #[test]
    fn octave_decides_then_error_per_byte_then_foveation() {
        assert!(octave_priority(4.0, 60_000, 0.1) > octave_priority(3.9, 10, 1.0));
        assert!(octave_priority(5.0, 500, 1.0) > octave_priority(7.9, 5000, 1.0));
        assert!(octave_priority(5.0, 500, 1.0) > octave_priority(5.0, 500, 0.5));
        assert!(octave_priority(f32::MAX, 1, 1.0) < base_priority(0.0, 0.0));
        assert!(!is_base(octave_priority(f32::MAX, 1, 1.0)));
    }
}
