//! Reference ambient occlusion by ray casting against a frame's triangles.
//!
//! A ray through each pixel's centre finds the visible triangle and side; cosine-distributed rays then sample the
//! hemisphere above its plane. A hit within the radius occludes by one minus its distance over the radius
//! (`docs/design/occlusion.md` states the integral). For tests and figures: a picture of 480×270 pixels takes minutes
//! at 512 rays on a CPU.

mod drawn;

use std::f64::consts::TAU;

use glam::DVec3;
use lodestream_geometry::mesh::distance::TriangleBvh;
use lodestream_scene::pose::Pose;

use crate::cpu_reference::depth::view_ray;
use crate::cpu_reference::occlusion::radius_at;
use crate::frame::settings::Frame;
use crate::passes::occlusion::OcclusionRadius;
use crate::resources::gpu::{Gpu, RenderError};

/// π (3 − √5).
const GOLDEN_ANGLE: f64 = 2.399_963_229_728_653;
/// Start offset of rays as a fraction of the radius, to skip their own triangle and its neighbours.
const BEGIN: f64 = 1e-5;

/// The surface seen by a pixel, and its openness.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RayHit {
    /// View depth.
    pub depth: f64,
    /// 1 if nothing within the radius occludes, 0 if everything is occluded at distance 0.
    pub openness: f64,
}

/// Ray caster over a frame's triangles, relative to its eye.
#[derive(Clone, Debug)]
pub struct Rays {
    camera: Pose,
    triangles: Vec<[DVec3; 3]>,
    bvh: TriangleBvh,
}

impl Rays {
    /// Reads back the opaque triangles of a frame: meshes at their final positions, and terrain tiles. Alpha-tested
    /// holes count as closed.
    ///
    /// # Errors
    /// Errors of the graphics device.
    pub fn of_frame(gpu: &Gpu, frame: &Frame<'_>) -> Result<Self, RenderError> {
        Ok(Self::new(frame.camera, drawn::triangles(gpu, frame)?))
    }

    /// Builds a ray caster from triangles relative to the camera's eye, on world axes.
    #[must_use]
    pub fn new(camera: Pose, triangles: Vec<[DVec3; 3]>) -> Self {
        let positions: Vec<[f64; 3]> = triangles.iter().flatten().map(DVec3::to_array).collect();
        let indices: Vec<[u32; 3]> =
            (0..triangles.len() as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
        Self { camera, bvh: TriangleBvh::new(&positions, &indices), triangles }
    }

    /// Number of triangles.
    #[must_use]
    pub fn triangles(&self) -> usize {
        self.triangles.len()
    }

    /// Distance to the first hit, in lengths of `direction`, ignoring hits before `beyond`; `from` is relative to the
    /// eye, on world axes.
    #[must_use]
    pub fn first_hit(&self, from: DVec3, direction: DVec3, beyond: f64) -> Option<f64> {
        let hit = self.bvh.first_hit(from.to_array(), direction.to_array(), [beyond, f64::INFINITY]);
        hit.map(|(length, _)| length)
    }

    /// Casts rays for each pixel, rows from the top, with `rays` rays each; `None` where no triangle is seen. The
    /// result does not depend on the number of threads.
    #[must_use]
    pub fn picture(&self, size_px: [u32; 2], radius: OcclusionRadius, rays: u32) -> Vec<Option<RayHit>> {
        let mut picture = vec![None; size_px[0] as usize * size_px[1] as usize];
        let threads = std::thread::available_parallelism().map_or(1, usize::from);
        // Interleave rows: costly ones are adjacent.
        let mut work: Vec<Vec<_>> = (0..threads).map(|_| Vec::new()).collect();
        for (y, row) in picture.chunks_mut(size_px[0] as usize).enumerate() {
            work[y % threads].push((y, row));
        }
        std::thread::scope(|scope| {
            for rows in work {
                scope.spawn(move || {
                    for (y, row) in rows {
                        for (x, seen) in row.iter_mut().enumerate() {
                            *seen = self.pixel([x as u32, y as u32], size_px, radius, rays);
                        }
                    }
                });
            }
        });
        picture
    }

    fn pixel(
        &self,
        [x, y]: [u32; 2],
        size_px: [u32; 2],
        radius: OcclusionRadius,
        rays: u32,
    ) -> Option<RayHit> {
        let tan: [f64; 2] = self.camera.tan_half_fov(size_px[0], size_px[1]).into();
        let ray = self.camera.rotation * DVec3::from(view_ray([x.into(), y.into()], size_px, tan));
        // The ray has unit depth.
        let (depth, triangle) = self.bvh.first_hit([0.0; 3], ray.to_array(), [0.0, f64::INFINITY])?;
        let [a, b, c] = self.triangles[triangle as usize];
        let normal = (b - a).cross(c - a).normalize();
        let normal = if normal.dot(ray) > 0.0 { -normal } else { normal };
        let asked = match radius {
            OcclusionRadius::World(radius) => (f64::from(radius), 0.0),
            OcclusionRadius::Depth(share) => (0.0, f64::from(share)),
        };
        let radius = radius_at(depth, asked, f64::from(size_px[1]) / (2.0 * tan[1]));
        // Random rotation per pixel: few rays give noise rather than a pattern.
        let turn = f64::from(hash(x ^ hash(y))) / f64::from(u32::MAX) * TAU;
        let (tangent, bitangent) = normal.any_orthonormal_pair();
        let from = (ray * depth + normal * (BEGIN * radius)).to_array();
        let hidden = (0..rays).map(|i| {
            // Evenly over the disc under the hemisphere (Malley's method).
            let share = (f64::from(i) + 0.5) / f64::from(rays);
            let (sin, cos) = (GOLDEN_ANGLE * f64::from(i) + turn).sin_cos();
            let across = share.sqrt();
            let along = across * (cos * tangent + sin * bitangent) + (1.0 - share).sqrt() * normal;
            let hit = self.bvh.first_hit(from, (along * radius).to_array(), [BEGIN, 1.0]);
            hit.map_or(0.0, |(length, _)| 1.0 - length)
        });
        let hidden = hidden.sum::<f64>() / f64::from(rays.max(1));
        Some(RayHit { depth, openness: 1.0 - hidden })
    }
}

/// Integer hash (Wellons, "Prospecting for hash functions", 2018).
fn hash(mut x: u32) -> u32 {
    x = (x ^ (x >> 16)).wrapping_mul(0x21f0_aaad);
    x = (x ^ (x >> 15)).wrapping_mul(0x735a_2d97);
    x ^ (x >> 15)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A floor about the origin and a wall of the given height on it at x = 0.
    fn floor_and_wall(height: f64) -> Rays {
        let quad = |corner: DVec3, u: DVec3, v: DVec3| {
            [[corner, corner + u, corner + u + v], [corner, corner + u + v, corner + v]]
        };
        let eye = DVec3::new(0.0, 4.0, 0.0);
        let floor = quad(DVec3::new(-9.0, 0.0, -9.0), DVec3::X * 18.0, DVec3::Z * 18.0);
        let wall = quad(DVec3::new(0.0, 0.0, -9.0), DVec3::Y * height, DVec3::Z * 18.0);
        let camera = Pose::look_at(eye, DVec3::new(1e-9, 0.0, 0.0), DVec3::NEG_Z, 0.5);
        Rays::new(camera, floor.into_iter().chain(wall).map(|t| t.map(|p| p - eye)).collect())
    }

    #[test]
    fn beside_a_wall_it_is_as_open_as_the_integral_says() {
        let rays = floor_and_wall(3.0);
        let (size, radius) = ([40, 40], 1.0_f32);
        let picture = rays.picture(size, OcclusionRadius::World(radius), 4096);
        let tan = 0.25_f64.tan();
        for x in [20_u32, 23, 27, 32, 38] {
            let seen = picture[(20 * size[0] + x) as usize].unwrap();
            assert!((seen.depth - 4.0).abs() < 1e-9);
            let beside = 4.0 * tan * ((f64::from(x) + 0.5) / 20.0 - 1.0);
            // The share of directions that meet the wall, weighted by distance, summed over both angles.
            let (n, mut hidden) = (400, 0.0);
            for (i, j) in (0..n).flat_map(|i| (0..n).map(move |j| (i, j))) {
                let [u, v] = [i, j].map(|k| (f64::from(k) + 0.5) / f64::from(n));
                let towards = u.sqrt() * (TAU * v).cos();
                if towards > beside {
                    hidden += (1.0 - beside / towards) / f64::from(n * n);
                }
            }
            assert!((1.0 - hidden - seen.openness).abs() < 2e-3, "{x}: {hidden} {seen:?}");
        }
        // The wall is beyond the radius.
        assert_eq!(rays.picture([2, 2], OcclusionRadius::World(0.2), 64)[1].unwrap().openness, 1.0);
    }
}
