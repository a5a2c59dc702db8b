//! Half-resolution occlusion and its upsampling: `occlusion_half.wgsl` and `occlusion_upsample.wgsl`.

use super::{Occlusion, radius_at};
use crate::cpu_reference::surface::DepthPicture;

/// The pixel of a 2×2 that is estimated.
#[must_use]
pub fn half_pixel(cell: [i64; 2], size_px: [u32; 2]) -> [i64; 2] {
    [0, 1].map(|i| (2 * cell[i] + (cell[1 - i] & 1)).min(i64::from(size_px[i]) - 1))
}

/// Size of the half-resolution picture.
#[must_use]
pub fn half_size(size_px: [u32; 2]) -> [u32; 2] {
    size_px.map(|side| side.div_ceil(2))
}

impl Occlusion<'_> {
    /// Openness of the estimated pixel of a 2×2.
    #[must_use]
    pub fn half_openness(&self, cell: [i64; 2], strength: f64) -> f64 {
        self.openness_turned_as(half_pixel(cell, self.picture.size_px), cell, strength)
    }
}

/// An estimate of one pixel of each 2×2.
#[derive(Clone, Copy, Debug)]
pub struct Upsample<'a> {
    /// The surfaces.
    pub picture: DepthPicture<'a>,
    /// Openness of the estimated pixel of each 2×2, rows from the top.
    pub half: &'a [f64],
    /// Radius in world units, and per unit of depth; added.
    pub radius: (f64, f64),
}

impl Upsample<'_> {
    /// Final openness of a pixel.
    #[must_use]
    pub fn openness(&self, pixel: [i64; 2]) -> f64 {
        let Self { picture, half, radius } = *self;
        let depth = picture.depth_at(pixel);
        if depth >= 1e30 {
            return 1.0;
        }
        let reach = radius_at(depth, radius, picture.scale_px());
        let size = half_size(picture.size_px).map(i64::from);
        let window = (0..16).map(|i| [i % 4, i / 4]);
        let cells = window
            .map(|offset| [0, 1].map(|i| ((pixel[i] + 1) / 2 - 2 + offset[i]).clamp(0, size[i] - 1)))
            .map(|cell| {
                let off = (picture.depth_at(half_pixel(cell, picture.size_px)) - depth).abs();
                (off, half[(cell[1] * size[0] + cell[0]) as usize])
            });
        let cells: Vec<(f64, f64)> = cells.collect();
        let as_deep: Vec<f64> =
            cells.iter().filter(|(off, _)| *off <= reach).map(|(_, open)| *open).collect();
        if as_deep.is_empty() {
            let nearest = cells.into_iter().fold((2e30, 1.0), |a, b| if b.0 < a.0 { b } else { a });
            return nearest.1;
        }
        as_deep.iter().sum::<f64>() / as_deep.len() as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_of_a_pixel_are_met_by_every_second_cell_along_them() {
        let size = [20, 14];
        let cells = || (0..70).map(|i| [i % 10, i / 10]);
        for (axis, line) in (0..2).flat_map(|axis| (0..12).map(move |line| (axis, line))) {
            let on_line = cells().filter(|cell| cell[axis] == line / 2);
            let met = on_line.clone().filter(|cell| half_pixel(*cell, size)[axis] == line);
            assert!(2 * met.count() + 1 >= on_line.count(), "{axis} {line}");
        }
        // Pictures with odd sides, and of one pixel.
        assert_eq!(
            (half_size([5, 1]), half_pixel([2, 0], [5, 1]), half_pixel([1, 0], [5, 1])),
            ([3, 1], [4, 0], [2, 0])
        );
    }

    #[test]
    fn a_pixel_whose_depth_no_cell_has_takes_the_nearest() {
        let size = 16_i64;
        let pixels = || (0..size * size).map(|i| [i % size, i / size]);
        let odd = |p: [i64; 2]| p == [6, 7];
        // A plane 4 away with one pixel 2 away, which is not among the estimated pixels.
        let stored: Vec<f32> = pixels().map(|p| if odd(p) { 0.005 } else { 0.0025 }).collect();
        assert!((0..64).all(|i| !odd(half_pixel([i % 8, i / 8], [16; 2]))));
        let half: Vec<f64> =
            (0..64).map(|i| f64::from(super::super::rotation_index([i % 8, i / 8])) / 15.0).collect();
        let picture = DepthPicture { stored: &stored, size_px: [16; 2], tan_half_fov: [0.5; 2], near: 0.01 };
        let upsample = Upsample { picture, half: &half, radius: (0.5, 0.0) };
        for p in pixels().filter(|p| p.iter().all(|x| (3..12).contains(x))) {
            let got = upsample.openness(p);
            let want = if odd(p) { half[(2 * 8 + 1) as usize] } else { 0.5 };
            assert!((got - want).abs() < 1e-12, "{p:?}: {got}");
        }
    }
}
