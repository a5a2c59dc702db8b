//! Reflections against their CPU reference, and bloom.

use glam::{DVec3, Vec3};
use half::f16;

use super::shapes::{asset, at, cube, opaque, quad, sphere};
use super::{headless, keep};
use crate::cpu_reference::bloom::Light as Picture;
use crate::cpu_reference::brdf::{DIELECTRIC, from_octahedral};
use crate::cpu_reference::reflections::{End, Mirror, Pyramid, Tracing, mirror_open, mirrors};
use crate::cpu_reference::sky::{environment_brdf, split_sum};
use crate::cpu_reference::surface::DepthPicture;
use crate::frame::graph::Resource;
use crate::image_compare::compare;
use crate::passes::reflections::PYRAMID_LEVELS;
use crate::{
    AntiAliasing, AssetGpu, Bloom, Drawable, Environment, Frame, GradientSky, Headless, Material, PassId,
    Placement, Pose, REFLECTION_THICKNESS, ReflectionMethod, Reflections, Settings, Sky, Water,
};

fn texels(h: &Headless, resource: Resource) -> Vec<[f64; 4]> {
    let stored: Vec<f16> = bytemuck::pod_collect_to_vec(&h.intermediate(resource, 8).unwrap());
    stored.chunks(4).map(|texel| [0, 1, 2, 3].map(|c| texel[c].to_f64())).collect()
}

fn bare() -> Settings {
    Settings { occlusion: None, shadows: None, anti_aliasing: AntiAliasing::None, ..Settings::default() }
}

fn even(sun: f32, all: Vec3) -> Environment {
    let plain = GradientSky { sun: Vec3::splat(sun), zenith: all, horizon: all, ground: all };
    Environment { sky: Sky::Plain(plain), ..Environment::default() }
}

/// A reflecting floor, a cube and spheres of several roughnesses on it, and a wall behind.
struct Stage {
    floor: AssetGpu,
    block: AssetGpu,
    balls: [AssetGpu; 2],
    wall: AssetGpu,
}

impl Stage {
    fn new(h: &Headless) -> Self {
        let mirror = |roughness, metallic| Material { roughness, metallic, ..Material::default() };
        let colour = |colour| Material { base_color: opaque(colour), roughness: 0.9, ..Material::default() };
        Self {
            floor: asset(
                h,
                &quad([-4.0, 0.0, 4.0], [8.0, 0.0, 0.0], [0.0, 0.0, -8.0], 1.0),
                mirror(0.1, 1.0),
            ),
            block: asset(h, &cube(), colour([0.8, 0.1, 0.1])),
            balls: [0.05, 0.35].map(|roughness| asset(h, &sphere(32), mirror(roughness, 1.0))),
            wall: asset(
                h,
                &quad([-4.0, 0.0, -3.0], [8.0, 0.0, 0.0], [0.0, 3.0, 0.0], 1.0),
                colour([0.1, 0.4, 0.8]),
            ),
        }
    }

    fn draw(&self, h: &mut Headless, environment: Environment, settings: Settings) -> Vec<PassId> {
        let (block, balls) =
            ([at(-0.9, 0.5, 0.0, 1.0)], [[at(0.5, 0.5, 0.3, 1.0)], [at(1.6, 0.4, -0.6, 0.8)]]);
        let drawables = [
            Drawable { asset: &self.floor, instances: &[Placement::default()] },
            Drawable { asset: &self.wall, instances: &[Placement::default()] },
            Drawable { asset: &self.block, instances: &block },
            Drawable { asset: &self.balls[0], instances: &balls[0] },
            Drawable { asset: &self.balls[1], instances: &balls[1] },
        ];
        let frame = Frame { environment, settings, ..Frame::new(camera(), &drawables) };
        h.frame(&frame).unwrap().passes
    }
}

fn camera() -> Pose {
    Pose::look_at(DVec3::new(0.3, 1.3, 4.0), DVec3::new(0.1, 0.4, 0.0), DVec3::Y, 0.8)
}

const METHODS: [(ReflectionMethod, u32); 4] = [
    (ReflectionMethod::Linear, 30),
    (ReflectionMethod::Linear, 1000),
    (ReflectionMethod::HiZ, 20),
    (ReflectionMethod::HiZ, 200),
];

#[test]
fn reflections_match_their_cpu_reference() {
    let (width, height) = (192, 108);
    let Some(mut h) = headless(width, height) else { return };
    let stage = Stage::new(&h);
    let sky = Vec3::new(0.5, 0.7, 1.1);
    assert!(!stage.draw(&mut h, even(0.8, sky), bare()).contains(&PassId::Reflections));
    let before = texels(&h, Resource::Radiance);
    let (normals, depth) = (texels(&h, Resource::Normal), h.depth().unwrap());
    let albedo = h.intermediate(Resource::Albedo, 4).unwrap();
    let tan = camera().tan_half_fov(width, height);
    let picture = DepthPicture {
        stored: &depth,
        size_px: [width, height],
        tan_half_fov: tan.into(),
        near: bare().near,
    };
    let mirror = Mirror { picture, pyramid: &Pyramid::new(&picture, PYRAMID_LEVELS) };
    let table = split_sum();
    for (method, steps) in METHODS {
        let settings = Settings { reflections: Some(Reflections { method, steps }), ..bare() };
        let passes = stage.draw(&mut h, even(0.8, sky), settings);
        assert!(passes.contains(&PassId::Reflections));
        assert_eq!(passes.contains(&PassId::DepthPyramid), method == ReflectionMethod::HiZ);
        keep(&h, &format!("reflections-{}-{steps}", method.name()));
        let got = texels(&h, Resource::Radiance);
        let by_cells = method == ReflectionMethod::HiZ;
        let tracing = Tracing { by_cells, steps, thickness: REFLECTION_THICKNESS.into() };
        let (mut met, mut off, mut silent) = (0, 0, 0);
        for i in 0..got.len() {
            let [nx, ny, roughness, open] = normals[i];
            let added = [0, 1, 2].map(|c| got[i][c] - before[i][c]);
            if depth[i] <= 0.0 || roughness >= 0.5 {
                assert_eq!(added, [0.0; 3]);
                continue;
            }
            let pixel = [(i % width as usize) as i64, (i / width as usize) as i64];
            let place = picture.position_at(pixel);
            let to_eye = -DVec3::from(place).normalize();
            let normal = camera().rotation.inverse() * DVec3::from(from_octahedral([nx, ny]));
            let direction = 2.0 * to_eye.dot(normal) * normal - to_eye;
            let traced = mirror.trace(&tracing, place, picture.normal_at(pixel, place), direction.into());
            let mut want = DVec3::ZERO;
            if let End::Met(at) = traced.end {
                let cosine = to_eye.dot(normal).clamp(1e-3, 1.0);
                let [scale, bias] = environment_brdf(&table, cosine, roughness);
                let linear = |c: usize| {
                    let encoded = f64::from(albedo[4 * i + c]) / 255.0;
                    if encoded <= 0.04045 { encoded / 12.92 } else { ((encoded + 0.055) / 1.055).powf(2.4) }
                };
                let metal = f64::from(albedo[4 * i + 3]) / 255.0;
                let share = mirror.share(at) * mirrors(roughness) * mirror_open(open, cosine, roughness);
                let seen = before[at[1] as usize * width as usize + at[0] as usize];
                want = DVec3::from([0, 1, 2].map(|c| {
                    let f0 = DIELECTRIC + (linear(c) - DIELECTRIC) * metal;
                    (f0 * scale + bias) * (seen[c] - f64::from(sky[c])) * share
                }));
                met += 1;
            } else {
                silent += 1;
            }
            // 11 bits of two pictures.
            off += u32::from((DVec3::from(added) - want).abs().max_element() > 0.01);
        }
        println!(
            "{} {steps}: {met} met, {silent} not, {off} otherwise than the CPU reference",
            method.name()
        );
        // Where a ray grazes an edge, f32 and f64 may differ.
        assert!(met > 1500 && off * 100 < met, "{}: {off} of {met}", method.name());
    }
}

#[test]
fn reflections_under_a_uniform_sky_change_nothing() {
    let Some(mut h) = headless(96, 64) else { return };
    let white = Material { roughness: 0.05, metallic: 1.0, base_color: [1.0; 4], ..Material::default() };
    let ball = asset(&h, &sphere(32), white);
    let instances = [at(-0.4, 0.0, 0.0, 0.9), at(0.45, 0.1, 0.2, 0.9)];
    let drawables = [Drawable { asset: &ball, instances: &instances }];
    let camera = Pose::look_at(DVec3::new(0.0, 0.0, 2.5), DVec3::ZERO, DVec3::Y, 0.7);
    let mut shoot = |reflections| {
        let settings = Settings { reflections, ..bare() };
        let frame = Frame { environment: even(0.0, Vec3::ONE), settings, ..Frame::new(camera, &drawables) };
        h.frame(&frame).unwrap();
        texels(&h, Resource::Radiance)
    };
    let without = shoot(None);
    for (method, steps) in METHODS {
        let with = shoot(Some(Reflections { method, steps }));
        let most = with.iter().zip(&without).flat_map(|(a, b)| [0, 1, 2].map(|c| (a[c] - b[c]).abs()));
        // A white mirror reflects all light except what the microfacet model loses.
        assert!(most.fold(0.0, f64::max) < 0.02);
    }
}

#[test]
fn reflections_are_the_same_at_all_scales_and_in_small_windows() {
    for (width, height) in [(96, 64), (1, 1), (3, 129), (67, 5)] {
        let Some(mut h) = headless(width, height) else { return };
        let mirror = Material { roughness: 0.05, metallic: 1.0, ..Material::default() };
        let floor = asset(&h, &quad([-4.0, 0.0, 4.0], [8.0, 0.0, 0.0], [0.0, 0.0, -8.0], 1.0), mirror);
        let block = asset(&h, &cube(), Material { base_color: [0.8, 0.1, 0.1, 1.0], ..Material::default() });
        let mut shoot = |scale: f64, fov: f64, method, water: bool| {
            let place = |x, y, z| at(x * scale, y * scale, z * scale, scale);
            let (floors, blocks) =
                ([place(0.0, if water { -9.0 } else { 0.0 }, 0.0)], [place(0.2, 0.5, 0.0)]);
            let drawables = [
                Drawable { asset: &floor, instances: &floors },
                Drawable { asset: &block, instances: &blocks },
            ];
            let eye = DVec3::new(0.3, 1.3, 4.0) * scale;
            let camera = Pose::look_at(eye, eye + DVec3::new(-0.1, -0.25, -1.0), DVec3::Y, fov);
            let water = water.then_some(Water { level: 0.0, clarity: 2.0 * scale, ripples: 0.5 * scale });
            let reflections = Some(Reflections { method, steps: 200 });
            let bloom = Some(Bloom { strength: 0.3 });
            let settings = Settings { near: 1e-4 * scale, reflections, bloom, ..bare() };
            let frame = Frame {
                settings,
                water,
                environment: even(0.8, Vec3::new(0.5, 0.7, 1.1)),
                ..Frame::new(camera, &drawables)
            };
            let passes = h.frame(&frame).unwrap().passes;
            assert!(passes.contains(&PassId::Reflections) && passes.contains(&PassId::Bloom));
            assert!(texels(&h, Resource::Radiance).iter().flatten().all(|x| x.is_finite()));
            h.picture().unwrap()
        };
        for method in ReflectionMethod::ALL {
            for water in [false, true] {
                let plain = shoot(1.0, 0.8, method, water);
                for scale in [1e-3, 1e3, 1e6] {
                    let found = compare(&shoot(scale, 0.8, method, water), &plain, None).unwrap();
                    assert!(found.mean_difference < 0.3, "{width}×{height} {scale}: {found:?}");
                }
                for degrees in [0.1_f64, 175.0] {
                    shoot(1.0, degrees.to_radians(), method, water);
                }
            }
        }
    }
}

#[test]
fn water_mirrors_what_stands_behind_it() {
    let (width, height) = (240, 160);
    let Some(mut h) = headless(width, height) else { return };
    let bed =
        asset(&h, &quad([-8.0, -1.5, 8.0], [16.0, 0.0, 0.0], [0.0, 0.0, -16.0], 1.0), Material::default());
    let block = asset(&h, &cube(), Material { base_color: [0.9, 0.1, 0.1, 1.0], ..Material::default() });
    let blocks = [at(0.0, 0.3, -1.0, 1.4)];
    let drawables = [
        Drawable { asset: &bed, instances: &[Placement::default()] },
        Drawable { asset: &block, instances: &blocks },
    ];
    let camera = Pose::look_at(DVec3::new(0.2, 0.6, 4.0), DVec3::new(0.0, 0.1, 0.0), DVec3::Y, 0.7);
    let mut shoot = |reflections| {
        let settings = Settings { reflections, ..bare() };
        let water = Some(Water { level: 0.0, clarity: 1.0, ripples: 0.05 });
        let frame = Frame {
            settings,
            water,
            environment: even(0.8, Vec3::new(0.5, 0.7, 1.1)),
            ..Frame::new(camera, &drawables)
        };
        h.frame(&frame).unwrap();
        if let Some(reflections) = reflections {
            keep(&h, &format!("reflections-water-{}", reflections.method.name()));
        }
        texels(&h, Resource::Radiance)
    };
    let plain = shoot(None);
    for method in ReflectionMethod::ALL {
        let mirrored = shoot(Some(Reflections { method, steps: 400 }));
        // Below the block, in the middle of the picture, water becomes redder and less blue.
        let redder = (90..120).flat_map(|y| (110..130).map(move |x| y * width as usize + x));
        let (all, count) = redder.fold((0, 0), |(all, count), i| {
            let less_blue = mirrored[i][2] < plain[i][2] - 0.02;
            (all + 1, count + u32::from(less_blue))
        });
        assert!(count * 2 > all, "{}: {count} of {all}", method.name());
        // At the sides there is nothing to reflect.
        let side = (130..150).flat_map(|y| (5..25).map(move |x| y * width as usize + x));
        assert!(side.into_iter().all(|i| mirrored[i] == plain[i]), "{}", method.name());
    }
}

#[test]
fn bloom_matches_its_cpu_reference() {
    for (width, height) in [(160, 90), (37, 23), (2, 2), (1, 1)] {
        let Some(mut h) = headless(width, height) else { return };
        let ball = asset(&h, &sphere(32), Material { roughness: 0.2, metallic: 1.0, ..Material::default() });
        let balls = [at(0.0, 0.0, 0.0, 1.0)];
        let drawables = [Drawable { asset: &ball, instances: &balls }];
        let camera = Pose::look_at(DVec3::new(0.0, 0.3, 2.0), DVec3::ZERO, DVec3::Y, 0.9);
        let mut shoot = |bloom| {
            let settings = Settings { bloom, ..bare() };
            let environment = even(3.0, Vec3::new(0.2, 0.3, 0.5));
            h.frame(&Frame { environment, settings, ..Frame::new(camera, &drawables) }).unwrap();
            keep(&h, if bloom.is_some() { "bloom" } else { "no-bloom" });
            texels(&h, Resource::Radiance)
        };
        let before = shoot(None);
        assert_eq!(before, shoot(Some(Bloom { strength: 0.0 })));
        let light = Picture {
            size_px: [width, height],
            texels: before.iter().map(|t| DVec3::new(t[0], t[1], t[2])).collect(),
        };
        for strength in [0.04_f32, 0.5] {
            let got = shoot(Some(Bloom { strength }));
            let want = light.bloomed(crate::passes::bloom::levels((width, height)), strength.into());
            for (i, (got, want)) in got.iter().zip(&want.texels).enumerate() {
                let got_rgb = DVec3::new(got[0], got[1], got[2]);
                let off = ((got_rgb - *want).abs() / want.max(DVec3::splat(0.05))).max_element();
                // 11 bits of each of the mixed pictures.
                assert!(off < 0.004, "{width}×{height} {strength} {i}: {got_rgb} {want}");
                assert_eq!(got[3], before[i][3]);
            }
        }
    }
}
