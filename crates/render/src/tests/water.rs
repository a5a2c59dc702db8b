//! Water against its CPU reference, its extent, and its independence of scale.

use glam::{DVec2, DVec3, Vec3};
use half::f16;
use image::RgbaImage;
use lodestream_terrain::{Mode, Shape, Stamp};

use super::shapes::{asset, at, quad, sphere};
use super::terrain::{entry, scene};
use super::{headless, keep};
use crate::cpu_reference::depth::view_ray;
use crate::cpu_reference::sky::{Octahedral, Sky as ReferenceSky, split_sum};
use crate::cpu_reference::water::Ray;
use crate::frame::graph::Resource;
use crate::image_compare::compare;
use crate::{
    AntiAliasing, Drawable, Environment, Frame, GradientSky, Haze, Headless, Material, PassId, Placement,
    Pose, Settings, Sky, TileSource, Water,
};

const WATER: Water = Water { level: 0.0, clarity: 4.0, ripples: 0.5 };

/// A uniform sky, and a sun.
fn even(sun: f32, all: Vec3) -> Environment {
    let plain = GradientSky { sun: Vec3::splat(sun), zenith: all, horizon: all, ground: all };
    Environment { sky: Sky::Plain(plain), ..Environment::default() }
}

fn bare() -> Settings {
    Settings { occlusion: None, shadows: None, anti_aliasing: AntiAliasing::None, ..Settings::default() }
}

fn radiance(h: &Headless) -> Vec<DVec3> {
    let stored: Vec<f16> = bytemuck::pod_collect_to_vec(&h.intermediate(Resource::Radiance, 8).unwrap());
    stored.chunks(4).map(|texel| DVec3::from([0, 1, 2].map(|c| texel[c].to_f64()))).collect()
}

#[test]
fn water_matches_its_cpu_reference() {
    let (width, height) = (160, 90);
    let Some(mut h) = headless(width, height) else { return };
    let bed =
        asset(&h, &quad([-8.0, -1.5, 8.0], [16.0, 0.4, 0.0], [0.0, 0.0, -16.0], 1.0), Material::default());
    let ball = asset(&h, &sphere(24), Material { base_color: [0.7, 0.3, 0.1, 1.0], ..Material::default() });
    let balls = [at(0.3, 0.1, -1.0, 0.8), at(-1.2, -0.7, 0.4, 0.5)];
    let drawables = [
        Drawable { asset: &bed, instances: &[Placement::default()] },
        Drawable { asset: &ball, instances: &balls },
    ];
    let camera = Pose::look_at(DVec3::new(0.4, 1.1, 3.2), DVec3::new(0.0, -0.2, 0.0), DVec3::Y, 0.9);
    let colour = Vec3::new(0.5, 0.7, 1.1);
    let table = split_sum();
    for (haze, sun) in [(None, 0.0), (None, 0.8), (Some(Haze { visibility: 30.0 }), 0.8)] {
        let environment = Environment { haze, ..even(sun, colour) };
        let mut frame = Frame { environment, settings: bare(), ..Frame::new(camera, &drawables) };
        assert!(!h.frame(&frame).unwrap().passes.contains(&PassId::Water));
        let (behind, depth) = (radiance(&h), h.depth().unwrap());
        frame.water = Some(WATER);
        assert!(h.frame(&frame).unwrap().passes.contains(&PassId::Water));
        keep(&h, "water");
        let got = radiance(&h);

        let map = Octahedral::new(4, |_| colour.as_dvec3());
        let mut irradiance = [DVec3::ZERO; 9];
        irradiance[0] = colour.as_dvec3();
        let sky = ReferenceSky {
            up: DVec3::Y,
            side: DVec3::X,
            to_sun: environment.to_sun.normalize(),
            disc: DVec3::ZERO,
            disc_radius: 1.0,
            seen: &map,
            layers: std::slice::from_ref(&map),
            irradiance,
            haze: haze.map_or(0.0, |haze| haze.extinction()),
        };
        let water = WATER.view_from(camera.eye).unwrap();
        let tan = camera.tan_half_fov(width, height);
        let turn = |v: [f64; 3]| camera.rotation * DVec3::from(v);
        let (mut wet, mut worst, mut sum) = (0, 0.0_f64, 0.0);
        for (i, got) in got.iter().enumerate() {
            let pixel = [(i % width as usize) as i64, (i / width as usize) as i64];
            let ray = Ray {
                through: turn(view_ray(pixel, [width, height], tan.into())),
                right: turn([2.0 * tan.0 / f64::from(width), 0.0, 0.0]),
                up: turn([0.0, 2.0 * tan.1 / f64::from(height), 0.0]),
            };
            let seen = match depth[i] {
                stored if stored > 0.0 => frame.settings.near / f64::from(stored),
                _ => f64::INFINITY,
            };
            let along = water.height / -ray.through.y;
            if (along / seen - 1.0).abs() < 1e-3 || ray.through.y.abs() < 1e-3 {
                // At a shore or the horizon a pixel may show either.
                continue;
            }
            if along < 0.0 || along > seen {
                assert_eq!(*got, behind[i], "{pixel:?} is dry");
                continue;
            }
            let want = water.radiance(ray, (behind[i], seen), &sky, DVec3::splat(sun.into()), &table);
            // 11 bits of the picture, twice.
            let off = ((*got - want).abs() / want.max(DVec3::splat(0.02))).max_element();
            assert!(off < 0.03, "{pixel:?}: {got} {want}");
            (wet, worst, sum) = (wet + 1, worst.max(off), sum + off);
        }
        println!("{wet} pixels: off by {:.5} in the mean, {worst:.4} at most", sum / f64::from(wet));
        assert!(wet > 5000 && sum / f64::from(wet) < 0.002);
    }
}

/// A valley with a river bed of constant depth, under water of the given level.
fn valley(h: &mut Headless, camera: Pose, level: Option<f64>) -> (RgbaImage, Vec<PassId>) {
    let mut entry = entry(3);
    entry.parameters.amplitude = 2_500;
    let line = vec![[-300, 40], [-120, 0], [0, 24], [90, -10], [300, 30]];
    let river = Shape::RiverBed { line, half_width: 24, depth: 900 };
    entry.stamps = vec![Stamp { mode: Mode::Fixed, shape: river }];
    let mut ground = scene(h, &entry);
    ground.prepare(h.gpu(), &TileSource::Immediate, &camera, h.size(), 2.0).unwrap();
    let water = level.map(|level| Water { level, clarity: 3.0, ripples: 2.0 });
    let settings = Settings { near: 0.1, anti_aliasing: AntiAliasing::None, ..Settings::default() };
    let frame = Frame { terrain: Some(ground.frame()), water, settings, ..Frame::new(camera, &[]) };
    let passes = h.frame(&frame).unwrap().passes;
    (h.picture().unwrap(), passes)
}

#[test]
fn rivers_have_water_where_their_beds_are_below_its_level() {
    let (width, height) = (320, 180);
    let Some(mut h) = headless(width, height) else { return };
    let camera = Pose::look_at(DVec3::new(60.0, 40.0, 130.0), DVec3::new(0.0, -8.0, 10.0), DVec3::Y, 0.9);
    let (dry, passes) = valley(&mut h, camera, None);
    assert!(!passes.contains(&PassId::Water));
    let depth = h.depth().unwrap();
    let (wet, passes) = valley(&mut h, camera, Some(-5.0));
    keep(&h, "river");
    assert!(passes.contains(&PassId::Water));
    let tan = camera.tan_half_fov(width, height);
    let (mut below, mut changed) = (0, 0);
    for (i, stored) in depth.iter().enumerate().filter(|(_, stored)| **stored > 0.0) {
        let pixel = [(i % width as usize) as i64, (i / width as usize) as i64];
        let ray = camera.rotation * DVec3::from(view_ray(pixel, [width, height], tan.into()));
        let ground = camera.eye.y + ray.y * 0.1 / f64::from(*stored);
        let [x, y] = pixel.map(|c| c as u32);
        if ground > -4.99 {
            assert_eq!(dry.get_pixel(x, y), wet.get_pixel(x, y), "{pixel:?} is dry at {ground}");
        } else if ground < -5.5 {
            (below, changed) = (below + 1, changed + u32::from(dry.get_pixel(x, y) != wet.get_pixel(x, y)));
        }
    }
    println!("{below} pixels are under water");
    assert!(below > 1500 && changed * 100 >= below * 99, "{changed} of {below}");
    // Water is not drawn from below, or where all ground is higher.
    let (all_below, passes) = valley(&mut h, camera, Some(41.0));
    assert!(!passes.contains(&PassId::Water) && all_below == dry);
    let mut off = Frame { water: Some(WATER), ..Frame::new(camera, &[]) };
    off.settings.water = false;
    assert!(!h.frame(&off).unwrap().passes.contains(&PassId::Water));
    let (deep, passes) = valley(&mut h, camera, Some(-1000.0));
    assert!(passes.contains(&PassId::Water));
    let hidden = dry
        .enumerate_pixels()
        .filter(|(x, y, dry)| depth[(y * width + x) as usize] > 0.0 && *dry != deep.get_pixel(*x, *y));
    assert_eq!(hidden.count(), 0);
}

#[test]
fn water_is_the_same_at_all_scales_and_never_less_than_a_number() {
    let Some(mut h) = headless(96, 64) else { return };
    let ball = asset(&h, &sphere(24), Material::default());
    let mut shoot = |scale: f64, height: f64| {
        let place = at(0.0, 0.0, 0.0, scale);
        let drawables = [Drawable { asset: &ball, instances: &[place] }];
        let eye = DVec3::new(0.0, height, 3.0) * scale;
        let camera = Pose::look_at(eye, eye + DVec3::new(0.0, -0.3, -1.0), DVec3::Y, 0.9);
        let water = Water { level: 0.0, clarity: 2.0 * scale, ripples: 0.5 * scale };
        let settings = Settings { near: 1e-4 * scale, ..bare() };
        let frame = Frame { settings, water: Some(water), ..Frame::new(camera, &drawables) };
        h.frame(&frame).unwrap();
        assert!(radiance(&h).iter().all(|x| x.is_finite()), "{scale} {height}");
        h.picture().unwrap()
    };
    let plain = shoot(1.0, 1.0);
    for scale in [1e-3, 1e3, 1e6] {
        let found = compare(&shoot(scale, 1.0), &plain, None).unwrap();
        assert!(found.mean_difference < 0.2, "{scale}: {found:?}");
    }
    // The picture does contain water.
    let dry = compare(&shoot(1.0, -1.0), &plain, None).unwrap();
    assert!(dry.mean_difference > 5.0, "{dry:?}");
    for height in [1e-30, 1e-6, 1e-3, 1e3, 1e6, 1e30, f64::MIN_POSITIVE] {
        shoot(1.0, height);
    }
}

#[test]
fn ripples_stay_where_they_are_far_from_zero() {
    let far = DVec3::new(6.371e6, 2.0, -6.371e6);
    for step in [DVec3::X * 0.01, DVec3::new(0.3, 0.1, -0.7), DVec3::Z * 400.0] {
        let [here, there] = [far, far + step].map(|eye| WATER.view_from(eye).unwrap());
        for (here, there) in here.waves.iter().zip(&there.waves) {
            let turned = there.phase - here.phase - here.vector.dot(DVec2::new(step.x, step.z));
            // In cycles: such a place is rounded to a nanometre, which is 1e-8 of the shortest wave.
            assert!((turned - turned.round()).abs() < 1e-6, "{step}: {turned}");
        }
    }
}
