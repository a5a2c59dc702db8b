//! Ray-cast reference picture of a wall.
//!
//! Rays hit the bilinear surface between the texels, each patch approximated by eight triangles; hits are lit by the
//! sun, unless a ray to it is blocked, and by a uniform sky without occlusion, with the renderer's reflectance in f64.

use glam::DVec3;
use image::{Rgba, RgbaImage};
use lodestream_geometry::mesh::distance::TriangleBvh;
use lodestream_render::cpu_reference::brdf::{DIELECTRIC, Reflector, Specular, from_sky};
use lodestream_render::cpu_reference::tone;
use lodestream_render::{Environment, GradientSky, Sky};
use lodestream_scene::view::View;

use super::wall::{REPEATS, ROUGHNESS, SIDE_M, Wall, faces};

/// Rays along each side of a pixel.
const SIDE_RAYS: u32 = 3;
/// Grid lines of the surface per texel.
const PARTS: usize = 2;
/// Distance above the surface at which a ray to the sun starts, in metres.
const LIFT: f64 = 1e-6;
/// Number of tabulated cosines of the sky's contribution.
const COSINES: usize = 64;

/// Light over the wall: the sun from the upper right, and a sky of one radiance.
const TO_SUN: [f64; 3] = [0.55, 0.55, 0.63];
const SUN: [f32; 3] = [0.95, 0.9, 0.8];
const SKY: f32 = 0.22;

/// The light, for the renderer.
pub(super) fn environment() -> Environment {
    let sky = glam::Vec3::splat(SKY);
    Environment {
        to_sun: DVec3::from(TO_SUN),
        sky: Sky::Plain(GradientSky { sun: SUN.into(), zenith: sky, horizon: sky, ground: sky }),
        haze: None,
        ..Environment::default()
    }
}

/// A wall for ray casting.
#[derive(Debug)]
pub(super) struct Traced<'a> {
    wall: &'a Wall,
    bvh: TriangleBvh,
    /// Reflection of a uniform sky of radiance 1 by the cosine to the eye: the factor of the specular reflectance, and
    /// the rest.
    mirrored: Vec<[f64; 2]>,
}

/// Reference pictures, with a mask of the wall.
#[derive(Clone, Debug)]
pub(super) struct Truth {
    /// With sunlight everywhere.
    pub(super) shape: RgbaImage,
    /// With sunlight only where the sun is visible.
    pub(super) shadowed: RgbaImage,
    /// Pixels in which rays hit the wall or its plane.
    pub(super) covered: Vec<bool>,
}

/// Mean radiances of a pixel.
#[derive(Clone, Copy, Debug, Default)]
struct Pixel {
    shape: DVec3,
    shadowed: DVec3,
    covered: bool,
}

impl<'a> Traced<'a> {
    pub(super) fn new(wall: &'a Wall) -> Self {
        let lines = wall.lines(REPEATS, PARTS);
        let points: Vec<[f64; 3]> = lines
            .iter()
            .flat_map(|y| lines.iter().map(move |x| [*x, *y]))
            .map(|at| wall.place(at).at.to_array())
            .collect();
        let triangles: Vec<[u32; 3]> = faces(lines.len()).collect();
        let mirror = |cosine: f64, f0: f64| {
            let to_eye = [(1.0 - cosine * cosine).sqrt(), 0.0, cosine];
            let normal = [0.0, 0.0, 1.0];
            let r = Reflector {
                albedo: [f0; 3],
                metal: 1.0,
                roughness: ROUGHNESS,
                normal,
                to_eye,
                specular: Specular::USUAL,
            };
            from_sky(&r, 48, |_| [1.0; 3])[0]
        };
        let cosines = (0..=COSINES).map(|i| (i as f64 / COSINES as f64).max(1e-3));
        let mirrored = cosines.map(|cosine| [mirror(cosine, 1.0), mirror(cosine, 0.0)]).collect();
        Self { wall, bvh: TriangleBvh::new(&points, &triangles), mirrored }
    }

    /// The picture; it does not depend on the number of threads.
    pub(super) fn picture(&self, view: &View) -> Truth {
        let [width, height] = view.viewport_px;
        let mut pixels = vec![Pixel::default(); width as usize * height as usize];
        let threads = std::thread::available_parallelism().map_or(1, usize::from);
        // Rows are interleaved, since costly rows are adjacent.
        let mut work: Vec<Vec<_>> = (0..threads).map(|_| Vec::new()).collect();
        for (y, row) in pixels.chunks_mut(width as usize).enumerate() {
            work[y % threads].push((y, row));
        }
        std::thread::scope(|scope| {
            for rows in work {
                scope.spawn(move || {
                    for (y, row) in rows {
                        for (x, pixel) in row.iter_mut().enumerate() {
                            *pixel = self.pixel(view, [x as u32, y as u32]);
                        }
                    }
                });
            }
        });
        let picture = |of: fn(&Pixel) -> DVec3| {
            RgbaImage::from_fn(width, height, |x, y| {
                let shown = |light: f64| (tone::encode_srgb(tone::filmic(light)) * 255.0).round() as u8;
                let [r, g, b] = of(&pixels[(y * width + x) as usize]).to_array().map(shown);
                Rgba([r, g, b, 255])
            })
        };
        Truth {
            shape: picture(|pixel| pixel.shape),
            shadowed: picture(|pixel| pixel.shadowed),
            covered: pixels.iter().map(|pixel| pixel.covered).collect(),
        }
    }

    fn pixel(&self, view: &View, [x, y]: [u32; 2]) -> Pixel {
        let [width, height] = view.viewport_px;
        let camera = view.pose();
        let (tan_x, tan_y) = camera.tan_half_fov(width, height);
        let (mut sum, mut covered) = ([DVec3::ZERO; 2], false);
        for i in 0..SIDE_RAYS * SIDE_RAYS {
            let within = |k: u32| (f64::from(k) + 0.5) / f64::from(SIDE_RAYS);
            let u = (f64::from(x) + within(i % SIDE_RAYS)) / f64::from(width);
            let v = (f64::from(y) + within(i / SIDE_RAYS)) / f64::from(height);
            let ray = DVec3::new((2.0 * u - 1.0) * tan_x, (1.0 - 2.0 * v) * tan_y, -1.0);
            let ray = (camera.rotation * ray).normalize();
            let seen = self.seen(camera.eye, ray);
            let radiances = seen.unwrap_or([DVec3::splat(SKY.into()); 2]);
            sum = [0, 1].map(|k| sum[k] + radiances[k]);
            let on_plane = camera.eye - ray * (camera.eye.z / ray.z);
            let plane = ray.z < 0.0 && on_plane.truncate().abs().max_element() <= 0.5 * SIDE_M;
            covered |= seen.is_some() || plane;
        }
        let [shape, shadowed] = sum.map(|sum| sum / f64::from(SIDE_RAYS * SIDE_RAYS));
        Pixel { shape, shadowed, covered }
    }

    /// Radiances of the wall along a ray that hits it, without and with shadows.
    fn seen(&self, eye: DVec3, ray: DVec3) -> Option<[DVec3; 2]> {
        let (far, _) = self.bvh.first_hit(eye.to_array(), ray.to_array(), [0.0, f64::INFINITY])?;
        let at = eye + ray * far;
        let place = self.wall.place([at.x, at.y]);
        let reflector = Reflector {
            albedo: place.albedo,
            metal: 0.0,
            roughness: ROUGHNESS,
            normal: place.normal.to_array(),
            to_eye: (-ray).to_array(),
            specular: Specular::USUAL,
        };
        let to_sun = DVec3::from(TO_SUN).normalize();
        let from = at + DVec3::Z * LIFT;
        // Above the plane nothing occludes the sun.
        let way = (LIFT - at.z) / to_sun.z;
        let free = self.bvh.first_hit(from.to_array(), to_sun.to_array(), [0.0, way]).is_none();
        let sun = DVec3::from(reflector.from_light(to_sun.to_array(), SUN.map(f64::from)));
        let sky = self.of_sky(&reflector);
        Some([sky + sun, if free { sky + sun } else { sky }])
    }

    /// A dielectric's reflection of the uniform sky, split as in the renderer.
    fn of_sky(&self, r: &Reflector) -> DVec3 {
        let cosine = DVec3::from(r.normal).dot(DVec3::from(r.to_eye)).clamp(0.0, 1.0);
        let at = cosine * COSINES as f64;
        let (low, share) = ((at as usize).min(COSINES - 1), at - at.floor().min((COSINES - 1) as f64));
        let [full, none] = [0, 1]
            .map(|k| self.mirrored[low][k] + (self.mirrored[low + 1][k] - self.mirrored[low][k]) * share);
        let mirrored = none + (full - none) * DIELECTRIC;
        DVec3::from(r.albedo.map(|albedo| f64::from(SKY) * ((1.0 - mirrored) * albedo + mirrored)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rays_hit_sunlit_stones_and_shaded_joints() {
        let [wall, _] = Wall::all(32);
        let traced = Traced::new(&wall);
        let view = View {
            target_px: 1.0,
            ..View::look_at([0.0, 0.0, 2.5], [0.0; 3], [0.0, 1.0, 0.0], 0.9, [64, 48])
        };
        let truth = traced.picture(&view);
        let [covered, all] = [truth.covered.iter().filter(|c| **c).count(), truth.covered.len()];
        assert!(covered * 2 > all && covered < all, "{covered} of {all}");
        // The face of a stone, and the joint below it, which the sun reaches on the stone's side.
        let [lit, joint] =
            [[0.2, 0.12], [0.2, 0.24]].map(|[x, y]| traced.seen(DVec3::new(x, y, 2.0), DVec3::NEG_Z));
        let ([shape, shadowed], [joint_shape, joint_shadowed]) = (lit.unwrap(), joint.unwrap());
        assert_eq!(shape, shadowed);
        assert!(joint_shadowed.x < 0.6 * joint_shape.x, "{joint_shadowed} {joint_shape}");
        assert!(traced.seen(DVec3::new(1.2, 0.0, 2.0), DVec3::NEG_Z).is_none());
    }
}
