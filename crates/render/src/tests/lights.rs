//! Punctual lights against their CPU reference; culling by tiles and depths loses no light.

use glam::{DQuat, DVec3, Vec3};
use half::f16;

use super::shapes::{Mesh, asset, at, quad, sphere};
use super::{headless, keep};
use crate::cpu_reference;
use crate::cpu_reference::brdf::{Reflector, Specular, from_octahedral};
use crate::cpu_reference::depth::view_ray;
use crate::frame::graph::Resource;
use crate::{
    Alpha, AntiAliasing, DebugView, Drawable, Environment, Frame, GradientSky, Headless, LightCulling,
    Material, PassId, Placement, Pose, PunctualLight, Settings, Sky, Spot,
};

/// An environment without light.
fn night() -> Environment {
    let none = Vec3::ZERO;
    let plain = GradientSky { sun: none, zenith: none, horizon: none, ground: none };
    Environment { sky: Sky::Plain(plain), ..Environment::default() }
}

fn bare() -> Settings {
    Settings { occlusion: None, shadows: None, anti_aliasing: AntiAliasing::None, ..Settings::default() }
}

fn floor() -> Mesh {
    quad([-8.0, 0.0, 8.0], [16.0, 0.0, 0.0], [0.0, 0.0, -16.0], 1.0)
}

fn camera() -> Pose {
    Pose::look_at(DVec3::new(0.0, 3.0, 7.0), DVec3::ZERO, DVec3::Y, 0.9)
}

/// Numbers from 0 to 1, the same each time.
fn numbers() -> impl FnMut() -> f64 {
    let mut state = 0x9e37_79b9_7f4a_7c15_u64;
    move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1_u64 << 53) as f64
    }
}

/// Punctual lights of many colours over the floor, every third one a spot that shines down.
fn punctual_lights(count: usize, reach: f64) -> Vec<PunctualLight> {
    let mut next = numbers();
    (0..count)
        .map(|i| PunctualLight {
            position: [14.0 * next() - 7.0, 0.1 + next(), 14.0 * next() - 7.0],
            intensity: [next(), next(), next()].map(|colour| colour as f32 * 0.5),
            range: (reach * (0.5 + next())) as f32,
            spot: (i % 3 == 0).then(|| Spot {
                direction: DVec3::new(next() - 0.5, -1.0, next() - 0.5).as_vec3().to_array(),
                inner: 0.2,
                outer: 0.3 + next() as f32,
            }),
        })
        .collect()
}

fn halves(h: &Headless, resource: Resource) -> Vec<[f64; 4]> {
    let stored: Vec<f16> = bytemuck::pod_collect_to_vec(&h.intermediate(resource, 8).unwrap());
    stored.chunks(4).map(|texel| [0, 1, 2, 3].map(|c| texel[c].to_f64())).collect()
}

/// Draws a floor and a ball under punctual lights and gives the radiance.
fn draw(h: &mut Headless, lights: &[PunctualLight], settings: Settings) -> Vec<[f64; 4]> {
    let ground = asset(
        h,
        &floor(),
        Material { base_color: [0.7, 0.7, 0.7, 1.0], roughness: 0.5, ..Material::default() },
    );
    let ball = asset(
        h,
        &sphere(32),
        Material { base_color: [0.9, 0.6, 0.2, 1.0], metallic: 1.0, ..Material::default() },
    );
    let drawables = [
        Drawable { asset: &ground, instances: &[Placement::default()] },
        Drawable { asset: &ball, instances: &[at(0.5, 0.6, 2.0, 1.2)] },
    ];
    let frame = Frame { lights, environment: night(), settings, ..Frame::new(camera(), &drawables) };
    let counters = h.frame(&frame).unwrap();
    // Without light in view there is no pass.
    let some = lights.iter().any(|light| crate::scene::lights::lights(light, camera().eye));
    assert_eq!(counters.passes.contains(&PassId::PunctualLights), some);
    halves(h, Resource::Radiance)
}

/// A light relative to a lit surface, for the CPU reference.
fn reference(light: &PunctualLight, surface: DVec3) -> cpu_reference::lights::PunctualLight {
    cpu_reference::lights::PunctualLight {
        position: (DVec3::from(light.position) - surface).to_array(),
        range: light.range.into(),
        colour: light.intensity.map(|intensity| f64::from(intensity) / std::f64::consts::PI),
        spot: light.spot.map(|spot| (axis(&spot).to_array(), spot.inner.into(), spot.outer.into())),
    }
}

/// The unit vector in which a spot shines.
fn axis(spot: &Spot) -> DVec3 {
    Vec3::from(spot.direction).as_dvec3().normalize()
}

/// The light that each pixel of the last picture gets from all punctual lights, without culling, in f64, on the
/// surfaces that were drawn.
fn brute_force(h: &Headless, lights: &[PunctualLight]) -> Vec<[f64; 3]> {
    let (width, height) = h.size();
    let pose = camera();
    let tan: [f64; 2] = pose.tan_half_fov(width, height).into();
    let (normals, depths) = (halves(h, Resource::Normal), h.depth().unwrap());
    let albedo = h.intermediate(Resource::Albedo, 4).unwrap();
    let of_pixel = |(i, stored): (usize, &[f64; 4])| {
        let mut want = [0.0; 3];
        if depths[i] <= 0.0 {
            return want;
        }
        let pixel = [(i % width as usize) as i64, (i / width as usize) as i64];
        let ray = DVec3::from(view_ray(pixel, [width, height], tan));
        let position = pose.rotation * ray * (bare().near / f64::from(depths[i]));
        let metal = f64::from(albedo[4 * i + 3]) / 255.0;
        let reflector = Reflector {
            albedo: if metal > 0.5 { [0.9, 0.6, 0.2] } else { [0.7; 3] }.map(|c: f32| f64::from(c)),
            metal,
            roughness: stored[2],
            normal: from_octahedral([stored[0], stored[1]]),
            to_eye: (-position.normalize()).to_array(),
            specular: Specular::USUAL,
        };
        for light in lights {
            let punctual_light = reference(light, pose.eye + position);
            let (irradiance, to_punctual_light) = punctual_light.at_zero();
            if irradiance != [0.0; 3] {
                let more = reflector.from_light(to_punctual_light, irradiance);
                want = [0, 1, 2].map(|c| want[c] + more[c]);
            }
        }
        want
    };
    normals.iter().enumerate().map(of_pixel).collect()
}

/// Root of the sum of squared differences over the sum of squares, and the largest difference of a pixel relative to
/// its value plus a tenth of the mean.
fn off(got: &[[f64; 4]], want: &[[f64; 3]]) -> [f64; 2] {
    let mean = want.iter().flatten().sum::<f64>() / (3 * want.len()) as f64;
    let (mut squares, mut sum, mut worst) = (0.0, 0.0, 0.0_f64);
    for (got, want) in got.iter().zip(want) {
        for c in 0..3 {
            squares += (got[c] - want[c]).powi(2);
            sum += want[c].powi(2);
            worst = worst.max((got[c] - want[c]).abs() / (want[c] + 0.1 * mean));
        }
    }
    assert!(sum > 1.0, "it is dark: {sum}");
    [(squares / sum).sqrt(), worst]
}

#[test]
fn punctual_lights_match_their_cpu_reference() {
    let Some(mut h) = headless(64, 48) else { return };
    let lights = punctual_lights(24, 4.0);
    let got = draw(&mut h, &lights, bare());
    keep(&h, "punctual_lights");
    let [rms, _] = off(&got, &brute_force(&h, &lights));
    assert!(rms < 0.01, "{rms}");
}

/// Where punctual lights are in a frame: each goes round a circle of its own, and spots turn.
fn moved(punctual_lights: &[PunctualLight], frame: u32) -> Vec<PunctualLight> {
    let mut next = numbers();
    let moved = |light: &PunctualLight| {
        let turn = DQuat::from_rotation_y((0.2 + next()) * f64::from(frame));
        let away = DVec3::new(next(), 0.0, next());
        let spot =
            light.spot.map(|spot| Spot { direction: (turn * axis(&spot)).as_vec3().to_array(), ..spot });
        let position = (DVec3::from(light.position) + turn * away - away).to_array();
        PunctualLight { position, spot, ..*light }
    };
    punctual_lights.iter().map(moved).collect()
}

#[test]
fn punctual_lights_that_move_light_what_all_of_them_do_one_by_one() {
    let Some(mut h) = headless(96, 64) else { return };
    // Alternating, so that lists, masks and ranges of one frame cannot be used for the next.
    let many = [punctual_lights(4000, 0.6), punctual_lights(400, 1.0)];
    let mut last: Vec<Vec<[f64; 4]>> = Vec::new();
    for frame in 0..4 {
        for (number, punctual_lights) in many.iter().enumerate() {
            let lights = moved(punctual_lights, frame);
            let mut drawn: Option<Vec<[f64; 4]>> = None;
            for (tile_px, clusters) in
                [(8, true), (8, false), (16, true), (16, false), (32, true), (32, false)]
            {
                let culling = LightCulling { tile_px, clusters, ..LightCulling::default() };
                let got = draw(&mut h, &lights, Settings { lights: Some(culling), ..bare() });
                let first = drawn.get_or_insert_with(|| got.clone());
                assert_eq!(
                    &got,
                    first,
                    "frame {frame}, {} punctual lights, {tile_px} px, {clusters}",
                    lights.len()
                );
            }
            keep(&h, &format!("punctual_lights-{}-{frame}", lights.len()));
            let got = drawn.unwrap();
            let [rms, worst] = off(&got, &brute_force(&h, &lights));
            println!("frame {frame}, {} punctual lights: RMS {rms:.5}, worst {worst:.4}", lights.len());
            assert!(
                rms < 0.01 && worst < 0.05,
                "frame {frame}, {} punctual lights: {rms} {worst}",
                lights.len()
            );
            if frame > 0 {
                assert_ne!(last[number], got, "they stand");
                last[number] = got;
            } else {
                last.push(got);
            }
        }
    }
}

#[test]
fn tiles_and_clusters_of_any_size_lose_no_punctual_light() {
    let Some(mut h) = headless(96, 64) else { return };
    for (count, reach) in [(1, 3.0), (400, 1.0), (4000, 0.6), (33, 100.0)] {
        let lights = punctual_lights(count, reach);
        let mut first: Option<Vec<[f64; 4]>> = None;
        for (tile_px, clusters) in [(64, false), (32, true), (16, false), (16, true), (8, true), (5, true)] {
            let culling = LightCulling { tile_px, clusters, ..LightCulling::default() };
            let drawn = draw(&mut h, &lights, Settings { lights: Some(culling), ..bare() });
            // The same punctual lights in the same order give the same sums, bit for bit.
            let first = first.get_or_insert_with(|| drawn.clone());
            assert_eq!(&drawn, first, "{count} punctual lights, tiles of {tile_px} px, clusters: {clusters}");
        }
        let lit = first.unwrap().iter().any(|pixel| pixel[0] > 0.01);
        assert!(lit || count == 1, "{count} punctual lights light nothing");
    }
}

#[test]
fn beyond_the_limit_the_brightest_punctual_lights_are_kept() {
    let Some(mut h) = headless(48, 32) else { return };
    let at = |x: f64, z: f64, candela: f32, range: f32| PunctualLight {
        position: [x, 0.5, z],
        intensity: [candela; 3],
        range,
        spot: None,
    };
    // The eye is at (0, 3, 7): the third is as strong as the second and further away, the last weak and near.
    let [bright, near, far, weak] =
        [at(-1.0, 0.0, 8.0, 2.0), at(1.0, 2.0, 1.0, 2.0), at(2.0, -5.0, 1.0, 2.0), at(0.0, 4.0, 0.01, 2.0)];
    let mut with = |lights: &[PunctualLight], most| {
        let lights_by = LightCulling { most, ..LightCulling::default() };
        draw(&mut h, lights, Settings { lights: Some(lights_by), ..bare() })
    };
    let all = [weak, far, near, bright];
    let whole = with(&all, 4);
    assert_eq!(whole, with(&all, u32::MAX), "as many as there are is all of them");
    for (most, left) in [(3, &[far, near, bright][..]), (2, &[near, bright]), (1, &[bright])] {
        let drawn = with(&all, most);
        assert_eq!(drawn, with(left, u32::MAX), "{most}");
        assert_ne!(drawn, whole, "{most}");
    }
}

#[test]
fn ten_thousand_punctual_lights_in_one_tile_add_up() {
    let Some(mut h) = headless(16, 16) else { return };
    let one = PunctualLight { position: [0.0, 2.0, 0.0], intensity: [1e-3; 3], range: 30.0, spot: None };
    let alone = draw(&mut h, &[PunctualLight { intensity: [10.0; 3], ..one }], bare());
    let many = draw(&mut h, &vec![one; 10_000], bare());
    for (many, alone) in many.iter().zip(&alone) {
        assert!((many[0] - alone[0]).abs() <= 2e-3 * alone[0] + 1e-4, "{many:?} {alone:?}");
    }
}

#[test]
fn fewer_punctual_lights_are_looked_at_where_tiles_are_small_and_depths_tell() {
    let Some(mut h) = headless(128, 96) else { return };
    let lights = punctual_lights(400, 0.8);
    let mut heat = |tile_px, clusters| {
        let lights_by = LightCulling { tile_px, clusters, ..LightCulling::default() };
        let drawn = draw(
            &mut h,
            &lights,
            Settings { lights: Some(lights_by), debug_view: DebugView::PunctualLights, ..bare() },
        );
        keep(&h, &format!("punctual_lights-heat-{tile_px}-{clusters}"));
        // In this view the number of lights lowers blue and raises red.
        drawn.iter().map(|[r, _, b, _]| r - b).sum::<f64>()
    };
    let (coarse, fine, clustered) = (heat(64, false), heat(8, false), heat(8, true));
    assert!(coarse > fine && fine >= clustered, "{coarse} {fine} {clustered}");
}

#[test]
fn where_there_are_no_punctual_lights_their_view_is_black() {
    let Some(mut h) = headless(32, 24) else { return };
    let ball = asset(&h, &sphere(16), Material::default());
    let drawables = [Drawable { asset: &ball, instances: &[at(0.0, 0.0, 0.0, 4.0)] }];
    let settings = Settings { debug_view: DebugView::PunctualLights, ..Settings::default() };
    let counters = h.frame(&Frame { settings, ..Frame::new(camera(), &drawables) }).unwrap();
    assert_eq!(counters.passes, [PassId::GBuffer, PassId::Debug]);
    assert!(h.picture().unwrap().pixels().all(|pixel| pixel.0 == [0, 0, 0, 255]));
}

#[test]
fn strange_punctual_lights_light_nothing_and_break_nothing() {
    let Some(mut h) = headless(16, 16) else { return };
    let punctual_light =
        PunctualLight { position: [0.0, 1.0, 0.0], intensity: [1.0; 3], range: 3.0, spot: None };
    let spot = Spot { direction: [0.0, -1.0, 0.0], inner: 0.1, outer: 0.5 };
    for strange in [
        PunctualLight { position: [f64::NAN; 3], ..punctual_light },
        PunctualLight { range: 0.0, ..punctual_light },
        PunctualLight { range: f32::NAN, ..punctual_light },
        PunctualLight { intensity: [f32::NAN; 3], ..punctual_light },
        PunctualLight { intensity: [-1.0; 3], ..punctual_light },
        PunctualLight { spot: Some(Spot { direction: [0.0; 3], ..spot }), ..punctual_light },
    ] {
        assert!(draw(&mut h, &[strange], bare()).iter().flatten().all(|x| x.is_finite()));
    }
    for edge in [
        PunctualLight { position: camera().eye.into(), ..punctual_light },
        PunctualLight { range: 1e30, ..punctual_light },
        PunctualLight { intensity: [1e30; 3], ..punctual_light },
        PunctualLight { spot: Some(Spot { inner: 9.0, outer: -1.0, ..spot }), ..punctual_light },
    ] {
        assert!(draw(&mut h, &[edge], bare()).iter().flatten().all(|x| x.is_finite()), "{edge:?}");
    }
}

/// A pane of glass before a far wall that covers the left half of the picture; to the right there is sky behind it.
fn glass(h: &mut Headless, lights: &[PunctualLight], culling: LightCulling) -> Vec<[f64; 4]> {
    let pane = Material {
        base_color: [0.8, 0.6, 0.4, 0.75],
        roughness: 0.6,
        alpha: Alpha::Blend,
        ..Material::default()
    };
    let pane = asset(h, &quad([-8.0, -4.0, 0.0], [16.0, 0.0, 0.0], [0.0, 8.0, 0.0], 1.0), pane);
    let wall = quad([-200.0, -90.0, -90.0], [200.0, 0.0, 0.0], [0.0, 180.0, 0.0], 1.0);
    let wall = asset(h, &wall, Material { base_color: [0.5, 0.5, 0.5, 1.0], ..Material::default() });
    let one = [Placement::default()];
    let drawables = [&pane, &wall].map(|asset| Drawable { asset, instances: &one });
    let settings = Settings { lights: Some(culling), ..bare() };
    let frame = Frame { lights, environment: night(), settings, ..Frame::new(facing(), &drawables) };
    let counters = h.frame(&frame).unwrap();
    assert!(
        counters.passes.contains(&PassId::PunctualLights) && counters.passes.contains(&PassId::Transparency)
    );
    halves(h, Resource::Radiance)
}

fn facing() -> Pose {
    Pose::look_at(DVec3::new(0.0, 0.0, 6.0), DVec3::ZERO, DVec3::Y, 0.9)
}

/// Punctual lights close before the pane and far from the wall.
fn before_glass(count: usize) -> Vec<PunctualLight> {
    let mut next = numbers();
    let mut place = || DVec3::new(9.0 * next() - 4.5, 5.0 * next() - 2.5, 0.3 + next());
    let punctual_light =
        |position| PunctualLight { position, intensity: [1.0, 0.7, 0.4], range: 2.5, spot: None };
    (0..count).map(|_| punctual_light(place().into())).collect()
}

#[test]
fn transparent_surfaces_are_lit_as_their_cpu_reference() {
    let Some(mut h) = headless(64, 48) else { return };
    let lights = before_glass(16);
    let got = glass(&mut h, &lights, LightCulling::default());
    keep(&h, "punctual_lights-glass");
    let (width, height) = h.size();
    let tan: [f64; 2] = facing().tan_half_fov(width, height).into();
    let (mut squares, mut sums) = (0.0, [0.0; 2]);
    for (i, got) in got.iter().enumerate() {
        let pixel = [(i % width as usize) as i64, (i / width as usize) as i64];
        // The pane fills the picture, six units before the eye. Nothing behind it is lit.
        let position = DVec3::from(view_ray(pixel, [width, height], tan)) * 6.0;
        let reflector = Reflector {
            albedo: [0.8, 0.6, 0.4],
            metal: 0.0,
            roughness: 0.6,
            normal: [0.0, 0.0, 1.0],
            to_eye: (-position.normalize()).to_array(),
            specular: Specular::USUAL,
        };
        let mut want = [0.0; 3];
        for light in &lights {
            let punctual_light = reference(light, facing().eye + position);
            let (irradiance, to_punctual_light) = punctual_light.at_zero();
            let more = reflector.from_light(to_punctual_light, irradiance);
            want = [0, 1, 2].map(|c| want[c] + 0.75 * more[c]);
        }
        for c in 0..3 {
            squares += (got[c] - want[c]).powi(2);
            sums[usize::from(pixel[0] >= 32)] += want[c].powi(2);
        }
    }
    assert!(sums.iter().all(|sum| *sum > 1.0), "a half of it is dark: {sums:?}");
    let error = (squares / (sums[0] + sums[1])).sqrt();
    assert!(error < 0.01, "{error}");
}

#[test]
fn culling_loses_no_light_on_transparent_surfaces() {
    let Some(mut h) = headless(96, 64) else { return };
    for count in [1, 40, 600] {
        let lights = before_glass(count);
        let mut first: Option<Vec<[f64; 4]>> = None;
        for (tile_px, clusters) in [(64, true), (64, false), (16, true), (16, false), (8, false), (5, true)] {
            let drawn = glass(&mut h, &lights, LightCulling { tile_px, clusters, ..LightCulling::default() });
            let first = first.get_or_insert_with(|| drawn.clone());
            assert_eq!(&drawn, first, "{count} punctual lights, tiles of {tile_px} px, clusters: {clusters}");
        }
        assert!(first.unwrap().iter().any(|pixel| pixel[0] > 0.01), "{count} punctual lights light nothing");
    }
}

/// Median times with moving punctual lights, so that each frame has lists of its own.
#[test]
#[ignore = "takes times: cargo test -p lodestream-render --lib -- time_of_punctual_lights --ignored --nocapture"]
fn time_of_punctual_lights() {
    const FRAMES: u32 = 9;
    let Some(mut h) = headless(1280, 720) else { return };
    println!("all punctual lights move; the pass, ms, median of {FRAMES} frames (least / greatest)");
    println!("| punctual lights | tiles, px | by the tile's depths | by ranges of depth |");
    println!("|--:|--:|--:|--:|");
    for count in [40, 400, 4000, 10_000] {
        // The more lights there are, the smaller their range: from 400 on, about as many reach a pixel.
        let punctual_lights = punctual_lights(count, 30.0 / (count as f64).sqrt().max(20.0));
        for tile_px in [8, 16, 32] {
            let mut time = |clusters| {
                let lights_by = LightCulling { tile_px, clusters, ..LightCulling::default() };
                let settings = Settings { lights: Some(lights_by), ..bare() };
                let mut times: Vec<f64> = (0..FRAMES)
                    .map(|frame| {
                        h.time_passes(false);
                        h.time_passes(true);
                        draw(&mut h, &moved(&punctual_lights, frame), settings);
                        let timings = h.timings();
                        let pass =
                            timings.passes.iter().find(|time| time.pass == PassId::PunctualLights).unwrap();
                        pass.gpu.unwrap_or_default().as_secs_f64() * 1e3
                    })
                    .collect();
                times.sort_by(f64::total_cmp);
                let [least, median, greatest] = [0, times.len() / 2, times.len() - 1].map(|i| times[i]);
                format!("{median:.2} ({least:.2} / {greatest:.2})")
            };
            println!("| {count} | {tile_px} | {} | {} |", time(false), time(true));
        }
    }
}
