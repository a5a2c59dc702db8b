//! How ink is drawn.

use bytemuck::{Pod, Zeroable};
use glam::DVec3;

/// Widest stroke, in pixels.
pub const MAX_INK_WIDTH: f32 = 32.0;
/// Furthest that strokes are blurred, in pixels to each side.
pub const MAX_INK_BLUR: u32 = 3;
/// Most levels of light.
pub const MAX_INK_LEVELS: u32 = 16;

/// Strokes where surfaces of meshes end as the eye sees them, over light in levels. Ground has levels and no strokes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ink {
    /// Width of strokes in pixels of the picture that is drawn, above 0 and up to [`MAX_INK_WIDTH`]; with 0 there are none.
    pub width_px: f32,
    /// Pixels to each side over which strokes are blurred, up to [`MAX_INK_BLUR`].
    pub blur_px: u32,
    /// Angle in degrees between two faces from which on their edge is a crease, and drawn wherever it is seen; 180 draws
    /// none. The smaller, the more strokes: each tessellated round thing has some at its own angle.
    pub crease_degrees: f32,
    /// Levels of light, 2 to [`MAX_INK_LEVELS`]; with fewer light stays as it is.
    pub levels: u32,
    /// By how much of a level noise moves the borders between them, 0 to 1: 0 draws smooth lines.
    pub spatter: f32,
}

impl Default for Ink {
    fn default() -> Self {
        Self { width_px: 2.0, blur_px: 1, crease_degrees: 40.0, levels: 4, spatter: 0.5 }
    }
}

/// Sizes of cells of noise: from 2^-32 world units on.
const OCTAVES: usize = 64;
/// Cells after which noise begins anew.
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
    /// What the shaders know, such that no setting asks for what is not a number or without bound.
    pub(crate) fn uniform(&self, eye: DVec3) -> InkUniform {
        let cells = |octave: usize| {
            let size = (octave as f64 - 0.5 * OCTAVES as f64).exp2();
            // Too far for a place in small cells: none is seen of them.
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

    /// Cosine of the angle from which on an edge is a crease.
    pub(crate) fn crease_cosine(&self) -> f32 {
        let degrees = if self.crease_degrees < 180.0 { within(self.crease_degrees, 180.0) } else { 180.0 };
        // Off for certain: rounding puts no sum below it.
        if degrees < 180.0 { degrees.to_radians().cos() } else { -2.0 }
    }
}

/// A setting from 0 up to the most there may be; 0 for what is not a number.
fn within(x: f32, most: f32) -> f32 {
    // `max` gives the other of two of which one is not a number.
    x.max(0.0).min(most)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn whatever_is_asked_for_is_a_number_within_its_range() {
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
