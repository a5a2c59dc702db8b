//! A scene with all effects at extreme scales, places, depths, fields of view, picture sizes and numbers of punctual
//! lights. `docs/extremes.md` has the table.

use glam::DVec3;
use half::f16;
use image::RgbaImage;

use super::shapes::{Mesh, asset, at, brick_asset, quad, sphere};
use super::{headless, keep};
use crate::cpu_reference::depth::view_ray;
use crate::frame::graph::Resource;
use crate::image_compare::{Comparison, compare};
use crate::{
    Alpha, AntiAliasing, AssetGpu, Drawable, Environment, Frame, Haze, Headless, Material, PassId, Placement,
    Pose, PunctualLight, Settings, Spot, Water,
};

const SIZE: (u32, u32) = (97, 65);
/// Both methods of smoothing edges; each picture uses one.
const SMOOTHED: [AntiAliasing; 2] = [AntiAliasing::Spatial, AntiAliasing::Temporal];
/// Radius of the Earth.
const FAR_M: f64 = 6.371e6;

/// A sloping shore with a brick wall, a ball, a glowing ball and a pane of glass.
struct Scene {
    floor: AssetGpu,
    wall: AssetGpu,
    ball: AssetGpu,
    glow: AssetGpu,
    pane: AssetGpu,
    /// World units per unit of the meshes, in a scene of unit size.
    unit: f64,
}

/// A view of the scene.
#[derive(Clone, Copy)]
struct View {
    /// World units per unit of the scene.
    scale: f64,
    /// The scene's centre.
    offset: DVec3,
    /// Vertical field of view, in radians.
    fov: f64,
    /// Distance of the eye, in units of the scene.
    away: f64,
    /// Number of punctual lights in each place.
    punctual_lights: usize,
    water: bool,
    anti_aliasing: AntiAliasing,
    render_scale: f32,
}

const VIEW: View = View {
    scale: 1.0,
    offset: DVec3::ZERO,
    fov: 0.8,
    away: 3.4,
    punctual_lights: 1,
    water: true,
    anti_aliasing: AntiAliasing::Spatial,
    render_scale: 1.0,
};

impl Scene {
    /// With meshes enlarged by `size`.
    fn new(h: &Headless, size: f32) -> Self {
        let sized = |(mut vertices, faces): Mesh| {
            for vertex in &mut vertices {
                vertex.position = vertex.position.map(|x| x * size);
                vertex.morph_from = vertex.morph_from.map(|x| x * size);
            }
            (vertices, faces)
        };
        let floor = quad([-6.0, -0.6, 3.0], [12.0, 0.5, 0.0], [0.0, 0.2, -9.0], 1.0);
        let wall = quad([0.4, -0.6, -1.4], [2.0, 0.0, 0.0], [0.0, 1.6, 0.0], 1.0);
        let pane = quad([-1.8, -0.6, 1.0], [1.1, 0.0, 0.0], [0.0, 1.4, 0.0], 1.0);
        let glass = Material { base_color: [0.7, 0.9, 0.8, 0.4], alpha: Alpha::Blend, ..Material::default() };
        let gold = Material {
            base_color: [0.9, 0.6, 0.2, 1.0],
            metallic: 1.0,
            roughness: 0.4,
            ..Material::default()
        };
        let punctual_light =
            Material { base_color: [0.1, 0.1, 0.1, 1.0], emission: [1.4, 0.4, 0.0], ..Material::default() };
        Self {
            floor: asset(
                h,
                &sized(floor),
                Material { base_color: [0.4, 0.4, 0.4, 1.0], ..Material::default() },
            ),
            wall: brick_asset(h, &sized(wall), 0.03),
            ball: asset(h, &sized(sphere(24)), gold),
            glow: asset(h, &sized(sphere(16)), punctual_light),
            pane: asset(h, &sized(pane), glass),
            unit: 1.0 / f64::from(size),
        }
    }

    /// Draws frames in which the camera and the ball move slowly, and returns the last picture. The first frame starts
    /// without history, so the result depends on the arguments only. Checks that all targets hold finite numbers.
    fn draw(&self, h: &mut Headless, view: View) -> RgbaImage {
        let View { scale, offset, fov, away, .. } = view;
        let place = |x, y, z, size: f64| Placement {
            scale: (size * scale * self.unit) as f32,
            ..Placement::at((offset + DVec3::new(x, y, z) * scale).into())
        };
        let punctual_light = |x, y, z, spot| PunctualLight {
            position: (offset + DVec3::new(x, y, z) * scale).into(),
            intensity: [1.2 * (scale * scale) as f32 / view.punctual_lights as f32; 3],
            range: 1.5 * scale as f32,
            spot,
        };
        let cone = Spot { direction: [0.0, -1.0, 0.0], inner: 0.3, outer: 0.7 };
        let punctual_lights =
            [punctual_light(1.4, 0.3, 0.6, None), punctual_light(-0.6, 0.7, -1.0, Some(cone))];
        let lights: Vec<_> = punctual_lights
            .iter()
            .flat_map(|punctual_light| std::iter::repeat_n(*punctual_light, view.punctual_lights))
            .collect();
        let environment =
            Environment { haze: Some(Haze { visibility: 12.0 * away * scale }), ..Environment::default() };
        let settings =
            Settings { near: 1e-3 * scale, render_scale: view.render_scale, ..Settings::default() };
        let here = [place(0.0, 0.0, 0.0, 1.0)];
        let glow = [place(-0.5, 0.5, -0.4, 0.3)];
        for step in (-1..6).map(f64::from) {
            let ball = [place(0.2 + 0.01 * step, 0.3, 0.0, 0.8)];
            let drawables = [
                Drawable { asset: &self.floor, instances: &here },
                Drawable { asset: &self.wall, instances: &here },
                Drawable { asset: &self.ball, instances: &ball },
                Drawable { asset: &self.glow, instances: &glow },
                Drawable { asset: &self.pane, instances: &here },
            ];
            let target = DVec3::new(0.0, 0.1, 0.0);
            let to_eye = DVec3::new(0.3 + 0.01 * step, 0.8, 3.4).normalize() * away;
            let [eye, target] = [target + to_eye, target].map(|at| offset + at * scale);
            let water = Water { level: offset.y - 0.45 * scale, clarity: 2.0 * scale, ripples: 0.2 * scale };
            let smoothed = if step < 0.0 { AntiAliasing::None } else { view.anti_aliasing };
            let frame = Frame {
                settings: Settings { anti_aliasing: smoothed, ..settings },
                lights: &lights,
                water: view.water.then_some(water),
                environment,
                ..Frame::new(Pose::look_at(eye, target, DVec3::Y, fov), &drawables)
            };
            let passes = h.frame(&frame).unwrap().passes;
            for pass in [
                PassId::Occlusion,
                PassId::Sunlight,
                PassId::PunctualLights,
                PassId::Emission,
                PassId::Transparency,
            ] {
                assert!(passes.contains(&pass), "{pass:?} is not drawn at scale {scale}, {offset}");
            }
            assert_eq!(passes.contains(&PassId::Water), view.water);
            numbers_only(h);
        }
        h.picture().unwrap()
    }
}

/// Checks that every target holds finite numbers only.
fn numbers_only(h: &Headless) {
    let depth = h.depth().unwrap();
    assert!(depth.iter().all(|x| x.is_finite() && (0.0..=1.0).contains(x)), "depth");
    let some =
        [(Resource::Normal, 8), (Resource::Radiance, 8), (Resource::History, 8), (Resource::Motion, 4)];
    for (resource, bytes) in some {
        let Some(stored) = h.intermediate(resource, bytes) else { continue };
        let values: Vec<f16> = bytemuck::pod_collect_to_vec(&stored);
        let strange = values.iter().position(|x| !x.is_finite());
        assert_eq!(strange, None, "{resource:?} holds {:?}", strange.map(|i| values[i]));
    }
}

/// Compares two pictures and prints the result.
fn apart(what: &str, got: &RgbaImage, want: &RgbaImage, mask: Option<&[bool]>) -> Comparison {
    let found = compare(got, want, mask).unwrap();
    println!("{what}: mean difference {:.3} of 255, SSIM {:.4}", found.mean_difference, found.ssim);
    found
}

#[test]
fn everything_at_a_thousandth_and_a_thousand_times_the_size_is_the_same_picture() {
    let Some(mut h) = headless(SIZE.0, SIZE.1) else { return };
    for anti_aliasing in SMOOTHED {
        let view = View { anti_aliasing, ..VIEW };
        let plain = Scene::new(&h, 1.0);
        let want = plain.draw(&mut h, view);
        keep(&h, &format!("everything-{}", anti_aliasing.name()));
        for scale in [1e-3, 1e3] {
            // Scaled by the instances, and by the meshes.
            for scene in [&plain, &Scene::new(&h, scale as f32)] {
                let got = scene.draw(&mut h, View { scale, ..view });
                let what =
                    format!("scale {scale:e} of meshes of {:e}, {}", 1.0 / scene.unit, anti_aliasing.name());
                let found = apart(&what, &got, &want, None);
                // Shadow maps move in steps, which fall elsewhere at other scales.
                assert!(found.mean_difference < 0.4 && found.ssim > 0.99, "{what}: {found:?}");
            }
        }
    }
}

#[test]
fn everything_a_planets_radius_away_is_the_same_picture() {
    let Some(mut h) = headless(SIZE.0, SIZE.1) else { return };
    let scene = Scene::new(&h, 1.0);
    for anti_aliasing in SMOOTHED {
        let here = View { anti_aliasing, ..VIEW };
        let want = scene.draw(&mut h, here);
        let dry = scene.draw(&mut h, View { water: false, ..here });
        // Ripples change phase sideways; straight above they stay the same.
        let land: Vec<_> = want.pixels().zip(dry.pixels()).map(|(a, b)| a == b).collect();
        let sea: Vec<_> = land.iter().map(|land| !land).collect();
        let small = scene.draw(&mut h, View { scale: 1e-3, ..here });
        for (scale, offset, mask) in [
            (1.0, DVec3::Y * FAR_M, None),
            (1.0, DVec3::new(FAR_M, 2.0, -FAR_M), Some(&land)),
            (1.0, DVec3::new(-FAR_M, FAR_M, 0.3), Some(&land)),
            (1e-3, DVec3::Y * FAR_M, None),
        ] {
            let got = scene.draw(&mut h, View { scale, offset, ..here });
            let what = format!("at {offset}, scale {scale:e}, {}", anti_aliasing.name());
            let want = if scale < 1.0 { &small } else { &want };
            let found = apart(&what, &got, want, mask.map(Vec::as_slice));
            assert!(found.mean_difference < 0.4 && found.ssim > 0.99, "{what}: {found:?}");
            if mask.is_some() {
                let mean = |image: &RgbaImage| {
                    let wet = image.pixels().zip(&sea).filter(|(_, sea)| **sea).map(|(pixel, _)| pixel);
                    let sum = wet.map(|p| [p[0], p[1], p[2]].map(f64::from).iter().sum::<f64>()).sum::<f64>();
                    sum / (3.0 * sea.iter().filter(|sea| **sea).count() as f64)
                };
                let [got, want] = [mean(&got), mean(want)];
                println!("{what}: water is {got:.2}, {want:.2} here");
                assert!((got - want).abs() < 2.0, "{what}: water is {got}, {want} here");
            }
        }
    }
}

/// Balls, glass bubbles before them and punctual lights, all scaled with their distance, at four depths.
fn at_depths(h: &mut Headless, depths: [f64; 4], anti_aliasing: AntiAliasing) -> (RgbaImage, Vec<f32>) {
    let ball = asset(h, &sphere(24), Material { base_color: [0.6, 0.4, 0.3, 1.0], ..Material::default() });
    let glass = Material { base_color: [0.7, 0.9, 1.0, 0.4], alpha: Alpha::Blend, ..Material::default() };
    let glass = asset(h, &sphere(24), glass);
    let corners = [[-1.0, 1.0], [1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]];
    let place = |i: usize, offset: [f64; 3]| {
        let [x, y] = corners[i];
        DVec3::new(0.24 * x + offset[0], 0.2 * y + offset[1], -1.0 + offset[2]) * depths[i]
    };
    let of = |size: f64, offset| {
        [0, 1, 2, 3]
            .map(|i| Placement { scale: (size * depths[i]) as f32, ..Placement::at(place(i, offset).into()) })
    };
    let (balls, bubbles) = (of(0.3, [0.0; 3]), of(0.12, [0.04, 0.05, 0.3]));
    let drawables =
        [Drawable { asset: &ball, instances: &balls }, Drawable { asset: &glass, instances: &bubbles }];
    let lights = [0, 1, 2, 3].map(|i| PunctualLight {
        position: place(i, [-0.12, 0.0, 0.3]).into(),
        intensity: [0.05, 0.03, 0.01].map(|colour| colour * (depths[i] * depths[i]) as f32),
        range: 0.5 * depths[i] as f32,
        spot: None,
    });
    let camera = Pose::look_at(DVec3::ZERO, DVec3::NEG_Z, DVec3::Y, 0.9);
    let environment = Environment { to_sun: DVec3::new(0.2, 0.4, 1.0), ..Environment::default() };
    // The nearest surface of each ball is at 0.64 of its depth.
    let settings = Settings { near: 1e-3, ..Settings::default() };
    for smoothed in [AntiAliasing::None, anti_aliasing, anti_aliasing, anti_aliasing] {
        let settings = Settings { anti_aliasing: smoothed, ..settings };
        let frame = Frame { lights: &lights, environment, settings, ..Frame::new(camera, &drawables) };
        let passes = h.frame(&frame).unwrap().passes;
        assert!(
            [PassId::Sunlight, PassId::PunctualLights, PassId::Transparency]
                .iter()
                .all(|p| passes.contains(p))
        );
        numbers_only(h);
    }
    (h.picture().unwrap(), h.depth().unwrap())
}

#[test]
fn a_millimetre_and_ten_thousand_kilometres_are_seen_in_one_picture() {
    let Some(mut h) = headless(SIZE.0, SIZE.1) else { return };
    let depths = [2e-3, 1.0, 1e3, 1e7];
    for anti_aliasing in SMOOTHED {
        let (want, plain) = at_depths(&mut h, [1.0; 4], anti_aliasing);
        keep(&h, "depths-alike");
        let (got, stored) = at_depths(&mut h, depths, anti_aliasing);
        keep(&h, "depths");
        let found = apart(&format!("depths {depths:?}, {}", anti_aliasing.name()), &got, &want, None);
        assert!(found.mean_difference < 1.0 && found.ssim > 0.99, "{found:?}");
        // Each ball's depth is its scale times that of the ball at scale 1.
        let (mut seen, mut worst) = ([0; 4], 0.0_f64);
        for (i, (stored, plain)) in stored.iter().zip(&plain).enumerate() {
            let (x, y) = (i as u32 % SIZE.0, i as u32 / SIZE.0);
            let corner = usize::from(x > SIZE.0 / 2) + 2 * usize::from(y > SIZE.1 / 2);
            if *stored > 0.0 && *plain > 0.0 {
                let ratio = f64::from(*plain) / f64::from(*stored) / depths[corner];
                worst = worst.max((ratio - 1.0).abs());
                seen[corner] += 1;
            }
        }
        println!("pixels of each {seen:?}, depth is off by {worst:.1e} at most");
        assert!(seen.iter().all(|seen| *seen > 150) && worst < 1e-4, "{seen:?} {worst}");
    }
}

#[test]
fn angles_of_view_from_a_tenth_of_a_degree_to_175() {
    let Some(mut h) = headless(SIZE.0, SIZE.1) else { return };
    let scene = Scene::new(&h, 1.0);
    for anti_aliasing in SMOOTHED {
        // So far away perspective vanishes: half the distance with twice the angle gives the same picture.
        let from = |degrees: f64| {
            let fov = degrees.to_radians();
            View { fov, away: 1.4 / (0.5 * fov).tan(), anti_aliasing, ..VIEW }
        };
        let want = scene.draw(&mut h, from(0.2));
        let got = scene.draw(&mut h, from(0.1));
        keep(&h, "fov-narrow");
        let found = apart(&format!("0.1° beside 0.2°, {}", anti_aliasing.name()), &got, &want, None);
        assert!(found.mean_difference < 0.4 && found.ssim > 0.99, "{found:?}");
        scene.draw(&mut h, View { fov: 175_f64.to_radians(), anti_aliasing, ..VIEW });
        keep(&h, "fov-wide");
    }
    // A wide-angle picture agrees with rays against a ball and a floor.
    let ball = asset(&h, &sphere(64), Material::default());
    let floor =
        asset(&h, &quad([-60.0, 0.0, 60.0], [120.0, 0.0, 0.0], [0.0, 0.0, -120.0], 1.0), Material::default());
    let drawables = [
        Drawable { asset: &ball, instances: &[at(0.0, 1.0, 0.0, 2.0)] },
        Drawable { asset: &floor, instances: &[Placement::default()] },
    ];
    let camera =
        Pose::look_at(DVec3::new(0.0, 1.2, 1.1), DVec3::new(0.0, 1.0, 0.0), DVec3::Y, 175_f64.to_radians());
    let near = 1e-3;
    let settings = Settings { near, ..Settings::default() };
    h.frame(&Frame { settings, ..Frame::new(camera, &drawables) }).unwrap();
    numbers_only(&h);
    let tan: [f64; 2] = camera.tan_half_fov(SIZE.0, SIZE.1).into();
    let (mut off, mut balls) = (0, 0);
    for (i, stored) in h.depth().unwrap().into_iter().enumerate() {
        let pixel = [(i as u32 % SIZE.0).into(), (i as u32 / SIZE.0).into()];
        let ray = camera.rotation * DVec3::from(view_ray(pixel, [SIZE.0, SIZE.1], tan));
        // The ball is 1 large, about (0, 1, 0).
        let middle = camera.eye - DVec3::Y;
        let (a, b, c) = (ray.length_squared(), ray.dot(middle), middle.length_squared() - 1.0);
        let root = (b * b - a * c).sqrt();
        let to_ball = if root.is_nan() || b > 0.0 { f64::INFINITY } else { (-b - root) / a };
        let to_floor = if ray.y < 0.0 { -camera.eye.y / ray.y } else { f64::INFINITY };
        let at = camera.eye + ray * to_floor;
        let to_floor = if at.x.abs().max(at.z.abs()) < 60.0 { to_floor } else { f64::INFINITY };
        let want = near / to_ball.min(to_floor);
        balls += usize::from(to_ball < to_floor);
        off += usize::from((f64::from(stored) - want).abs() > 2e-3 * want);
    }
    let all = (SIZE.0 * SIZE.1) as usize;
    println!("175°: {off} of {all} pixels show something else than their rays meet, {balls} the ball");
    assert!(off * 100 < all && balls > 4, "{off} {balls}");
}

#[test]
fn pictures_of_one_pixel_and_of_odd_sides_show_the_same_scene() {
    const FINER: u32 = 5;
    for (width, height) in [(1, 1), (1, 9), (3, 2), (33, 17), (127, 5)] {
        let Some(mut h) = headless(width, height) else { return };
        let Some(mut fine) = headless(FINER * width, FINER * height) else { return };
        let (scene, large) = (Scene::new(&h, 1.0), Scene::new(&fine, 1.0));
        let fine_view = View { anti_aliasing: AntiAliasing::None, ..VIEW };
        let truth = large.draw(&mut fine, fine_view);
        // The centres of the fine picture's pixel blocks, which is what a picture with one sample per pixel shows.
        let middle = FINER / 2;
        let truth = RgbaImage::from_fn(width, height, |x, y| {
            *truth.get_pixel(FINER * x + middle, FINER * y + middle)
        });
        for anti_aliasing in AntiAliasing::ALL {
            for render_scale in [1.0, 0.5, 0.0] {
                let got = scene.draw(&mut h, View { anti_aliasing, render_scale, ..VIEW });
                // Pictures drawn smaller, and small smoothed ones, are only checked for finite numbers.
                if render_scale < 1.0 || anti_aliasing != AntiAliasing::None && width.min(height) < 17 {
                    continue;
                }
                let what = format!("{width}×{height}, {}", anti_aliasing.name());
                let found = apart(&what, &got, &truth, None);
                // Occlusion uses other pixels, and smoothed edges use more than one.
                let most = if anti_aliasing == AntiAliasing::None { 12.0 } else { 20.0 };
                assert!(found.mean_difference < most, "{what}: {found:?}");
            }
        }
    }
}

#[test]
fn ten_thousand_punctual_lights_in_one_tile_are_one_of_their_strength_with_everything_else_there() {
    let Some(mut h) = headless(33, 17) else { return };
    let scene = Scene::new(&h, 1.0);
    for anti_aliasing in SMOOTHED {
        let one = scene.draw(&mut h, View { anti_aliasing, ..VIEW });
        for scale in [1.0, 1e-3, 1e3] {
            let many = scene.draw(&mut h, View { anti_aliasing, scale, punctual_lights: 5_000, ..VIEW });
            let what = format!("2 × 5,000 punctual lights, scale {scale:e}, {}", anti_aliasing.name());
            let found = apart(&what, &many, &one, None);
            assert!(found.mean_difference < 0.4, "{what}: {found:?}");
        }
    }
}
