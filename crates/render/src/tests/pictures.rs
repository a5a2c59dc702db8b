//! Pictures: orientation, light, occlusion, instances, options, repeatability.

use glam::{DVec3, Quat};
use image::RgbaImage;

use super::shapes::{Mesh, asset, at, brick_asset, cube, opaque, quad, sphere};
use super::{headless, keep};
use crate::image_compare::compare;
use crate::{
    AntiAliasing, DebugView, Drawable, Frame, GradientSky, Headless, MIN_RENDER_SCALE, Material,
    PackedVertex, PassId, Placement, Pose, RenderError, Settings, Sky,
};

fn luma(image: &RgbaImage, x: u32, y: u32) -> f64 {
    let p = image.get_pixel(x, y);
    0.299 * f64::from(p[0]) + 0.587 * f64::from(p[1]) + 0.114 * f64::from(p[2])
}

fn front_camera() -> Pose {
    Pose::look_at(DVec3::new(0.0, 0.0, 3.0), DVec3::ZERO, DVec3::Y, 0.8)
}

/// Draws one frame and returns its picture.
fn picture(h: &mut Headless, frame: &Frame<'_>) -> RgbaImage {
    h.frame(frame).unwrap();
    h.picture().unwrap()
}

/// A still life: cube, two spheres and a floor, brick wall behind.
fn still_life<R>(h: &mut Headless, draw: impl FnOnce(&mut Headless, &[Drawable<'_>], Pose) -> R) -> R {
    let clay = Material { base_color: [0.55, 0.42, 0.33, 1.0], ..Material::default() };
    let glaze = Material { base_color: [0.12, 0.3, 0.42, 1.0], roughness: 0.35, ..Material::default() };
    let stone = Material { base_color: [0.42, 0.42, 0.4, 1.0], ..Material::default() };
    let box_ = asset(h, &cube(), clay);
    let ball = asset(h, &sphere(32), glaze);
    let floor = asset(h, &quad([-6.0, 0.0, 4.0], [12.0, 0.0, 0.0], [0.0, 0.0, -8.0], 1.0), stone);
    let wall = brick_asset(h, &quad([-3.0, 0.0, -1.0], [6.0, 0.0, 0.0], [0.0, 3.0, 0.0], 3.0), 0.03);
    let turned = Placement { rotation: Quat::from_rotation_y(0.5).into(), ..at(-0.8, 0.5, 0.2, 1.0) };
    let drawables = [
        Drawable { asset: &box_, instances: &[turned] },
        Drawable { asset: &ball, instances: &[at(0.5, 0.4, 0.3, 0.8), at(1.2, 0.2, 0.8, 0.4)] },
        Drawable { asset: &floor, instances: &[Placement::default()] },
        Drawable { asset: &wall, instances: &[Placement::default()] },
    ];
    let camera = Pose::look_at(DVec3::new(1.6, 1.5, 3.4), DVec3::new(0.1, 0.6, 0.0), DVec3::Y, 0.75);
    draw(h, &drawables, camera)
}

#[test]
fn still_life_for_looking_at() {
    let Some(mut h) = headless(320, 180) else { return };
    still_life(&mut h, |h, drawables, camera| {
        let frame = Frame::new(camera, drawables);
        let counters = h.frame(&frame).unwrap();
        keep(h, "still-life");
        let all = h.picture().unwrap();
        assert_eq!((counters.draws, counters.instances), (4, 5));
        assert_eq!(counters.triangles, 12 + 2 * (32 * 64 * 2) + 2 + 2);
        assert_eq!(
            counters.passes,
            [
                PassId::GBuffer,
                PassId::Occlusion,
                PassId::OcclusionBlur,
                PassId::ShadowMaps,
                PassId::Sunlight,
                PassId::Lighting,
                PassId::ToneMap,
                PassId::AntiAlias
            ]
        );

        let with = |change: fn(&mut Settings)| {
            let mut settings = Settings::default();
            change(&mut settings);
            Frame { settings, ..frame }
        };
        let stairs = picture(h, &with(|s| s.anti_aliasing = AntiAliasing::None));
        keep(h, "still-life-stairs");
        let plain = picture(h, &with(|s| s.occlusion = None));
        keep(h, "still-life-no-ao");
        let flat = picture(h, &with(|s| s.relief = false));
        keep(h, "still-life-no-relief");
        let wires = picture(h, &with(|s| s.wireframe = true));
        keep(h, "still-life-wireframe");
        // Each option changes something, but not the whole picture.
        for other in [&stairs, &plain, &flat, &wires] {
            let c = compare(&all, other, None).unwrap();
            assert!(c.max_difference > 8 && c.mean_difference < 20.0, "{c:?}");
        }
        // Occlusion only darkens; smoothed edges may choose other neighbours.
        let plain = picture(
            h,
            &with(|s| {
                s.occlusion = None;
                s.anti_aliasing = AntiAliasing::None;
            }),
        );
        let brighter = stairs.pixels().zip(plain.pixels()).filter(|(a, b)| (0..3).any(|c| a[c] > b[c] + 1));
        assert_eq!(brighter.count(), 0);
    });
}

#[test]
fn pictures_repeat_bit_for_bit() {
    let shoot = || {
        let mut h = headless(160, 90)?;
        Some(still_life(&mut h, |h, drawables, camera| {
            let first = picture(h, &Frame::new(camera, drawables));
            let second = picture(h, &Frame::new(camera, drawables));
            assert_eq!(first, second);
            first
        }))
    };
    assert_eq!(shoot(), shoot());
}

#[test]
fn up_is_up_right_is_right_and_near_hides_far() {
    let Some(mut h) = headless(120, 120) else { return };
    let colour = |c: [f32; 3]| Material { base_color: opaque(c), ..Material::default() };
    let red = asset(&h, &cube(), colour([0.9, 0.02, 0.02]));
    let green = asset(&h, &cube(), colour([0.02, 0.8, 0.02]));
    let blue = asset(&h, &cube(), colour([0.02, 0.02, 0.9]));
    let drawables = [
        Drawable { asset: &red, instances: &[at(0.0, 0.8, 0.0, 0.4)] },
        Drawable { asset: &green, instances: &[at(0.8, 0.0, 0.0, 0.4)] },
        Drawable { asset: &blue, instances: &[at(0.0, 0.0, 0.0, 0.4)] },
        // Behind the blue one, and larger.
        Drawable { asset: &red, instances: &[at(0.0, 0.0, -1.0, 0.5)] },
    ];
    let image = picture(&mut h, &Frame::new(front_camera(), &drawables));
    let strongest = |x, y| {
        let p = image.get_pixel(x, y);
        (0..3).max_by_key(|c| p[*c]).unwrap()
    };
    // The frame is 2·3·tan(0.4) = 2.54 units high at the objects: 47 px a unit.
    assert_eq!(strongest(60, 60 - 38), 0, "red cube above");
    assert_eq!(strongest(60 + 38, 60), 1, "green cube to the right");
    assert_eq!(strongest(60, 60), 2, "blue cube in the middle, in front of the red one");
    let covered = h.coverage().unwrap();
    assert!(covered[60 * 120 + 60] && !covered[119 * 120 + 119]);
    let depth = h.depth().unwrap();
    let nearest = f64::from(depth[60 * 120 + 60]);
    assert!((Settings::default().near / nearest - 2.8).abs() < 1e-4, "{nearest}");
}

#[test]
fn vertex_colours_multiply_the_materials_and_blend_in_linear_light() {
    let Some(mut h) = headless(128, 64) else { return };
    let mut square = quad([-2.0, -1.0, 0.0], [4.0, 0.0, 0.0], [0.0, 2.0, 0.0], 1.0);
    let white = Material { base_color: [0.5, 0.5, 0.5, 1.0], ..Material::default() };
    let mut shoot = |mesh: &Mesh, material| {
        let asset = asset(&h, mesh, material);
        let drawables = [Drawable { asset: &asset, instances: &[Placement::default()] }];
        let mut frame = Frame::new(front_camera(), &drawables);
        // In this light red is hardly stronger than green.
        frame.environment.sky = Sky::Plain(GradientSky::default());
        picture(&mut h, &frame)
    };
    let plain = shoot(&square, white.clone());
    let half = shoot(&square, Material { base_color: [0.25, 0.25, 0.25, 1.0], ..Material::default() });
    // Half the light is 188 of 255 in sRGB: as a vertex colour or in the material, it is the same.
    for v in &mut square.0 {
        *v = v.coloured([188, 188, 188, 255]);
    }
    let grey = shoot(&square, white.clone());
    for (a, b) in [(64, 32), (20, 10)].map(|(x, y)| (grey.get_pixel(x, y), half.get_pixel(x, y))) {
        assert!(a.0.iter().zip(&b.0).all(|(a, b)| a.abs_diff(*b) <= 2), "{a:?} {b:?}");
    }
    assert!(luma(&plain, 64, 32) > luma(&grey, 64, 32) + 10.0);
    // Red on the left, green on the right, and half the light of both in the middle.
    for v in &mut square.0 {
        let colour = if v.position[0] < 0.0 { [255, 0, 0, 255] } else { [0, 255, 0, 255] };
        *v = v.coloured(colour);
    }
    let blend = shoot(&square, white);
    keep(&h, "vertex-colours");
    let [left, middle, right] = [16, 64, 111].map(|x| blend.get_pixel(x, 32).0.map(u32::from));
    assert!(left[0] > 2 * left[1] && right[1] > 2 * right[0], "{left:?} {right:?}");
    assert!(middle[0].abs_diff(middle[1]) <= 3 && middle[2] < middle[0], "{middle:?}");
    assert!(middle[0] * 100 > left[0] * 60, "{left:?} {middle:?}");
}

#[test]
fn sun_lights_the_side_that_faces_it() {
    let Some(mut h) = headless(96, 96) else { return };
    let ball = asset(&h, &sphere(24), Material::default());
    let drawables = [Drawable { asset: &ball, instances: &[at(0.0, 0.0, 0.0, 2.0)] }];
    let mut frame = Frame::new(front_camera(), &drawables);
    frame.environment.to_sun = DVec3::new(1.0, 0.3, 0.5);
    let image = picture(&mut h, &frame);
    assert!(luma(&image, 70, 48) > luma(&image, 26, 48) + 40.0);
    frame.environment.to_sun = DVec3::new(-1.0, 0.3, 0.5);
    let image = picture(&mut h, &frame);
    assert!(luma(&image, 26, 48) > luma(&image, 70, 48) + 40.0);
}

#[test]
fn back_faces_are_drawn_and_lit_like_front_faces() {
    let Some(mut h) = headless(64, 64) else { return };
    let front = quad([-1.0, -1.0, 0.0], [2.0, 0.0, 0.0], [0.0, 2.0, 0.0], 1.0);
    let back = (front.0.clone(), front.1.iter().map(|f| [f[0], f[2], f[1]]).collect());
    let flipped: (Vec<_>, _) =
        (back.0.iter().map(|v| PackedVertex { normal: v.normal.map(|x| -x), ..*v }).collect(), back.1);
    let mut shoot = |mesh| {
        let asset = asset(&h, mesh, Material::default());
        let drawables = [Drawable { asset: &asset, instances: &[Placement::default()] }];
        picture(&mut h, &Frame::new(front_camera(), &drawables))
    };
    // The same plane with opposite winding and normal.
    assert_eq!(shoot(&front), shoot(&flipped));
}

#[test]
fn flat_surfaces_carry_no_occlusion() {
    let Some(mut h) = headless(160, 90) else { return };
    let floor = asset(
        &h,
        &quad([-500.0, 0.0, 500.0], [1000.0, 0.0, 0.0], [0.0, 0.0, -1000.0], 1.0),
        Material::default(),
    );
    let ball = asset(&h, &sphere(12), Material::default());
    let camera = Pose::look_at(DVec3::new(0.0, 1.0, 5.0), DVec3::new(0.0, 0.2, 0.0), DVec3::Y, 0.9);
    let mut shoot = |drawables: &[Drawable<'_>], on: bool| {
        let mut frame = Frame::new(camera, drawables);
        if !on {
            frame.settings.occlusion = None;
        }
        picture(&mut h, &frame)
    };
    let plane = [Drawable { asset: &floor, instances: &[Placement::default()] }];
    assert_eq!(compare(&shoot(&plane, true), &shoot(&plane, false), None).unwrap().max_difference, 0);
    // A coarse ball's facets do not shade themselves either (its silhouette may, against nothing).
    let alone = [Drawable { asset: &ball, instances: &[at(0.0, 1.0, 0.0, 2.0)] }];
    assert!(compare(&shoot(&alone, true), &shoot(&alone, false), None).unwrap().mean_difference < 0.2);
    // Together, the contact is shaded.
    let both = [plane[0], alone[0]];
    let c = compare(&shoot(&both, true), &shoot(&both, false), None).unwrap();
    assert!(c.max_difference > 12, "{c:?}");
}

#[test]
fn levels_have_colours_of_their_own() {
    let Some(mut h) = headless(96, 48) else { return };
    let left = quad([-1.0, -0.5, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], 1.0);
    let mut mesh =
        super::shapes::join(&[left, quad([0.0, -0.5, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], 1.0)]);
    for v in &mut mesh.0[4..] {
        *v = v.at_level(1);
    }
    let asset = asset(&h, &mesh, Material::default());
    let drawables = [Drawable { asset: &asset, instances: &[Placement::default()] }];
    let mut frame = Frame::new(front_camera(), &drawables);
    frame.settings.debug_view = DebugView::Level;
    let image = picture(&mut h, &frame);
    let (a, b) = (image.get_pixel(40, 24), image.get_pixel(56, 24));
    assert!((0..3).any(|c| a[c].abs_diff(b[c]) > 60), "{a:?} {b:?}");
}

#[test]
fn far_from_zero_the_picture_is_the_same() {
    let Some(mut h) = headless(96, 96) else { return };
    let ball = asset(&h, &sphere(24), Material::default());
    let mut shoot = |offset: DVec3| {
        let instance = Placement { scale: 0.002, ..Placement::at(offset.into()) };
        let drawables = [Drawable { asset: &ball, instances: &[instance] }];
        let camera = Pose::look_at(offset + DVec3::new(0.0, 0.0, 0.004), offset, DVec3::Y, 0.8);
        let settings = Settings { near: 1e-5, ..Settings::default() };
        picture(&mut h, &Frame { settings, ..Frame::new(camera, &drawables) })
    };
    // A two-millimetre ball at zero and 10,000 km away (where f64 still resolves nanometres).
    let c = compare(&shoot(DVec3::ZERO), &shoot(DVec3::new(1e7, -1e7, 1e7)), None).unwrap();
    assert!(c.mean_difference < 0.05, "{c:?}");
}

#[test]
fn instances_out_of_view_are_left_out() {
    let Some(mut h) = headless(64, 64) else { return };
    let mut ball = asset(&h, &sphere(8), Material::default());
    let places: Vec<_> = (0..10).map(|i| at(f64::from(i) * 4.0, 0.0, 0.0, 1.0)).collect();
    let mut shoot = |ball: &crate::AssetGpu| {
        let drawables = [Drawable { asset: ball, instances: &places }];
        // Bounds also determine the size of shadow maps.
        let settings = Settings { shadows: None, ..Settings::default() };
        let counters = h.frame(&Frame { settings, ..Frame::new(front_camera(), &drawables) }).unwrap();
        (counters.instances, counters.instances_culled, h.picture().unwrap())
    };
    let (drawn, culled, all) = shoot(&ball);
    assert_eq!((drawn, culled), (10, 0), "nothing is known about bounds yet");
    ball.set_bounds(DVec3::ZERO, 0.5);
    let (drawn, culled, seen) = shoot(&ball);
    assert_eq!((drawn, culled), (1, 9));
    assert_eq!(all, seen);
}

#[test]
fn empty_scene_is_sky_and_bad_sizes_are_errors() {
    let Some(mut h) = headless(64, 64) else { return };
    let counters = h.frame(&Frame::new(front_camera(), &[])).unwrap();
    assert_eq!(counters.passes, [PassId::Sky, PassId::ToneMap]);
    assert!(h.coverage().unwrap().iter().all(|c| !c));
    let image = h.picture().unwrap();
    assert!(image.get_pixel(32, 4)[2] > image.get_pixel(32, 4)[0], "the sky is blue");
    assert!(image.get_pixel(32, 60)[2] <= image.get_pixel(32, 60)[0], "the ground is not");
    for (w, height) in [(0, 10), (10, 0), (1 << 20, 1)] {
        let result = Headless::new(h.gpu().clone(), w, height);
        assert!(matches!(result, Err(RenderError::TooLarge { .. })));
    }
    assert!(Headless::new(h.gpu().clone(), 1, 1).unwrap().frame(&Frame::new(front_camera(), &[])).is_ok());
}

#[test]
fn strange_views_and_places_do_not_fail() {
    let Some(mut h) = headless(33, 17) else { return };
    let ball = asset(&h, &sphere(8), Material::default());
    let places = [
        Placement::default(),
        Placement::at([f64::NAN; 3]),
        Placement { scale: f32::INFINITY, ..Placement::default() },
        Placement { scale: 0.0, ..Placement::default() },
        Placement { scale: -1.0, ..Placement::default() },
    ];
    let drawables = [Drawable { asset: &ball, instances: &places }];
    for fov_y in [0.001, 1.0, 3.1, f64::NAN, -1.0, 100.0] {
        for eye in [DVec3::ZERO, DVec3::new(0.0, 0.0, 0.5), DVec3::splat(1e30), DVec3::NAN] {
            let camera = Pose::look_at(eye, DVec3::ZERO, DVec3::Y, fov_y);
            h.frame(&Frame::new(camera, &drawables)).unwrap();
        }
    }
}

/// A picture drawn at half size and enlarged shows the same objects in the same places, only softer.
#[test]
fn a_smaller_scale_is_the_same_picture_only_softer() {
    let Some(mut h) = headless(321, 179) else { return };
    still_life(&mut h, |h, drawables, camera| {
        let mut at = |render_scale: f32| {
            let settings = Settings { render_scale, ..Settings::default() };
            picture(h, &Frame { settings, ..Frame::new(camera, drawables) })
        };
        let full = at(1.0);
        // NaN and values above 1 count as 1.
        assert!(at(f32::NAN) == full && at(2.0) == full);
        // An enlarged thumbnail of the full picture loses as much.
        let softer = |share: f32| {
            use image::imageops::{FilterType::Triangle, resize};
            let [w, h] = [full.width(), full.height()].map(|side| (side as f32 * share).round() as u32);
            resize(&resize(&full, w, h, Triangle), full.width(), full.height(), Triangle)
        };
        for (scale, share, least) in [(0.5, 0.5, 0.9), (0.0, MIN_RENDER_SCALE, 0.8)] {
            let drawn = at(scale);
            let found = compare(&drawn, &softer(share), None).unwrap();
            let moved = RgbaImage::from_fn(drawn.width(), drawn.height(), |x, y| {
                *drawn.get_pixel((x + (2.0 / share) as u32).min(drawn.width() - 1), y)
            });
            let moved = compare(&moved, &softer(share), None).unwrap();
            println!("{scale}: {found:?}, two of its pixels to the side {:.3}", moved.ssim);
            assert!(found.ssim >= least && moved.ssim < found.ssim - 0.01, "{scale}: {found:?}, {moved:?}");
        }
    });
}
