//! The 4×4 blur that cancels the pattern of occlusion's rotations: `occlusion_blur.wgsl`.

use super::radius_at;
use crate::cpu_reference::surface::DepthPicture;

/// An estimate of occlusion before its blur.
#[derive(Clone, Copy, Debug)]
pub struct Blur<'a> {
    /// The surfaces.
    pub picture: DepthPicture<'a>,
    /// Openness of each pixel, rows from the top.
    pub raw: &'a [f64],
    /// Radius in world units, and per unit of depth; added.
    pub radius: (f64, f64),
    /// Number of the frame within the mean, from 1; 0 without accumulation.
    pub number: u32,
}

impl Blur<'_> {
    /// Final openness of a pixel.
    #[must_use]
    pub fn openness(&self, pixel: [i64; 2]) -> f64 {
        let Self { picture, raw, radius, number } = *self;
        let depth = picture.depth_at(pixel);
        if depth >= 1e30 {
            return 1.0;
        }
        let reach = radius_at(depth, radius, picture.scale_px());
        let last = picture.size_px.map(|side| i64::from(side) - 1);
        let raw_at = |[x, y]: [i64; 2]| raw[(y * (last[0] + 1) + x) as usize];
        let window = (0..16).map(|i| [i % 4 - 1, i / 4 - 1]);
        let clamped = window.map(|offset| [0, 1].map(|i| (pixel[i] + offset[i]).clamp(0, last[i])));
        let as_deep: Vec<f64> =
            clamped.filter(|p| (picture.depth_at(*p) - depth).abs() <= reach).map(raw_at).collect();
        // Its own pixel is always among them.
        let mean = as_deep.iter().sum::<f64>() / as_deep.len().max(1) as f64;
        let own = f64::from(number.max(1) - 1) / 15.0;
        mean + (raw_at(pixel) - mean) * own
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn means_stay_on_their_side_of_a_depth_edge_and_rotations_cancel() {
        let size = 16_i64;
        let pixels = || (0..size * size).map(|i| [i % size, i / size]);
        // The left half is 2 away and fully occluded; the right half is 4 away, with the openness of its rotation.
        let stored: Vec<f32> = pixels().map(|[x, _]| if x < 8 { 0.005 } else { 0.0025 }).collect();
        let rotation = |p: [i64; 2]| f64::from(super::super::rotation_index(p)) / 15.0;
        let raw: Vec<f64> = pixels().map(|p| if p[0] < 8 { 0.0 } else { rotation(p) }).collect();
        let picture = DepthPicture { stored: &stored, size_px: [16; 2], tan_half_fov: [0.5; 2], near: 0.01 };
        let blur = Blur { picture, raw: &raw, radius: (0.5, 0.0), number: 0 };
        for p in pixels().filter(|p| p[0] < 8) {
            assert_eq!(blur.openness(p), 0.0, "{p:?}");
        }
        for p in pixels().filter(|p| (9..14).contains(&p[0]) && (1..14).contains(&p[1])) {
            assert!((blur.openness(p) - 0.5).abs() < 1e-12, "{p:?}: {}", blur.openness(p));
        }
        // If the radius is larger than the depth step, the mean includes both halves.
        assert!(Blur { radius: (3.0, 0.0), ..blur }.openness([7, 7]) > 0.1);
        // In the last frame of a mean, the blur keeps the pixel's own value.
        let p = [10, 5];
        assert_eq!(Blur { number: 16, ..blur }.openness(p), rotation(p));
        assert_eq!(Blur { number: 1, ..blur }.openness(p), blur.openness(p));
    }
}
