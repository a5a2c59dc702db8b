//! Priority of the baselines' pieces: by octave of screen error, so that all errors above 4 px come before those below;
//! within an octave by screen error removed per byte and distance from the picture's centre.

use lodestream_select::Priority;

/// Length of a piece that ranks in the middle of its octave.
const MIDDLE_BYTES: f32 = 1024.0;

const MANTISSA: u32 = (1 << 23) - 1;

/// Screen errors above this rank equally: they exceed the picture's height.
const MAX_RANKED_ERROR_PX: f32 = 65_536.0;

/// Priority of a piece of `bytes` that removes `error_px` of screen error; `foveation` is 1 in the picture's centre and
/// falls towards 0 outwards. Below the priority of every base mesh.
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
