//! Pictures drawn smaller than shown: their edges are smoothed too.

use glam::DVec3;

use super::shapes::{asset, at, cube, sphere};
use super::{headless, keep};
use crate::cpu_reference::antialias::Display;
use crate::cpu_reference::{temporal, tone};
use crate::frame::graph::Resource;
use crate::{AntiAliasing, Counters, Drawable, Frame, Headless, Material, PassId, Pose, Settings};

const SIZE: [u32; 2] = [120, 68];
const SCALE: f32 = 0.5;

/// Draws a still life a number of times.
fn draw(h: &mut Headless, anti_aliasing: AntiAliasing, render_scale: f32, frames: u32) -> Counters {
    let box_ = asset(h, &cube(), Material::default());
    let ball = asset(h, &sphere(24), Material { base_color: [0.1, 0.2, 0.5, 1.0], ..Material::default() });
    let drawables = [
        Drawable { asset: &box_, instances: &[at(0.0, -1.0, 0.0, 2.0), at(0.3, 0.25, 0.3, 0.5)] },
        Drawable { asset: &ball, instances: &[at(-0.4, 0.3, 0.2, 0.6)] },
    ];
    let camera = Pose::look_at(DVec3::new(0.6, 1.3, 2.2), DVec3::new(0.0, 0.1, 0.0), DVec3::Y, 0.8);
    // Occlusion knows the size of pixels, which differs between the pictures compared here.
    let settings =
        Settings { anti_aliasing, render_scale, occlusion: None, dither: false, ..Settings::default() };
    let frame = Frame { settings, ..Frame::new(camera, &drawables) };
    (1..frames).for_each(|_| drop(h.frame(&frame).unwrap()));
    h.frame(&frame).unwrap()
}

/// Display values of an intermediate picture.
fn values(h: &Headless, resource: Resource) -> Vec<[f64; 3]> {
    let bytes = h.intermediate(resource, 4).expect("the frame has it");
    bytes.chunks(4).map(|texel| std::array::from_fn(|c| f64::from(texel[c]) / 255.0)).collect()
}

#[test]
fn anti_aliasing_and_upscaling_match_their_cpu_reference() {
    let Some(mut h) = headless(SIZE[0], SIZE[1]) else { return };
    let counters = draw(&mut h, AntiAliasing::Spatial, SCALE, 1);
    assert!(
        counters.passes.ends_with(&[PassId::ToneMap, PassId::AntiAlias, PassId::Enlarge]),
        "{counters:?}"
    );
    keep(&h, "enlarged-spatial");
    let size_px = SIZE.map(|side| side / 2);
    let [display, smoothed] = [Resource::Display, Resource::Smoothed].map(|resource| values(&h, resource));
    assert_eq!(display.len(), (size_px[0] * size_px[1]) as usize);
    let [before, after] = [&display, &smoothed].map(|pixels| Display { pixels, size_px });
    let off = |got: [f64; 3], want: [f64; 3]| (0..3).any(|c| (got[c] - want[c]).abs() > 1.5 / 255.0);
    let place = |i: usize| [i as i64 % i64::from(size_px[0]), i as i64 / i64::from(size_px[0])];
    let wrong = (0..smoothed.len()).filter(|&i| off(smoothed[i], before.smoothed(place(i)))).count();
    assert!(
        wrong * 100 < smoothed.len(),
        "{wrong} of {} texels differ from the CPU reference's",
        smoothed.len()
    );
    assert_ne!(display, smoothed);
    for (x, y, pixel) in h.picture().unwrap().enumerate_pixels() {
        let got = std::array::from_fn(|c| f64::from(pixel[c]) / 255.0);
        let want = after.enlarged([x, y], SIZE);
        assert!(!off(got, want), "{x}, {y}: {got:?} {want:?}");
    }
}

/// The picture before enlarging is that of a target of the smaller size.
#[test]
fn the_upscaled_picture_is_that_of_a_small_target() {
    let [Some(mut h), Some(mut small)] = [1, 2].map(|part| headless(SIZE[0] / part, SIZE[1] / part)) else {
        return;
    };
    draw(&mut h, AntiAliasing::Spatial, SCALE, 1);
    draw(&mut small, AntiAliasing::Spatial, 1.0, 1);
    let smoothed = h.intermediate(Resource::Smoothed, 4).unwrap();
    assert!(smoothed == small.picture().unwrap().into_raw());

    let counters = draw(&mut h, AntiAliasing::Temporal, SCALE, 5);
    assert!(counters.passes.contains(&PassId::Temporal) && counters.still_frames == 5, "{counters:?}");
    draw(&mut small, AntiAliasing::Temporal, 1.0, 5);
    let [mean, of_small] = [&h, &small].map(|h| h.intermediate(Resource::History, 8).unwrap());
    assert!(mean == of_small);
    keep(&h, "enlarged-temporal");
    // Interpolated between the mean's texels, then tone mapped.
    let halves: Vec<half::f16> = bytemuck::pod_collect_to_vec(&mean);
    let pixels: Vec<[f64; 3]> =
        halves.chunks(4).map(|texel| std::array::from_fn(|c| texel[c].to_f64())).collect();
    let mean = Display { pixels: &pixels, size_px: SIZE.map(|side| side / 2) };
    for (x, y, pixel) in h.picture().unwrap().enumerate_pixels() {
        let light = temporal::unweighed(mean.enlarged([x, y], SIZE));
        let want = light.map(|x| tone::encode_srgb(tone::filmic(x)) * 255.0);
        assert!((0..3).all(|c| (f64::from(pixel[c]) - want[c]).abs() <= 1.5), "{x}, {y}: {pixel:?} {want:?}");
    }
}
