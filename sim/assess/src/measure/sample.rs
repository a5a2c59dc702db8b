//! Points on a surface, uniform by area.

use glam::DVec3;
use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64Mcg;

use super::Surface;

/// Points per stream of random numbers. Streams are assigned by sample number, not by thread, so any number of threads
/// draws the same points.
pub(super) const BLOCK: usize = 4096;

/// Draws points uniformly by area, stratified: of `n` samples, sample `i` lies in the `i`-th of `n`
/// parts of equal area, in the order of the triangles. Every point of the surface stays equally
/// likely, and the estimate of a mean varies less than with independent points.
#[derive(Clone, Debug)]
pub struct SurfaceSampler<'a> {
    surface: &'a Surface,
    /// Area of the triangles up to and including each.
    cumulative: Vec<f64>,
}

impl<'a> SurfaceSampler<'a> {
    /// A sampler of `surface`; `None` if it has no area.
    #[must_use]
    pub fn new(surface: &'a Surface) -> Option<Self> {
        let mut sum = 0.0;
        let cumulative: Vec<f64> = surface
            .triangles
            .iter()
            .map(|&t| {
                let [a, b, c] = corners(surface, t);
                sum += 0.5 * (b - a).cross(c - a).length();
                sum
            })
            .collect();
        (sum > 0.0 && sum.is_finite()).then_some(Self { surface, cumulative })
    }

    /// Samples `BLOCK × block ..` of `count`, at most `BLOCK` of them, as drawn by `seed`.
    pub(super) fn block(&self, seed: u64, block: usize, count: usize) -> impl Iterator<Item = DVec3> + '_ {
        self.located(seed, block, count).map(|located| located.point)
    }

    /// The same samples with their location.
    pub(super) fn located(
        &self,
        seed: u64,
        block: usize,
        count: usize,
    ) -> impl Iterator<Item = Located> + '_ {
        let first = block * BLOCK;
        let last = count.min(first + BLOCK);
        // The odd multiplier (2^64 / golden ratio) keeps the seeds of all blocks apart.
        let stream = (block as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15);
        let mut random = Pcg64Mcg::seed_from_u64(seed.wrapping_add(stream));
        let total = self.cumulative.last().copied().unwrap_or(0.0);
        (first..last).map(move |i| {
            let at = (i as f64 + random.random::<f64>()) / count as f64 * total;
            let triangle = self.cumulative.partition_point(|&sum| sum <= at).min(self.cumulative.len() - 1);
            let [a, b, c] = corners(self.surface, self.surface.triangles[triangle]);
            // Turk, "Generating random points in triangles" (Graphics Gems, 1990).
            let s = random.random::<f64>().sqrt();
            let t = random.random::<f64>();
            let weights = [1.0 - s, s * (1.0 - t), s * t];
            Located { point: a * weights[0] + b * weights[1] + c * weights[2], triangle, weights }
        })
    }
}

/// A point, its triangle, and the weights of the triangle's corners.
#[derive(Clone, Copy, Debug)]
pub(super) struct Located {
    pub(super) point: DVec3,
    pub(super) triangle: usize,
    pub(super) weights: [f64; 3],
}

/// The corners of a triangle.
fn corners(surface: &Surface, triangle: [u32; 3]) -> [DVec3; 3] {
    triangle.map(|v| DVec3::from_array(surface.positions[v as usize]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_are_uniform_by_area() {
        // Two triangles, of area 1/2 and 3/2, in the planes z = 0 and z = 1.
        let surface = Surface {
            positions: vec![
                [0.0, 0.0, 0.0],
                [1.0, 0.0, 0.0],
                [0.0, 1.0, 0.0],
                [0.0, 0.0, 1.0],
                [3.0, 0.0, 1.0],
                [0.0, 1.0, 1.0],
            ],
            triangles: vec![[0, 1, 2], [3, 4, 5]],
        };
        let sampler = SurfaceSampler::new(&surface).unwrap();
        let count = 3 * BLOCK + 7;
        let points: Vec<DVec3> = (0..4).flat_map(|b| sampler.block(1, b, count)).collect();
        assert_eq!(points.len(), count);
        let upper = points.iter().filter(|p| p.z > 0.5).count();
        assert!((upper as f64 / count as f64 - 0.75).abs() < 1e-3);
        // The mean of points on a triangle is its centroid.
        let mean = points.iter().filter(|p| p.z > 0.5).sum::<DVec3>() / upper as f64;
        assert!(mean.distance(DVec3::new(1.0, 1.0 / 3.0, 1.0)) < 0.02, "{mean}");
    }

    #[test]
    fn a_surface_without_area_has_no_samples() {
        let line = Surface { positions: vec![[0.0; 3], [1.0; 3]], triangles: vec![[0, 1, 1]] };
        assert!(SurfaceSampler::new(&line).is_none());
        assert!(SurfaceSampler::new(&Surface::default()).is_none());
    }
}
