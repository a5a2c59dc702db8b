//! Vertical exaggeration: heights are right, nothing is missing, and nothing is left of earlier heights.

use glam::DVec3;
use image::RgbaImage;
use lodestream_geometry::random::Random;
use lodestream_scene::terrain::TerrainEntry;

use super::terrain::{draw, entry, ground_height, prepare_casters, scene};
use super::{headless, keep};
use crate::cpu_reference::depth::view_ray;
use crate::image_compare::compare;
use crate::{
    AntiAliasing, Environment, Frame, Headless, Pose, Settings, TerrainRenderer, TileSource,
    VerticalExaggeration,
};

fn over_the_hills(entry: &TerrainEntry, factor: f64) -> Pose {
    let eye = DVec3::new(-100.0, ground_height(entry, -100.0, 400.0) * factor + 260.0, 400.0);
    Pose::look_at(eye, eye + DVec3::new(1.0, -0.5, 0.2), DVec3::Y, 0.9)
}

const TO_SUN: DVec3 = DVec3::new(0.5, 0.3, -0.6);

/// Prepares tiles for a picture in the sun, with shadow casters out of view.
fn prepare(h: &Headless, ground: &mut TerrainRenderer, camera: Pose) {
    ground.prepare(h.gpu(), &TileSource::Immediate, &camera, h.size(), 2.0).unwrap();
    prepare_casters(h, ground, &TileSource::Immediate, camera, TO_SUN);
}

fn in_the_sun(h: &mut Headless, ground: &mut TerrainRenderer, camera: Pose) -> RgbaImage {
    prepare(h, ground, camera);
    let environment = Environment { to_sun: TO_SUN, ..Environment::default() };
    h.frame(&Frame { terrain: Some(ground.frame()), environment, ..Frame::new(camera, &[]) }).unwrap();
    h.picture().unwrap()
}

#[test]
fn half_exaggerated_heights_are_half_way() {
    let size = (160, 90);
    let Some(mut h) = headless(size.0, size.1) else { return };
    let entry = entry(3);
    let mut ground = scene(&h, &entry);
    let risen = VerticalExaggeration::default().towards(4.0, 2.0, 10.0).unwrap();
    for (now_s, factor) in [(10.0, 1.0), (11.0, 2.5), (12.0, 4.0)] {
        assert_eq!(risen.at(now_s), factor);
        ground.set_vertical_exaggeration(risen.at(now_s));
        let camera = over_the_hills(&entry, factor);
        draw(&mut h, &mut ground, camera, 0.5, Settings::default());
        keep(&h, &format!("heights-{factor}"));
        let (depth, (tx, ty)) = (h.depth().unwrap(), camera.tan_half_fov(size.0, size.1));
        let (mut judged, mut off) = (0, 0);
        for y in 0..size.1 {
            for x in 0..size.0 {
                let stored = f64::from(depth[(y * size.0 + x) as usize]);
                let away = Settings::default().near / stored;
                if stored <= 0.0 || away > 2000.0 {
                    continue;
                }
                let ray = DVec3::from(view_ray([x.into(), y.into()], [size.0, size.1], [tx, ty]));
                let at = camera.eye + camera.rotation * ray * away;
                let height = f64::from(entry.height_unit) * ground_between(&entry, at.x, at.z) * factor;
                judged += 1;
                // The allowed error is a pixel of the tile's own error and a pixel of the picture.
                off += usize::from((height - at.y).abs() > 1.5 * away * 2.0 * ty / f64::from(size.1));
            }
        }
        println!("× {factor}: {off} of {judged} pixels are elsewhere");
        assert!(judged > 4000 && off * 200 < judged, "× {factor}: {off} of {judged}");
    }
}

fn ground_between(entry: &TerrainEntry, x: f64, z: f64) -> f64 {
    use std::sync::OnceLock;
    static TERRAIN: OnceLock<lodestream_terrain::Terrain> = OnceLock::new();
    let terrain = TERRAIN.get_or_init(|| {
        lodestream_terrain::Terrain::with_stamps(entry.parameters, entry.stamps.clone()).unwrap()
    });
    let unit = f64::from(entry.unit);
    terrain.height_between(x / unit, z / unit, &mut lodestream_terrain::Scratch::new())
}

#[test]
fn the_end_of_an_animation_equals_terrain_of_that_height() {
    let Some(mut h) = headless(160, 90) else { return };
    let entry = entry(3);
    let mut ground = scene(&h, &entry);
    let risen = VerticalExaggeration::default().towards(2.0, 1.0, 0.0).unwrap();
    let camera = over_the_hills(&entry, 2.0);
    let before = in_the_sun(&mut h, &mut ground, camera);
    let on_the_way = |step: u32| risen.at(0.25 * f64::from(step));
    for step in 0..=4 {
        ground.set_vertical_exaggeration(on_the_way(step));
        in_the_sun(&mut h, &mut ground, camera);
    }
    let end = in_the_sun(&mut h, &mut ground, camera);
    keep(&h, "heights-end");
    assert!(end != before);
    // A renderer that drew no frames in between, with its tiles in the same places of the device's texture.
    let Some(mut fresh) = headless(160, 90) else { return };
    let mut alike = scene(&fresh, &entry);
    prepare(&fresh, &mut alike, camera);
    for step in 0..=4 {
        alike.set_vertical_exaggeration(on_the_way(step));
        prepare(&fresh, &mut alike, camera);
    }
    assert!(in_the_sun(&mut fresh, &mut alike, camera) == end);
    // Terrain with the factor from the start, and terrain with twice the height unit: powers of two are exact.
    let mut from_start = scene(&fresh, &entry);
    from_start.set_vertical_exaggeration(2.0);
    let from_start = in_the_sun(&mut fresh, &mut from_start, camera);
    let zones = entry.zones.map(|zone| 2.0 * zone);
    let twice = TerrainEntry { height_unit: 2.0 * entry.height_unit, zones, ..entry.clone() };
    let mut twice = scene(&fresh, &twice);
    assert!(in_the_sun(&mut fresh, &mut twice, camera) == from_start);
    // Its tiles lie elsewhere in the texture, so lookups round differently: a few pixels of relief have another hit.
    let off = compare(&from_start, &end, None).unwrap();
    println!("{off:?}");
    assert!(off.mean_difference < 0.02 && off.min_ssim > 0.99, "{off:?}");
    // The factor 1 gives the first picture again.
    ground.set_vertical_exaggeration(1.0);
    assert!(in_the_sun(&mut h, &mut ground, camera) == before);
}

#[test]
fn no_tile_is_lost_however_high_the_ground_is() {
    let size = (160, 90);
    let Some(mut h) = headless(size.0, size.1) else { return };
    let mut random = Random::new(12);
    let entry = entry(5);
    let mut ground = scene(&h, &entry);
    for number in 0..24 {
        let factor = [10.0, 0.0, 100.0, 0.3][number % 4];
        ground.set_vertical_exaggeration(factor);
        let mut place = || (random.unit() - 0.5) * 4000.0;
        let (x, z) = (place(), place());
        let over = 1.5 + 300.0 * random.unit().powi(3);
        let eye = DVec3::new(x, ground_height(&entry, x, z) * factor + over, z);
        let (turn, pitch) = (random.unit() * std::f64::consts::TAU, -0.8 + 0.8 * random.unit());
        let camera = Pose::look_at(eye, eye + DVec3::new(turn.cos(), pitch, turn.sin()), DVec3::Y, 0.9);
        draw(&mut h, &mut ground, camera, 1.0 + 4.0 * random.unit(), Settings::default());
        if number < 4 {
            keep(&h, &format!("heights-times-{factor}"));
        }
        let (depth, (tx, ty)) = (h.depth().unwrap(), camera.tan_half_fov(size.0, size.1));
        // The world's edge is 14 km from its centre, and no ground lies deeper than 400 m times the factor.
        let steep = |ray: DVec3| ray.y / ray.x.hypot(ray.z) < -(eye.y + 400.0 * factor) / 12_000.0;
        let (mut below, mut gaps) = (0, 0);
        for y in 0..size.1 {
            for x in 0..size.0 {
                let ray = DVec3::from(view_ray([x.into(), y.into()], [size.0, size.1], [tx, ty]));
                if steep(camera.rotation * ray) {
                    below += 1;
                    gaps += usize::from(depth[(y * size.0 + x) as usize] <= 0.0);
                }
            }
        }
        assert_eq!(gaps, 0, "camera {number}, × {factor}: of {below}");
        assert!(factor > 1.0 || below > 500, "camera {number} sees hardly any ground: {below}");
        assert!(h.picture().unwrap().pixels().any(|p| p[0] > 0));
    }
}

#[test]
fn a_mean_over_frames_begins_anew_when_heights_change() {
    let Some(mut h) = headless(64, 64) else { return };
    let entry = entry(3);
    let mut ground = scene(&h, &entry);
    let camera = over_the_hills(&entry, 1.0);
    let settings = Settings { anti_aliasing: AntiAliasing::Temporal, ..Settings::default() };
    let mut frames = |ground: &mut TerrainRenderer| {
        ground.prepare(h.gpu(), &TileSource::Immediate, &camera, (64, 64), 2.0).unwrap();
        let frame = Frame { terrain: Some(ground.frame()), settings, ..Frame::new(camera, &[]) };
        h.frame(&frame).unwrap().still_frames
    };
    let before: Vec<u32> = (0..4).map(|_| frames(&mut ground)).collect();
    // So small a change that the same tiles are drawn.
    ground.set_vertical_exaggeration(1.0001);
    let moved = frames(&mut ground);
    ground.set_vertical_exaggeration(1.0001);
    let stands = frames(&mut ground);
    assert!(before[3] > before[1] && moved < before[3] && stands > moved, "{before:?} {moved} {stands}");
}

#[test]
fn invalid_factors_are_ignored_or_clamped() {
    let Some(h) = headless(8, 8) else { return };
    let mut ground = scene(&h, &entry(3));
    for (asked, got) in [(f64::NAN, 1.0), (-3.0, 1e-6), (0.0, 1e-6), (1e9, 100.0), (7.5, 7.5)] {
        ground.set_vertical_exaggeration(asked);
        assert_eq!(ground.vertical_exaggeration(), got);
    }
}

#[cfg(feature = "client")]
#[test]
fn anchored_objects_follow_the_terrain() {
    use crate::scene::terrain_anchored::TerrainAnchored;
    use crate::{Placement, PunctualLight};
    let Some(h) = headless(8, 8) else { return };
    let entry = entry(3);
    let mut ground = scene(&h, &entry);
    let height = |x: f64, z: f64| ground_between(&entry, x, z) * f64::from(entry.height_unit);
    let stands = |x: f64, z: f64, over: f64| DVec3::new(x, height(x, z) + over, z);
    let instance = |at: DVec3| Placement::at(at.into());
    let instances = vec![
        vec![instance(stands(10.5, -3.0, 0.0)), instance(stands(-400.0, 77.0, 2.0))],
        Vec::new(),
        vec![instance(stands(900.0, 900.0, -1.0))],
    ];
    let light =
        |at: DVec3| PunctualLight { position: at.into(), intensity: [1.0; 3], range: 5.0, spot: None };
    let lights = vec![light(stands(10.5, -3.0, 4.0))];
    let mut standing = TerrainAnchored::default();
    for factor in [3.0, 0.0, 1.5] {
        ground.set_vertical_exaggeration(factor);
        standing.follow(&mut ground, &instances, &lights);
        let near = |got: [f64; 3], x: f64, z: f64, over: f64| {
            let want = DVec3::new(x, height(x, z) * factor + over, z);
            assert!(want.distance(got.into()) < 1e-2, "× {factor}: {got:?} {want}");
        };
        near(standing.instances[0][0].translation, 10.5, -3.0, 0.0);
        near(standing.instances[0][1].translation, -400.0, 77.0, 2.0);
        near(standing.instances[2][0].translation, 900.0, 900.0, -1.0);
        near(standing.lights[0].position, 10.5, -3.0, 4.0);
        assert!(standing.instances[1].is_empty());
    }
}
