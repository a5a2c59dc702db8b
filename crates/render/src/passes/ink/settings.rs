//! Settings of ink.

use bytemuck::{Pod, Zeroable};
use glam::DVec3;

/// Widest stroke, in pixels.
pub const MAX_INK_WIDTH: f32 = 32.0;
/// Largest blur radius of strokes, in pixels.
pub const MAX_INK_BLUR: u32 = 3;
/// Most levels of light.
pub const MAX_INK_LEVELS: u32 = 16;

/// Strokes along contours, borders and creases of meshes, over quantised light. Terrain has quantised light but no
/// strokes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ink {
    /// Width of strokes in pixels, up to [`MAX_INK_WIDTH`]; 0 draws none.
    pub width_px: f32,
    /// Blur radius of strokes in pixels, up to [`MAX_INK_BLUR`].
    pub blur_px: u32,
    /// Least angle in degrees between two faces that makes their edge a visible crease; 180 disables creases.
    /// Tessellated round shapes draw all their edges below their own angle.
    pub crease_degrees: f32,
    /// Levels of light, 2 to [`MAX_INK_LEVELS`]; fewer disable quantisation.
    pub levels: u32,
    /// Noise amplitude on the borders between levels, as a share of a level: 0 (smooth) to 1.
    pub spatter: f32,
}

impl Default for Ink {
    fn default() -> Self {
        Self { width_px: 2.0, blur_px: 1, crease_degrees: 40.0, levels: 4, spatter: 0.5 }
    }
}

/// Octaves of noise cells, from 2^-32 world units.
const OCTAVES: usize = 64;
/// Period of the noise, in cells.
const REPEATS: f64 = 256.0;

/// `Ink` of `ink_uniform.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub(crate) struct InkUniform {
    half_width: f32,
    blur: i32,
    levels: f32,
    spatter: f32,
    eye: [[f32; 4]; OCTAVES],
}

impl Ink {
    /// The uniform, with all settings clamped to finite ranges.
    pub(crate) fn uniform(&self, eye: DVec3) -> InkUniform {
        let cells = |octave: usize| {
            let size = (octave as f64 - 0.5 * OCTAVES as f64).exp2();
            // Far positions lose precision in small cells, which are then invisible.
            let eye = (eye / size).to_array().map(|x| x.rem_euclid(REPEATS).max(0.0) as f32);
            [eye[0], eye[1], eye[2], 0.0]
        };
        let levels = if self.levels < 2 { 0 } else { self.levels.min(MAX_INK_LEVELS) };
        InkUniform {
            half_width: 0.5 * within(self.width_px, MAX_INK_WIDTH),
            blur: self.blur_px.min(MAX_INK_BLUR) as i32,
            levels: levels as f32,
            spatter: within(self.spatter, 1.0),
            eye: std::array::from_fn(cells),
        }
    }

    /// Whether there are strokes.
    pub(crate) fn has_strokes(&self) -> bool {
        self.width_px > 0.0
    }

    /// Cosine of the crease angle.
    pub(crate) fn crease_cosine(&self) -> f32 {
        let degrees = if self.crease_degrees < 180.0 { within(self.crease_degrees, 180.0) } else { 180.0 };
        // No cosine is below −2: creases are off.
        if degrees < 180.0 { degrees.to_radians().cos() } else { -2.0 }
    }
}

/// Clamps a setting to 0..=`most`; NaN becomes 0.
fn within(x: f32, most: f32) -> f32 {
    // `max` returns the other operand if one is NaN.
    x.max(0.0).min(most)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_are_clamped_to_finite_ranges() {
        for wrong in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, -1.0] {
            let ink = Ink {
                width_px: wrong,
                blur_px: u32::MAX,
                crease_degrees: wrong,
                levels: u32::MAX,
                spatter: wrong,
            };
            let uniform = ink.uniform(DVec3::new(1e300, -1e-300, 1e7));
            assert!((0.0..=0.5 * MAX_INK_WIDTH).contains(&uniform.half_width));
            assert!((0.0..=1.0).contains(&uniform.spatter));
            assert_eq!((uniform.blur, uniform.levels), (MAX_INK_BLUR as i32, MAX_INK_LEVELS as f32));
            assert!((-2.0..=1.0).contains(&ink.crease_cosine()), "{}", ink.crease_cosine());
            assert!(uniform.eye.iter().flatten().all(|x| (0.0..=256.0).contains(x)));
        }
        assert_eq!(size_of::<InkUniform>(), 16 + 64 * 16);
    }
}
