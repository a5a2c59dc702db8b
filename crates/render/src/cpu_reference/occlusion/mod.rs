//! Ambient occlusion in screen space: `occlusion.wgsl`, a file for each estimator, and the blur.

#[cfg(any(test, feature = "methods"))]
mod alchemy;
#[cfg(any(test, feature = "methods"))]
mod bitmask;
mod blur;
mod gtao;
mod half;
#[cfg(any(test, feature = "methods"))]
mod hbao;
mod normal;
mod receiver;
mod slices;
#[cfg(any(test, feature = "methods"))]
mod ssao;

pub use blur::Blur;
pub use half::{Upsample, half_pixel, half_size};
pub use normal::Normals;
use receiver::Receiver;

use super::surface::DepthPicture;
use crate::passes::occlusion::OcclusionMethod;

const MIN_RADIUS_PX: f64 = 1.0;
const MAX_RADIUS_PX: f64 = 256.0;

/// Occlusion of a depth buffer's surfaces.
#[derive(Clone, Copy, Debug)]
pub struct Occlusion<'a> {
    /// The surfaces.
    pub picture: DepthPicture<'a>,
    /// The estimator.
    pub method: OcclusionMethod,
    /// Source of normals.
    pub normals: Normals<'a>,
    /// Radius in world units, and per unit of depth; added.
    pub radius: (f64, f64),
    /// Samples per pixel.
    pub samples: usize,
    /// Offset of the rotations in a frame of a mean; `None` without accumulation.
    pub turned: Option<u32>,
}

/// Which of the 16 rotations a pixel uses.
#[must_use]
pub fn rotation_index(pixel: [i64; 2]) -> u32 {
    let (x, y) = ((pixel[0] & 3) as u32, (pixel[1] & 3) as u32);
    let xy = x ^ y;
    ((xy & 1) << 3) | ((y & 1) << 2) | (xy & 2) | ((y & 2) >> 1)
}

/// Reach at a depth, in world units: what was asked for, but at most 256 pixels.
#[must_use]
pub fn radius_at(depth: f64, radius: (f64, f64), scale_px: f64) -> f64 {
    (radius.0 + radius.1 * depth).min(MAX_RADIUS_PX * depth / scale_px)
}

impl Occlusion<'_> {
    /// Openness of a pixel: 1 = unoccluded, 0 = fully occluded.
    #[must_use]
    pub fn openness(&self, pixel: [i64; 2], strength: f64) -> f64 {
        self.openness_turned_as(pixel, pixel, strength)
    }

    /// Openness with the rotation of another pixel.
    fn openness_turned_as(&self, pixel: [i64; 2], place: [i64; 2], strength: f64) -> f64 {
        let Self { picture, samples, .. } = *self;
        let depth = picture.depth_at(pixel);
        let scale_px = picture.scale_px();
        let radius = radius_at(depth, self.radius, scale_px);
        if depth >= 1e30 || radius * scale_px < MIN_RADIUS_PX * depth {
            return 1.0;
        }
        let centre = picture.position_at(pixel);
        let normal = self.normals.of(&picture, pixel, centre);
        let rotation = (rotation_index(place) + self.turned.unwrap_or(0)) & 15;
        let stride = if self.method.is_layered() { 4 } else { 1 };
        let receiver =
            Receiver { picture, pixel, depth, centre, normal, radius, rotation, scale_px, samples, stride };
        let [occluded, of] = match self.method {
            #[cfg(any(test, feature = "methods"))]
            OcclusionMethod::Ssao => ssao::sums(&receiver, false),
            #[cfg(any(test, feature = "methods"))]
            OcclusionMethod::SsaoCentred => ssao::sums(&receiver, true),
            #[cfg(any(test, feature = "methods"))]
            OcclusionMethod::Hbao | OcclusionMethod::HbaoPlus => hbao::sums(&receiver),
            #[cfg(any(test, feature = "methods"))]
            OcclusionMethod::Alchemy => alchemy::sums(&receiver),
            OcclusionMethod::Gtao => gtao::sums(&receiver),
            #[cfg(any(test, feature = "methods"))]
            OcclusionMethod::Bitmask => bitmask::sums(&receiver),
        };
        (1.0 - strength * occluded / of).clamp(0.0, 1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cpu_reference::depth::view_ray;
    use crate::cpu_reference::surface::V3;

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

    /// Stored depths of a picture in which a ray has the depth `depth_of(ray)` along z.
    fn picture(size: u32, depth_of: impl Fn(V3) -> f64) -> Vec<f32> {
        let px = (0..size * size).map(|i| [i64::from(i % size), i64::from(i / size)]);
        px.map(|p| (0.01 / depth_of(view_ray(p, [size; 2], [0.5; 2]))) as f32).collect()
    }

    fn mean_openness((method, normals): (OcclusionMethod, Normals<'_>), stored: &[f32], size: u32) -> f64 {
        let picture = DepthPicture { stored, size_px: [size; 2], tan_half_fov: [0.5; 2], near: 0.01 };
        let occlusion = Occlusion { picture, method, normals, radius: (0.5, 0.0), samples: 16, turned: None };
        // A 4×4 window in the middle has every rotation once, as the blur does.
        let middle = i64::from(size / 2);
        let window = (0..16).map(|i| [middle - 2 + i % 4, middle - 2 + i / 4]);
        window.map(|p| occlusion.openness(p, 1.0)).sum::<f64>() / 16.0
    }

    #[test]
    fn a_corner_is_darker_than_a_plane() {
        let size = 96;
        let both = |method| [(method, Normals::Nearest), (method, Normals::Extended)];
        for (method, normals) in OcclusionMethod::ALL.into_iter().flat_map(both) {
            let mean =
                |depth_of: fn(V3) -> f64| mean_openness((method, normals), &picture(size, depth_of), size);
            let facing = mean(|_| 4.0);
            // z = -(4 + x): a plane seen at 45°.
            let tilted = mean(|r| 4.0 / (1.0 - r[0]));
            // Two walls that meet in an edge running away from the eye: z = -(4 - |x|).
            let edge = mean(|r| 4.0 / (1.0 + r[0].abs()));
            // The same edge pointing at the eye: nothing is occluded.
            let ridge = mean(|r| 4.0 / (1.0 - r[0].abs()));
            let name = method.name();
            println!("{name}, {normals:?}: facing {facing}, tilted {tilted}, edge {edge}, ridge {ridge}");
            assert_eq!(facing, 1.0, "{method:?}");
            assert!(tilted > 0.98, "{method:?}: {tilted}");
            assert!(ridge > 0.98, "{method:?}: {ridge}");
            // In the edge each wall hides half of the other's hemisphere: the integral's mean over the window is 0.703.
            // Beside the edge the neighbour nearest in depth is on the other wall, so `nearest` normals lie between
            // both walls' normals and make slices' horizons too low, by a tenth. Directions that are even in the
            // picture are too few towards slanting walls, whatever the normal.
            let most = match (method, normals) {
                (OcclusionMethod::Hbao | OcclusionMethod::HbaoPlus, _) => 0.87,
                (OcclusionMethod::Gtao | OcclusionMethod::Bitmask, Normals::Nearest) => 0.8,
                (OcclusionMethod::Gtao | OcclusionMethod::Bitmask, _) => 0.74,
                _ => 0.8,
            };
            assert!((0.6..most).contains(&edge), "{method:?} {normals:?}: {edge}");
        }
    }
}
