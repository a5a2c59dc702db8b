//! Screen-space ambient occlusion: `ssao.wgsl`, before the blur.

use super::surface::{DepthPicture, V3, dot, sub};

/// Most samples per pixel.
pub const MAX_SAMPLES: usize = 64;
/// As in the shader: height above the tangent plane, as a fraction of the radius, from which on a
/// neighbour occludes.
const MIN_ELEVATION: f64 = 0.03;
const MIN_RADIUS_PX: f64 = 1.0;
const MAX_RADIUS_PX: f64 = 256.0;

/// Sample offsets in the unit hemisphere about +z: directions cosine-weighted (so that the mean is
/// the occlusion integral itself), on a golden-angle spiral; lengths evenly
/// from a tenth of the radius on.
pub fn kernel(samples: usize) -> impl ExactSizeIterator<Item = [f64; 3]> {
    // π (3 − √5).
    const GOLDEN_ANGLE: f64 = 2.399_963_229_728_653;
    (0..samples).map(move |i| {
        let u = (i as f64 + 0.5) / samples as f64;
        let (radial, height) = (u.sqrt(), (1.0 - u).sqrt());
        let (sin, cos) = (GOLDEN_ANGLE * i as f64).sin_cos();
        // Lengths in another order than directions: 7 is coprime to powers of two.
        let t = ((i * 7) % samples) as f64 / samples as f64;
        let length = 0.1 + 0.9 * (t + 0.5 / samples as f64);
        [radial * cos * length, radial * sin * length, height * length]
    })
}

/// Occlusion of a depth buffer's surfaces.
#[derive(Clone, Copy, Debug)]
pub struct Occlusion<'a> {
    /// The surfaces.
    pub picture: DepthPicture<'a>,
    /// Radius in world units, and per unit of depth; added.
    pub radius: (f64, f64),
    /// Samples per pixel.
    pub samples: usize,
}

/// Two perpendiculars to the unit vector `n` (Duff et al., 2017).
fn basis(n: V3) -> [V3; 2] {
    let s = if n[2] >= 0.0 { 1.0 } else { -1.0 };
    let a = -1.0 / (s + n[2]);
    let b = n[0] * n[1] * a;
    [[1.0 + s * n[0] * n[0] * a, s * b, -s * n[0]], [b, s + n[1] * n[1] * a, -n[1]]]
}

/// Which of the 16 rotations a pixel uses.
#[must_use]
pub fn rotation_index(pixel: [i64; 2]) -> u32 {
    let (x, y) = ((pixel[0] & 3) as u32, (pixel[1] & 3) as u32);
    let xy = x ^ y;
    ((xy & 1) << 3) | ((y & 1) << 2) | (xy & 2) | ((y & 2) >> 1)
}

impl Occlusion<'_> {
    /// How open the surface at a pixel is: 1 = nothing near hides the sky, 0 = buried.
    #[must_use]
    pub fn openness(&self, pixel: [i64; 2], strength: f64) -> f64 {
        let Self { picture, .. } = self;
        let DepthPicture { size_px, tan_half_fov, .. } = *picture;
        let depth = picture.depth_at(pixel);
        let scale_px = f64::from(size_px[1]) / (2.0 * tan_half_fov[1]);
        let radius = (self.radius.0 + self.radius.1 * depth).min(MAX_RADIUS_PX * depth / scale_px);
        if depth >= 1e30 || radius * scale_px < MIN_RADIUS_PX * depth {
            return 1.0;
        }
        let centre = picture.position_at(pixel);
        let normal = picture.normal_at(pixel, centre);
        let [tangent, bitangent] = basis(normal);
        let (sin, cos) = (f64::from(rotation_index(pixel)) * std::f64::consts::TAU / 16.0).sin_cos();
        let mut occluded = 0.0;
        for [x, y, z] in kernel(self.samples) {
            let (x, y) = (x * cos - y * sin, x * sin + y * cos);
            let s: V3 =
                [0, 1, 2].map(|i| centre[i] + radius * (tangent[i] * x + bitangent[i] * y + normal[i] * z));
            if s[2] >= 0.0 {
                continue;
            }
            let ndc = [0, 1].map(|i| s[i] / (tan_half_fov[i] * -s[2]));
            if ndc.iter().any(|n| n.abs() >= 1.0) {
                continue;
            }
            let uv = [ndc[0] * 0.5 + 0.5, 0.5 - ndc[1] * 0.5];
            let there = [0, 1].map(|i| (uv[i] * f64::from(size_px[i])) as i64);
            let depth_there = picture.depth_at(there);
            let height = dot(sub(picture.position_at(there), centre), normal);
            if depth_there < -s[2] && height > MIN_ELEVATION * radius {
                let t = (radius / (depth - depth_there).abs().max(1e-30)).clamp(0.0, 1.0);
                occluded += t * t * (3.0 - 2.0 * t);
            }
        }
        (1.0 - strength * occluded / self.samples as f64).clamp(0.0, 1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::twin::depth::view_ray;

    #[test]
    fn kernel_is_a_cosine_weighted_hemisphere() {
        for samples in [8, 16, 32, MAX_SAMPLES] {
            let k: Vec<V3> = kernel(samples).collect();
            let mean =
                |axis: usize| k.iter().map(|v| v[axis] / dot(*v, *v).sqrt()).sum::<f64>() / samples as f64;
            // The mean of cos θ under a cosine-weighted distribution is 2/3.
            assert!((mean(2) - 2.0 / 3.0).abs() < 0.02, "{samples}: {}", mean(2));
            assert!(mean(0).abs() < 0.1 && mean(1).abs() < 0.1, "{samples}: {} {}", mean(0), mean(1));
            assert!(k.iter().all(|v| v[2] > 0.0 && dot(*v, *v) <= 1.0));
        }
    }

    #[test]
    fn each_rotation_occurs_once_in_every_4x4_window() {
        for (ox, oy) in [(0, 0), (1, 3), (2, 2)] {
            let mut seen = [0; 16];
            for y in 0..4 {
                for x in 0..4 {
                    seen[rotation_index([x + ox, y + oy]) as usize] += 1;
                }
            }
            assert_eq!(seen, [1; 16]);
        }
    }

    /// Depths of what `distance(ray)` gives along z.
    fn picture(size: u32, depth_of: impl Fn(V3) -> f64) -> Vec<f32> {
        let px = (0..size * size).map(|i| [i64::from(i % size), i64::from(i / size)]);
        px.map(|p| (0.01 / depth_of(view_ray(p, [size; 2], [0.5; 2]))) as f32).collect()
    }

    fn mean_openness(stored: &[f32], size: u32) -> f64 {
        let picture = DepthPicture { stored, size_px: [size; 2], tan_half_fov: [0.5; 2], near: 0.01 };
        let occlusion = Occlusion { picture, radius: (0.5, 0.0), samples: 16 };
        // A 4×4 window in the middle: every rotation once, as after the blur.
        let middle = i64::from(size / 2);
        let window = (0..16).map(|i| [middle - 2 + i % 4, middle - 2 + i / 4]);
        window.map(|p| occlusion.openness(p, 1.0)).sum::<f64>() / 16.0
    }

    #[test]
    fn a_corner_is_darker_than_a_plane() {
        let size = 96;
        let facing = mean_openness(&picture(size, |_| 4.0), size);
        // z = -(4 + x): a plane seen at 45°.
        let tilted = mean_openness(&picture(size, |r| 4.0 / (1.0 - r[0])), size);
        // Two walls that meet in an edge running away from the eye: z = -(4 - |x|).
        let edge = mean_openness(&picture(size, |r| 4.0 / (1.0 + r[0].abs())), size);
        // The same edge pointing at the eye: nothing hides anything.
        let ridge = mean_openness(&picture(size, |r| 4.0 / (1.0 - r[0].abs())), size);
        assert_eq!(facing, 1.0);
        assert!(tilted > 0.98, "{tilted}");
        assert!(ridge > 0.98, "{ridge}");
        // In the edge itself each wall hides half of the other's hemisphere; the window also holds
        // points beside it, whose shorter samples miss the wall.
        assert!((0.5..0.8).contains(&edge), "{edge}");
    }
}
