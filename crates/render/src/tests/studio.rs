//! A studio: its light on a box, its background, and the shadows on its ground.

use glam::{DVec2, DVec3};
use half::f16;

use super::shapes::{asset, at, cube, sphere};
use super::{headless, keep};
use crate::cpu_reference::depth::view_ray;
use crate::cpu_reference::floor::{DepthMap, Floor};
use crate::frame::graph::Resource;
use crate::passes::sky::studio_background;
use crate::resources::readback::read_texture;
use crate::{
    AntiAliasing, Drawable, Environment, Frame, Headless, Material, PassId, Placement, Pose, Settings, Sky,
    Studio,
};

const SIZE: (u32, u32) = (320, 180);
/// From the upper left of [`camera`].
const KEY: DVec3 = DVec3::new(-0.45, 0.85, 0.634);

fn camera() -> Pose {
    Pose::look_at(DVec3::new(1.5, 1.4, 1.9), DVec3::new(0.2, 0.4, -0.1), DVec3::Y, 0.9)
}

fn settings() -> Settings {
    // As scenes in a studio are exposed.
    Settings { exposure: 0.776, anti_aliasing: AntiAliasing::None, dither: false, ..Settings::default() }
}

fn studio(ground: bool) -> Environment {
    let sky = Sky::Studio(Studio { ground, ..Studio::default() });
    Environment { to_sun: KEY, sky, ..Environment::default() }
}

/// Draws a white box on the ground at height 0 and a ball above it, or what `placements` says, and reads the radiance.
fn radiance(
    h: &mut Headless,
    camera: Pose,
    environment: Environment,
    placements: &[Placement; 2],
) -> Vec<DVec3> {
    let white = Material { base_color: [0.85, 0.85, 0.85, 1.0], roughness: 0.9, ..Material::default() };
    let mut shapes = [cube(), sphere(24)].map(|mesh| asset(h, &mesh, white.clone()));
    shapes[0].set_bounds(DVec3::ZERO, 0.87);
    shapes[1].set_bounds(DVec3::ZERO, 0.5);
    let drawables: Vec<_> = shapes
        .iter()
        .zip(placements)
        .map(|(asset, place)| Drawable { asset, instances: std::slice::from_ref(place) })
        .collect();
    let frame = Frame { environment, settings: settings(), ..Frame::new(camera, &drawables) };
    h.frame(&frame).unwrap();
    let texture = h.renderer().intermediate(Resource::Radiance).unwrap();
    let texels: Vec<[f16; 4]> = bytemuck::pod_collect_to_vec(&read_texture(h.gpu(), texture, 8).unwrap());
    texels.iter().map(|texel| DVec3::new(texel[0].into(), texel[1].into(), texel[2].into())).collect()
}

/// A box, and a ball beside and above it.
fn placements() -> [Placement; 2] {
    [at(0.0, 0.5, 0.0, 1.0), at(1.2, 0.9, -0.6, 0.5)]
}

/// The pixel that shows a point.
fn pixel(camera: &Pose, point: DVec3) -> usize {
    let from_eye = camera.rotation.inverse() * (point - camera.eye);
    let (tx, ty) = camera.tan_half_fov(SIZE.0, SIZE.1);
    let ndc = DVec2::new(from_eye.x / tx, -from_eye.y / ty) / -from_eye.z;
    let at = (0.5 + 0.5 * ndc) * DVec2::new(f64::from(SIZE.0), f64::from(SIZE.1));
    at.y as usize * SIZE.0 as usize + at.x as usize
}

/// The ray through a pixel in the world, unit length.
fn ray(camera: &Pose, i: usize) -> DVec3 {
    let (tx, ty) = camera.tan_half_fov(SIZE.0, SIZE.1);
    let at = [(i % SIZE.0 as usize) as i64, (i / SIZE.0 as usize) as i64];
    (camera.rotation * DVec3::from(view_ray(at, [SIZE.0, SIZE.1], [tx, ty]))).normalize()
}

#[test]
fn three_sides_of_a_white_box_differ_and_none_is_black_or_clipped() {
    let Some(mut h) = headless(SIZE.0, SIZE.1) else { return };
    let camera = camera();
    radiance(&mut h, camera, studio(true), &placements());
    keep(&h, "studio");
    let picture = h.picture().unwrap();
    let shade = |x: f64, y: f64, z: f64| {
        let i = pixel(&camera, DVec3::new(x, y, z)) as u32;
        picture.get_pixel(i % SIZE.0, i / SIZE.0).0[1]
    };
    let [top, front, right] = [shade(0.1, 1.0, 0.0), shade(0.0, 0.6, 0.5), shade(0.5, 0.6, 0.1)];
    println!("top {top}, front {front}, right {right}");
    assert!(top > front + 12 && front > right + 40, "{top} {front} {right}");
    assert!(top < 250 && right > 60, "{top} {right}");
}

#[test]
fn the_background_is_its_gradient_and_stays_it_far_from_objects() {
    let Some(mut h) = headless(SIZE.0, SIZE.1) else { return };
    let camera = camera();
    let [with, without] = [true, false].map(|ground| radiance(&mut h, camera, studio(ground), &placements()));
    let (width, rows) = (SIZE.0 as usize, SIZE.1 as usize);
    for i in [0, width - 1, (rows - 1) * width, rows * width - 1] {
        let want = studio_background(ray(&camera, i).y);
        assert!((without[i].x - want).abs() < 4e-3, "{i}: {} {want}", without[i]);
        assert_eq!(without[i].x, without[i].y, "neutral");
        assert_eq!(with[i], without[i], "no shadow reaches the corners");
    }
}

#[test]
fn shadows_lie_on_the_ground_and_fade_out() {
    let Some(mut h) = headless(SIZE.0, SIZE.1) else { return };
    let camera = camera();
    let [with, without] = [true, false].map(|ground| radiance(&mut h, camera, studio(ground), &placements()));
    let share = |x: f64, z: f64| {
        let i = pixel(&camera, DVec3::new(x, 0.0, z));
        with[i].x / without[i].x
    };
    // Away from the light; at the foot of the box on its lit side; farther from it.
    let (shadow, foot, away) = (share(0.66, -0.1), share(-0.2, 0.53), share(0.1, 1.1));
    println!("shadow {shadow:.3}, foot {foot:.3}, away {away:.3}");
    assert!(shadow < 0.6 && foot < 0.85 && away > 0.97, "{shadow} {foot} {away}");
    assert!(with.iter().zip(&without).all(|(with, without)| with.cmple(*without).all()));
}

#[test]
fn from_below_the_ground_is_not_there() {
    let Some(mut h) = headless(SIZE.0, SIZE.1) else { return };
    let below = Pose::look_at(DVec3::new(1.5, -1.0, 1.9), DVec3::new(0.0, 0.5, 0.0), DVec3::Y, 0.9);
    let [with, without] = [true, false].map(|ground| radiance(&mut h, below, studio(ground), &placements()));
    assert_eq!(with, without);
}

#[test]
fn other_skies_have_no_ground_and_neither_has_a_studio_without_shadows() {
    let Some(mut h) = headless(SIZE.0, SIZE.1) else { return };
    let shape = asset(&h, &cube(), Material::default());
    let place = [Placement::default()];
    let drawables = [Drawable { asset: &shape, instances: &place }];
    let mut passes = |environment, settings| {
        let frame = Frame { environment, settings, ..Frame::new(camera(), &drawables) };
        h.frame(&frame).unwrap().passes.contains(&PassId::Floor)
    };
    assert!(!passes(Environment::default(), settings()));
    assert!(!passes(studio(false), settings()));
    assert!(!passes(studio(true), Settings { shadows: None, ..settings() }));
    assert!(!passes(studio(true), settings()), "an object without bounds has no lowest point");
    assert!(h.renderer().floor().is_none(), "nothing is held for it");
}

#[test]
fn the_ground_matches_its_cpu_reference_at_any_size_and_place() {
    let Some(mut h) = headless(SIZE.0, SIZE.1) else { return };
    for (scale, offset) in
        [(1.0, DVec3::ZERO), (1e-3, DVec3::new(0.5, -3.0, 0.2)), (2e3, DVec3::new(3e6, 2e5, -1e6))]
    {
        let placed = placements().map(|place| {
            let to = offset + DVec3::from(place.translation) * scale;
            at(to.x, to.y, to.z, f64::from(place.scale) * scale)
        });
        let eye = camera();
        let camera = Pose { eye: offset + eye.eye * scale, ..eye };
        let [without, with] = [false, true].map(|ground| radiance(&mut h, camera, studio(ground), &placed));
        let pass = h.renderer().floor().unwrap();
        let (maps, picture, block) = pass.drawn().unwrap();
        let [undersides, key] = maps.map(|map| DepthMap {
            side: map.width() as usize,
            depths: bytemuck::pod_collect_to_vec(&read_texture(h.gpu(), map, 4).unwrap()),
        });
        let got = read_texture(h.gpu(), picture, 2).unwrap();
        let size = [picture.width() as usize, picture.height() as usize];
        let floor = Floor { block, undersides, key, size };
        let want = floor.picture();
        // Samples at the edges of texels fall to either side: single ones of 16 × 24 may differ.
        let off = got.chunks_exact(2).zip(&want).map(|(got, want)| {
            (DVec2::new(got[0].into(), got[1].into()) / 255.0 - *want).abs().max_element()
        });
        let off: Vec<f64> = off.collect();
        let (mean, worst) =
            (off.iter().sum::<f64>() / off.len() as f64, off.iter().copied().fold(0.0, f64::max));
        println!("scale {scale}: mean {mean:.5}, worst {worst:.4}");
        assert!(mean < 1e-3 && worst < 0.02, "{mean} {worst}");
        let (mut dark, mut far) = (0, 0.0f64);
        for (i, (with, without)) in with.iter().zip(&without).enumerate() {
            let share = with.x / without.x;
            if share == 1.0 {
                continue;
            }
            dark += 1;
            far = far.max((share - floor.factor(ray(&camera, i), &want)).abs());
        }
        println!("{dark} pixels darkened, worst {far:.4}");
        assert!(dark > 5000 && far < 0.01, "{dark} {far}");
    }
}

#[test]
fn the_pipelines_of_the_ground_are_compiled_ahead() {
    let Some(mut h) = headless(SIZE.0, SIZE.1) else { return };
    h.renderer().compiler(h.gpu(), &settings(), true).compile();
    let compiled = h.gpu().compiled_pipelines();
    radiance(&mut h, camera(), studio(true), &placements());
    assert_eq!(h.gpu().compiled_pipelines(), compiled);
}

#[test]
fn the_ground_is_drawn_anew_only_when_objects_change() {
    let Some(mut h) = headless(SIZE.0, SIZE.1) else { return };
    let mut shape = asset(&h, &cube(), Material::default());
    shape.set_bounds(DVec3::ZERO, 0.87);
    let mut draw = |camera: Pose, place: Placement| {
        let instances = [place];
        let drawables = [Drawable { asset: &shape, instances: &instances }];
        let frame =
            Frame { environment: studio(true), settings: settings(), ..Frame::new(camera, &drawables) };
        let counters = h.frame(&frame).unwrap();
        assert!(counters.passes.contains(&PassId::Floor));
        h.renderer().floor().unwrap().pictures_drawn
    };
    let moved = Pose { eye: DVec3::new(1.6, 1.5, 2.0), ..camera() };
    assert_eq!(draw(camera(), Placement::default()), 1);
    assert_eq!(draw(moved, Placement::default()), 1, "the camera alone moves");
    assert_eq!(draw(moved, at(0.3, 0.0, 0.0, 1.0)), 2);
}
