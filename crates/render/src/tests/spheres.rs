//! Spheres under the physical sky and its sun, against a path tracer: the total error of image-based light with its
//! harmonics, prefiltered lobes and split sum.

use glam::DVec3;
use half::f16;
use lodestream_geometry::random::Random;

use super::shapes::{asset, sphere};
use super::{headless, keep};
use crate::cpu_reference::brdf::{Reflector, Specular};
use crate::cpu_reference::depth::view_ray;
use crate::cpu_reference::sky::Octahedral;
use crate::frame::graph::Resource;
use crate::passes::sky::SkyGpu;
use crate::{
    AntiAliasing, Atmosphere, Drawable, Environment, Frame, Headless, Material, Placement, Pose, Settings,
    Sky,
};

const SIDE: u32 = 32;
const RADIUS: f64 = 0.5;
/// Paths of each of two estimates, whose difference gives their noise.
const PATHS: u32 = 512;
/// Angular radius of the sky's sun.
const SUN_RADIUS: f64 = 0.004_65;

/// A ball under the open sky.
struct Traced<'a> {
    material: Material,
    sky: &'a Octahedral,
    /// The map's axes in the world: its x, y and z.
    axes: [DVec3; 3],
    to_sun: DVec3,
    /// Irradiance over π on a surface that faces the sun.
    sun: DVec3,
}

/// Where a ray first meets the ball about the origin.
fn meets(from: DVec3, ray: DVec3) -> Option<DVec3> {
    let (b, c) = (ray.dot(from), from.length_squared() - RADIUS * RADIUS);
    let root = (b * b - c).sqrt();
    // NaN if the ray misses the ball.
    let along = -b - root;
    (along > 1e-9).then(|| from + ray * along)
}

/// A direction around an axis, given by its cosine and its turn in circles.
fn around(axis: DVec3, cosine: f64, turn: f64) -> DVec3 {
    let (x, y) = axis.any_orthonormal_pair();
    let (sin, cos) = (std::f64::consts::TAU * turn).sin_cos();
    let wide = (1.0 - cosine * cosine).max(0.0).sqrt();
    x * (wide * cos) + y * (wide * sin) + axis * cosine
}

impl Traced<'_> {
    fn seen(&self, ray: DVec3) -> DVec3 {
        self.sky.at(DVec3::from(self.axes.map(|axis| ray.dot(axis))))
    }

    /// Radiance along a path from the eye. At each hit it samples a point of the sun's disc, and continues in a
    /// direction drawn from the microfacets' lobe or from Lambert's, weighted by the density of both (Veach and Guibas,
    /// "Optimally combining sampling techniques", 1995). With a ball alone all paths leave after the first hit.
    /// `draws`, from 0 to 1, are used at the first hit: two for a direction, one for the lobe, two for the sun.
    fn path(&self, mut from: DVec3, mut ray: DVec3, draws: [f64; 5], random: &mut Random) -> DVec3 {
        let (mut sum, mut weight) = (DVec3::ZERO, DVec3::ONE);
        for bounce in 0..8 {
            let Some(at) = meets(from, ray) else { return sum + weight * self.seen(ray) };
            let normal = at / RADIUS;
            let [albedo @ .., _] = self.material.base_color.map(f64::from);
            let reflector = Reflector {
                albedo,
                metal: f64::from(self.material.metallic),
                roughness: f64::from(self.material.roughness),
                normal: normal.to_array(),
                to_eye: (-ray).to_array(),
                specular: Specular::USUAL,
            };
            let [u, turn, lobe, disc, disc_turn] =
                if bounce == 0 { draws } else { std::array::from_fn(|_| random.unit()) };
            let sun = around(self.to_sun, 1.0 - disc * (1.0 - SUN_RADIUS.cos()), disc_turn);
            if meets(at, sun).is_none() {
                sum += weight * DVec3::from(reflector.from_light(sun.to_array(), self.sun.to_array()));
            }
            let squared = f64::from(self.material.roughness).powi(4);
            let next = if lobe < 0.5 {
                let half_way = around(normal, ((1.0 - u) / (1.0 + (squared - 1.0) * u)).sqrt(), turn);
                half_way * (-2.0 * ray.dot(half_way)) + ray
            } else {
                around(normal, u.sqrt(), turn)
            };
            let cosine = normal.dot(next);
            if cosine <= 0.0 {
                return sum;
            }
            let half_way = (next - ray).normalize();
            let upright = normal.dot(half_way).clamp(0.0, 1.0);
            let spread = 1.0 + (squared - 1.0) * upright * upright;
            let facets = squared / (std::f64::consts::PI * spread * spread) * upright;
            let lobe = facets / (4.0 * half_way.dot(-ray).abs().max(1e-9));
            let density = 0.5 * (lobe + cosine / std::f64::consts::PI);
            let brdf = DVec3::from(reflector.brdf_pi(next.to_array())) / std::f64::consts::PI;
            weight *= brdf * (cosine / density);
            (from, ray) = (at, next);
        }
        sum
    }
}

/// Relative to the mean radiance: the RMS difference between picture and paths, without the paths' noise, and the RMS
/// noise.
fn rms(h: &mut Headless, material: Material, environment: Environment) -> [f64; 2] {
    let ball = asset(h, &sphere(96), material.clone());
    let drawables = [Drawable { asset: &ball, instances: &[Placement::default()] }];
    let camera = Pose::look_at(DVec3::new(0.0, 0.3, 3.0), DVec3::ZERO, DVec3::Y, 0.36);
    let settings =
        Settings { occlusion: None, shadows: None, anti_aliasing: AntiAliasing::None, ..Settings::default() };
    h.frame(&Frame { environment, settings, ..Frame::new(camera, &drawables) }).unwrap();
    let stored: Vec<f16> = bytemuck::pod_collect_to_vec(&h.intermediate(Resource::Radiance, 8).unwrap());

    let mut sky = SkyGpu::new(h.gpu());
    let light = sky.light(h.gpu(), &environment, None);
    let map = sky.map().unwrap();
    let traced = Traced {
        material,
        sky: &map.seen,
        axes: [light.side, light.up.cross(light.side), light.up],
        to_sun: light.to_sun,
        sun: map.sun,
    };
    let tan: [f64; 2] = camera.tan_half_fov(SIDE, SIDE).into();
    let mut random = Random::new(7);
    let (mut squares, mut noise, mut sum, mut count) = (0.0_f64, 0.0_f64, 0.0, 0.0);
    for (i, got) in stored.chunks(4).enumerate() {
        let pixel = [(i as u32 % SIDE).into(), (i as u32 / SIDE).into()];
        let ray = (camera.rotation * DVec3::from(view_ray(pixel, [SIDE, SIDE], tan))).normalize();
        // At the ball's edge pixels show facets.
        if meets(camera.eye, ray).is_none_or(|at| -ray.dot(at) < 0.15 * RADIUS) {
            continue;
        }
        // Evenly spread numbers (R2, Roberts 2018), from another start for each estimate.
        let mut mean = || {
            let first: [f64; 4] = std::array::from_fn(|_| random.unit());
            let path = |i: u32| {
                let spread = |k: usize, number: u32| {
                    let step = [0.754_877_666_246_692_7, 0.569_840_290_998_053_2][k % 2];
                    (first[k] + f64::from(number) * step).fract()
                };
                let draws =
                    [spread(0, i / 2), spread(1, i / 2), f64::from(i % 2), spread(2, i), spread(3, i)];
                traced.path(camera.eye, ray, draws, &mut random)
            };
            (0..PATHS).map(path).sum::<DVec3>() / f64::from(PATHS)
        };
        let [one, other] = [mean(), mean()];
        let want = 0.5 * (one + other);
        let got = DVec3::new(got[0].to_f64(), got[1].to_f64(), got[2].to_f64());
        squares += (got - want).length_squared();
        noise += 0.25 * (one - other).length_squared();
        sum += want.element_sum();
        count += 3.0;
    }
    assert!(count > 900.0, "too few pixels: {count}");
    [(squares - noise).max(0.0), noise].map(|squares| (squares / count).sqrt() / (sum / count))
}

#[test]
fn spheres_match_path_tracing() {
    let Some(mut h) = headless(SIDE, SIDE) else { return };
    // The reference has no chromatic adaptation.
    let sky = Sky::Atmosphere(Atmosphere { adaptation: 0.0, ..Atmosphere::default() });
    println!("| metal | roughness | RMS, sun 47° high | 8° high | noise of the paths |");
    let mut worse = Vec::new();
    // By metalness: roughness, and the limits for the high sun and for the low one, whose glow is narrow.
    let bounds = [
        (
            0.0,
            [
                (0.1, [0.04, 0.05]),
                (0.3, [0.03, 0.04]),
                (0.5, [0.02, 0.03]),
                (0.7, [0.02; 2]),
                (1.0, [0.02; 2]),
            ],
        ),
        (
            0.5,
            [
                (0.1, [0.06, 0.15]),
                (0.3, [0.03, 0.05]),
                (0.5, [0.02, 0.06]),
                (0.7, [0.03, 0.07]),
                (1.0, [0.07, 0.11]),
            ],
        ),
        (
            1.0,
            [
                (0.1, [0.15, 0.4]),
                (0.3, [0.04, 0.09]),
                (0.5, [0.03, 0.11]),
                (0.7, [0.05, 0.16]),
                (1.0, [0.07, 0.24]),
            ],
        ),
    ];
    for (metallic, of_roughness) in bounds {
        for (roughness, most) in of_roughness {
            let material =
                Material { base_color: [0.8, 0.5, 0.2, 1.0], metallic, roughness, ..Material::default() };
            let of = [DVec3::new(0.55, 0.75, 0.45), DVec3::new(0.8, 0.14, 0.6)].map(|to_sun| {
                let environment = Environment { to_sun, sky, ..Environment::default() };
                rms(&mut h, material.clone(), environment)
            });
            keep(&h, &format!("sphere-{metallic}-{roughness}"));
            let [[high, high_noise], [low, low_noise]] = of;
            println!("| {metallic} | {roughness} | {high:.4} | {low:.4} | {high_noise:.4}, {low_noise:.4} |");
            if of.iter().zip(most).any(|([off, noise], most)| *off >= most || *noise >= 0.02) {
                worse.push((metallic, roughness, of));
            }
        }
    }
    assert!(worse.is_empty(), "{worse:?}");
}
