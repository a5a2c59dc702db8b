//! Anti-aliasing over time: against its CPU reference, against many samples a pixel, and what it must not leave behind.

use glam::{DVec3, Vec3};
use image::RgbaImage;

use super::shapes::{asset, at, cube, quad, sphere};
use super::{headless, keep};
use crate::cpu_reference::{temporal, tone};
use crate::frame::graph::Resource;
use crate::{
    AntiAliasing, AssetGpu, DebugView, Drawable, Environment, Frame, GradientSky, Headless, Instance,
    Material, PassId, Pose, Settings, Sky, Water,
};

const SIZE: (u32, u32) = (120, 68);
/// Pixels along a side in place of one.
const FINER: u32 = 8;

/// A still life of assets of one renderer.
struct Scene {
    box_: AssetGpu,
    ball: AssetGpu,
    wall: AssetGpu,
}

impl Scene {
    fn new(h: &Headless) -> Self {
        let colour = |c: [f32; 3]| Material { base_colour: c, roughness: 0.8, ..Material::default() };
        Self {
            box_: asset(h, &cube(), colour([0.8; 3])),
            ball: asset(h, &sphere(24), colour([0.1, 0.2, 0.5])),
            wall: asset(
                h,
                &quad([-4.0, -1.0, -1.5], [8.0, 0.0, 0.0], [0.0, 4.0, 0.0], 1.0),
                colour([0.5; 3]),
            ),
        }
    }

    /// Draws a frame in which the column and the ball stand so far to the right.
    fn draw(
        &self,
        h: &mut Headless,
        camera: Pose,
        moved: f64,
        anti_aliasing: AntiAliasing,
    ) -> crate::Counters {
        self.draw_in(h, camera, moved, anti_aliasing, None)
    }

    /// The same, in water perhaps.
    fn draw_in(
        &self,
        h: &mut Headless,
        camera: Pose,
        moved: f64,
        anti_aliasing: AntiAliasing,
        water: Option<Water>,
    ) -> crate::Counters {
        let column = Instance { scale: 1.0, ..at(-0.8 + moved, 0.2, 0.0, 1.0) };
        let drawables = [
            Drawable { asset: &self.box_, instances: &[column, at(0.6, -0.6, 0.2, 0.7)] },
            Drawable { asset: &self.ball, instances: &[at(0.5 + moved, 0.3, 0.2, 0.6)] },
            Drawable { asset: &self.wall, instances: &[Instance::default()] },
        ];
        let frame = Frame { settings: settings(anti_aliasing), water, ..Frame::new(camera, &drawables) };
        h.frame(&frame).unwrap()
    }
}

/// A pond: a bed so far below its water, with pebbles on it, and two posts that stand out of it.
struct Pond {
    bed: AssetGpu,
    pebble: AssetGpu,
    post: AssetGpu,
    depth: f64,
    water: Water,
}

impl Pond {
    fn new(h: &Headless, depth: f64, clarity: f64) -> Self {
        let colour = |c: [f32; 3]| Material { base_colour: c, roughness: 0.8, ..Material::default() };
        let bed = quad([-30.0, -depth as f32, 10.0], [60.0, 0.0, 0.0], [0.0, 0.0, -60.0], 1.0);
        Self {
            bed: asset(h, &bed, colour([0.5, 0.45, 0.35])),
            pebble: asset(h, &sphere(8), colour([0.05; 3])),
            post: asset(h, &cube(), colour([0.6; 3])),
            depth,
            water: Water { level: 0.0, clarity, ripples: 0.5 },
        }
    }

    fn draw(&self, h: &mut Headless, right: f64, anti_aliasing: AntiAliasing) {
        let eye = DVec3::new(right, 0.8, 3.0);
        let camera = Pose::look_at(eye, eye + DVec3::new(0.0, -1.0, -3.0), DVec3::Y, 0.8);
        let pebbles: Vec<Instance> = (0..180)
            .map(|i| {
                let (x, z) = (f64::from(i % 18), f64::from(i / 18));
                let off = 0.4 * (f64::from(i) * 2.4).sin();
                // As large in the picture whatever lies between.
                let size = 0.2 * (1.0 + self.depth);
                let place = [(x - 9.0 + off) * size * 2.0, -self.depth, (2.0 - z * 2.0 - off) * size];
                at(place[0], place[1], place[2], size)
            })
            .collect();
        let posts = [at(-0.7, 0.0, 0.3, 0.35), at(0.8, 0.1, -1.2, 0.5)];
        let drawables = [
            Drawable { asset: &self.bed, instances: &[Instance::default()] },
            Drawable { asset: &self.pebble, instances: &pebbles },
            Drawable { asset: &self.post, instances: &posts },
        ];
        let sky = GradientSky {
            horizon: Vec3::splat(1.2),
            zenith: Vec3::new(0.15, 0.3, 0.7),
            ..GradientSky::default()
        };
        let to_sun = DVec3::new(0.1, 0.4, -1.0).normalize();
        let environment = Environment { to_sun, sky: Sky::Plain(sky), ..Environment::default() };
        let frame = Frame { environment, water: Some(self.water), ..Frame::new(camera, &drawables) };
        let settings = Settings { shadows: None, ..settings(anti_aliasing) };
        h.frame(&Frame { settings, ..frame }).unwrap();
    }
}

fn settings(anti_aliasing: AntiAliasing) -> Settings {
    // Occlusion knows the size of pixels, which many samples of one do not share.
    Settings { anti_aliasing, dither: false, occlusion: None, ..Settings::default() }
}

fn camera(right: f64) -> Pose {
    Pose::look_at(DVec3::new(0.6 + right, 1.0, 2.4), DVec3::new(right, 0.0, 0.0), DVec3::Y, 0.8)
}

/// As much light as the pixels that lie in one give together.
fn mean_of(fine: &RgbaImage) -> RgbaImage {
    RgbaImage::from_fn(SIZE.0, SIZE.1, |x, y| {
        let mean = |c: usize| {
            let of = |i: u32| fine.get_pixel(x * FINER + i % FINER, y * FINER + i / FINER)[c];
            let light = |i: u32| tone::decode_srgb(f64::from(of(i)) / 255.0);
            let sum = (0..FINER * FINER).map(light).sum::<f64>();
            (tone::encode_srgb(sum / f64::from(FINER * FINER)) * 255.0).round() as u8
        };
        image::Rgba([mean(0), mean(1), mean(2), 255])
    })
}

/// Sum of the squares of how far two pictures are apart.
fn squares(a: &RgbaImage, b: &RgbaImage) -> f64 {
    let channels = a.as_raw().iter().zip(b.as_raw());
    channels.map(|(a, b)| (f64::from(*a) - f64::from(*b)).powi(2)).sum::<f64>() / (255.0 * 255.0)
}

/// Mean FLIP between two pictures, at 67 pixels per degree, over the pixels at edges: elsewhere it is all about a 255th
/// that rounding decides.
fn flip(picture: &RgbaImage, truth: &RgbaImage) -> f64 {
    let image = |rgba: &RgbaImage| {
        let rgb = image::DynamicImage::from(rgba.clone()).into_rgb8();
        nv_flip::FlipImageRgb8::with_data(rgb.width(), rgb.height(), &rgb)
    };
    let map = nv_flip::flip(image(truth), image(picture), 67.0).to_vec();
    let at = |x: u32, y: u32| truth.get_pixel(x.min(SIZE.0 - 1), y.min(SIZE.1 - 1));
    let is_edge = |i: u32| {
        let (x, y) = (i % SIZE.0, i / SIZE.0);
        let around = [(x + 1, y), (x, y + 1), (x.saturating_sub(1), y), (x, y.saturating_sub(1))];
        around.into_iter().any(|(i, j)| (0..3).any(|c| at(i, j)[c].abs_diff(at(x, y)[c]) > 8))
    };
    let edges: Vec<_> =
        (0_u32..).zip(&map).filter(|(i, _)| is_edge(*i)).map(|(_, flip)| f64::from(*flip)).collect();
    edges.iter().sum::<f64>() / edges.len() as f64
}

/// Half floats of an intermediate picture, so many a pixel.
fn halves<const N: usize>(h: &Headless, resource: Resource) -> Vec<[f64; N]> {
    let bytes = h.intermediate(resource, 2 * N as u32).expect("the frame has it");
    let values: Vec<half::f16> = bytemuck::pod_collect_to_vec(&bytes);
    values.chunks_exact(N).map(|texel| std::array::from_fn(|i| texel[i].to_f64())).collect()
}

#[test]
fn temporal_accumulation_matches_its_cpu_reference() {
    let Some(mut h) = headless(SIZE.0, SIZE.1) else { return };
    // The wall, the column and half of the ball stand in the water.
    for water in [None, Some(Water { level: -0.1, clarity: 2.0, ripples: 0.5 })] {
        compare_with_the_cpu_reference(&mut h, water);
    }
}

fn compare_with_the_cpu_reference(h: &mut Headless, water: Option<Water>) {
    let scene = Scene::new(h);
    scene.draw(h, camera(0.0), 0.0, AntiAliasing::None);
    for frame in 0..3 {
        let step = f64::from(frame);
        scene.draw_in(h, camera(0.01 * step), 0.03 * step, AntiAliasing::Temporal, water);
    }
    let history = halves::<4>(h, Resource::History);
    let cameras = [camera(0.035), camera(0.02)];
    let counters = scene.draw_in(h, cameras[0], 0.1, AntiAliasing::Temporal, water);
    assert!(counters.passes.contains(&PassId::Motion) && counters.still_frames == 1, "{counters:?}");
    let radiance: Vec<[f64; 3]> =
        halves::<4>(h, Resource::Radiance).iter().map(|[r, g, b, _]| [*r, *g, *b]).collect();
    let depth: Vec<f64> = h.depth().unwrap().into_iter().map(f64::from).collect();
    let stored = halves::<2>(h, Resource::Motion);
    let motion: Vec<_> = stored.iter().map(|m| (m[0] < 5e4).then_some(*m)).collect();
    let step = h.renderer_mut().temporal_step();
    let cpu_reference = temporal::Resolve {
        size_px: [SIZE.0, SIZE.1],
        radiance: &radiance,
        depth: &depth,
        motion: &motion,
        history: &history,
        cameras,
        near: Settings::default().near,
        jitter: step.jitter.map(f64::from),
        exposure: 1.0,
        most: f64::from(step.history),
        water: water
            .and_then(|water| water.view_from(cameras[0].eye))
            .map(|water| [water.height, water.extinction.y]),
    };
    let got = halves::<4>(h, Resource::History);
    let shown = h.picture().unwrap();
    let (mut wrong, mut wrong_shown, mut moving) = (0, 0, 0);
    for (i, texel) in got.iter().enumerate() {
        let at = [i as i64 % i64::from(SIZE.0), i as i64 / i64::from(SIZE.0)];
        let want = cpu_reference.pixel(at);
        // What the history is rounded to, a place that is a hundredth of a pixel off, and ties in depth.
        wrong += usize::from(
            (0..3).any(|c| (texel[c] - want[c]).abs() > 0.004) || (texel[3] - want[3]).abs() > 0.3,
        );
        let light = temporal::unweighed([texel[0], texel[1], texel[2]]);
        let pixel = shown.get_pixel(at[0] as u32, at[1] as u32);
        let want = light.map(|x| tone::encode_srgb(tone::filmic(x)) * 255.0);
        wrong_shown += usize::from((0..3).any(|c| (f64::from(pixel[c]) - want[c]).abs() > 1.5));
        // What is drawn with something that moves may stand by itself.
        if let (Some(by_itself), None) = (motion[i], water) {
            let off = glam::DVec2::from(by_itself).distance(cpu_reference.motion_of_camera(at));
            assert!(!(0.01..0.5).contains(&off), "{at:?}: {by_itself:?}");
            moving += usize::from(off >= 0.5);
        }
    }
    assert!(wrong * 200 < got.len(), "{wrong} of {} pixels differ from the CPU reference's", got.len());
    assert!(wrong_shown * 200 < got.len(), "{wrong_shown} of {} are shown otherwise", got.len());
    assert!(water.is_some() || moving * 10 > got.len(), "{moving} pixels move by themselves");
}

/// Renderers of the pictures' size and of [`FINER`] ones.
fn both_sizes() -> Option<[Headless; 2]> {
    Some([headless(SIZE.0, SIZE.1)?, headless(SIZE.0 * FINER, SIZE.1 * FINER)?])
}

#[test]
fn a_still_picture_converges_to_supersampling() {
    let Some([mut h, mut fine]) = both_sizes() else { return };
    let (scene, large) = (Scene::new(&h), Scene::new(&fine));
    large.draw(&mut fine, camera(0.0), 0.0, AntiAliasing::None);
    let truth = mean_of(&fine.picture().unwrap());
    let mut off = |way, frames| {
        (0..frames).for_each(|_| {
            scene.draw(&mut h, camera(0.0), 0.0, way);
        });
        keep(&h, &format!("anti-aliasing-{}", way.name()));
        let picture = h.picture().unwrap();
        (squares(&picture, &truth), flip(&picture, &truth))
    };
    let [(none, _), (spatial, spatial_flip)] =
        [AntiAliasing::None, AntiAliasing::Spatial].map(|way| off(way, 1));
    let [(few, _), (many, many_flip)] = [8, 24].map(|frames| off(AntiAliasing::Temporal, frames));
    println!(
        "squared error over none's: spatial {}, 8 frames {}, 32 frames {}",
        spatial / none,
        few / none,
        many / none
    );
    println!("FLIP: spatial {spatial_flip}, 32 frames {many_flip}");
    assert!(many < 0.08 * none && few < 0.15 * none, "{none} {spatial} {few} {many}");
    assert!(many_flip < 0.5 * spatial_flip, "{spatial_flip} {many_flip}");
}

#[test]
fn temporal_anti_aliasing_beats_spatial_under_motion() {
    let Some([mut h, mut fine]) = both_sizes() else { return };
    let (scene, large) = (Scene::new(&h), Scene::new(&fine));
    // Pixels a frame: about 0.3, 1.5 and 6.
    for (speed, most) in [(0.006, 0.35), (0.03, 0.45), (0.12, 0.55)] {
        let end = camera(12.0 * speed);
        large.draw(&mut fine, end, 0.0, AntiAliasing::None);
        let truth = mean_of(&fine.picture().unwrap());
        let mut off = |way| {
            for frame in 0..=12 {
                scene.draw(&mut h, camera(f64::from(frame) * speed), 0.0, way);
            }
            let picture = h.picture().unwrap();
            (squares(&picture, &truth), flip(&picture, &truth))
        };
        let [(none, none_flip), (spatial, spatial_flip), (temporal, flip)] = AntiAliasing::ALL.map(&mut off);
        println!("{speed}: FLIP: {none_flip}, spatial {spatial_flip}, temporal {flip}");
        println!("{speed}: over none's: spatial {}, temporal {}", spatial / none, temporal / none);
        assert!(temporal < most * none, "{speed}: {none} {spatial} {temporal}");
        assert!(speed > 0.1 || flip < spatial_flip, "{speed}: {spatial_flip} {flip}");
    }
}

#[test]
fn under_motion_water_keeps_no_history_of_what_it_mirrors() {
    let Some(mut h) = headless(SIZE.0, SIZE.1) else { return };
    // Deep water is seen by what it mirrors, clear water by its bed, which is as far below or near. Speeds: pixels of the
    // surface a frame in the middle of the picture, about 0.3, 1.1 and 4; and the most that the squared error may be of
    // that without anti-aliasing. With histories of full length it was 3.40, 5.37 and 13.6, 0.53, 1.18 and 1.88, and
    // 0.67, 1.33 and 1.55.
    let speeds = [0.01, 0.04, 0.15];
    for (name, depth, clarity, most) in [
        ("deep", 6.0, 3.0, [1.2, 0.95, 1.45]),
        ("clear", 6.0, 60.0, [0.48, 0.9, 1.4]),
        ("shallow", 0.2, 6.0, [0.65, 1.25, 1.4]),
    ] {
        let pond = Pond::new(&h, depth, clarity);
        for (speed, most) in speeds.into_iter().zip(most) {
            let end = 12.0 * speed;
            pond.draw(&mut h, end, AntiAliasing::None);
            let sharp = h.picture().unwrap();
            (0..64).for_each(|_| pond.draw(&mut h, end, AntiAliasing::Temporal));
            let truth = h.picture().unwrap();
            pond.draw(&mut h, 0.0, AntiAliasing::None);
            (0..=12).for_each(|i| pond.draw(&mut h, f64::from(i) * speed, AntiAliasing::Temporal));
            let moved = h.picture().unwrap();
            keep(&h, &format!("temporal-water-{name}-{speed}"));
            let off = squares(&moved, &truth) / squares(&sharp, &truth);
            println!("{name} at {speed}: {off}, FLIP {} {}", flip(&sharp, &truth), flip(&moved, &truth));
            assert!(off < most, "{name} at {speed}: {off}");
        }
    }
}

#[test]
fn a_column_that_passes_a_wall_leaves_no_ghost() {
    let (Some(mut h), Some(mut fresh)) = (headless(SIZE.0, SIZE.1), headless(SIZE.0, SIZE.1)) else { return };
    let (scene, other) = (Scene::new(&h), Scene::new(&fresh));
    for frame in 0..12 {
        scene.draw(&mut h, camera(0.0), 0.05 * f64::from(frame), AntiAliasing::Temporal);
    }
    let moved = 0.05 * 12.0;
    scene.draw(&mut h, camera(0.0), moved, AntiAliasing::Temporal);
    keep(&h, "temporal-column");
    other.draw(&mut fresh, camera(0.0), moved, AntiAliasing::None);
    let (got, want) = (h.picture().unwrap(), fresh.picture().unwrap());
    // Away from edges, of what is there now and of its shadows, both show the same.
    let flat = |x: u32, y: u32| {
        let near = (0..25).map(|i| (x + i % 5 - 2, y + i / 5 - 2));
        let range = near.fold([255_u8, 0], |[low, high], (x, y)| {
            let value = want.get_pixel(x, y)[1];
            [low.min(value), high.max(value)]
        });
        range[1] - range[0] < 12
    };
    let (mut worst, mut sum, mut count) = (0_u8, 0_u64, 0_u64);
    for (x, y) in
        (2..SIZE.0 - 2).flat_map(|x| (2..SIZE.1 - 2).map(move |y| (x, y))).filter(|(x, y)| flat(*x, *y))
    {
        let off = (0..3).map(|c| got.get_pixel(x, y)[c].abs_diff(want.get_pixel(x, y)[c])).max().unwrap();
        worst = worst.max(off);
        sum += u64::from(off);
        count += 1;
    }
    println!("ghost: worst {worst}, mean {} over {count} pixels", sum as f64 / count as f64);
    assert!(count > 3000 && worst <= 12 && sum < count, "worst {worst}, {sum} over {count} pixels");
}

#[test]
fn any_visible_change_ends_a_still_picture() {
    let Some(mut h) = headless(SIZE.0, SIZE.1) else { return };
    let scene = Scene::new(&h);
    let still = |h: &mut Headless, frame: &Frame<'_>| h.frame(frame).unwrap().still_frames;
    let stand = [Instance::default()];
    let (one, two) = (at(0.0, 0.0, 0.0, 1.0), at(0.0, 1e-9, 0.0, 1.0));
    let (ones, twos) = ([one], [two]);
    let wall = Drawable { asset: &scene.wall, instances: &stand };
    let first = [Drawable { asset: &scene.ball, instances: &ones }, wall];
    let second = [Drawable { asset: &scene.ball, instances: &twos }, wall];
    let frame = Frame { settings: settings(AntiAliasing::Temporal), ..Frame::new(camera(0.0), &first) };
    assert_eq!([0; 3].map(|_| still(&mut h, &frame)), [1, 2, 3]);
    assert!(still(&mut h, &Frame { time_s: 7.0, ..frame }) == 4, "time alone changes nothing");
    let mut changed = |other: Frame<'_>| {
        assert_eq!([&other, &other, &frame].map(|frame| still(&mut h, frame)), [1, 2, 1], "{other:?}");
    };
    changed(Frame { drawables: &second, ..frame });
    changed(Frame { drawables: &first[..1], ..frame });
    changed(Frame { camera: camera(1e-9), ..frame });
    changed(Frame { settings: Settings { exposure: 1.01, ..frame.settings }, ..frame });
    let mut environment = frame.environment;
    environment.to_sun.x += 1e-6;
    changed(Frame { environment, ..frame });
    // Others have nothing to add up, and the next temporal one begins anew.
    let plain = Frame { settings: settings(AntiAliasing::Spatial), ..frame };
    assert_eq!([&plain, &frame].map(|frame| still(&mut h, frame)), [0, 1]);
}

#[test]
fn materials_textures_and_morphs_end_a_still_picture() {
    let Some(mut h) = headless(SIZE.0, SIZE.1) else { return };
    let mut ball = asset(&h, &sphere(12), Material::default());
    let stand = [Instance::default()];
    let draw = |h: &mut Headless, ball: &AssetGpu, time_s: f32| {
        let drawables = [Drawable { asset: ball, instances: &stand }];
        let frame = Frame::new(camera(0.0), &drawables);
        h.frame(&Frame { settings: settings(AntiAliasing::Temporal), time_s, ..frame }).unwrap()
    };
    assert_eq!([0; 2].map(|_| draw(&mut h, &ball, 0.0).still_frames), [1, 2]);
    ball.set_material(h.gpu(), 0, Material { base_colour: [1.0, 0.0, 0.0], ..Material::default() }).unwrap();
    assert_eq!([0; 2].map(|_| draw(&mut h, &ball, 0.0).still_frames), [1, 2]);
    // A vertex that is on its way for a quarter of a second.
    let mut vertex = sphere(12).0[40];
    vertex.morph_from = vertex.position.map(|x| 1.2 * x);
    vertex.birth_s = 1.0;
    ball.update_vertices(h.gpu(), 40, &[vertex]).unwrap();
    let times = [1.0, 1.1, 1.2, 1.3, 1.4].map(|time_s| {
        let counters = draw(&mut h, &ball, time_s);
        (counters.still_frames, counters.passes.contains(&PassId::Motion))
    });
    assert_eq!(times, [(1, true), (1, true), (1, true), (1, true), (2, false)]);
}

#[test]
fn temporal_anti_aliasing_leaves_no_trace() {
    let (Some(mut h), Some(mut fresh)) = (headless(SIZE.0, SIZE.1), headless(SIZE.0, SIZE.1)) else { return };
    let (scene, other) = (Scene::new(&h), Scene::new(&fresh));
    for frame in 0..3 {
        scene.draw(&mut h, camera(0.1 * f64::from(frame)), 0.0, AntiAliasing::Temporal);
    }
    for way in [AntiAliasing::Spatial, AntiAliasing::None] {
        scene.draw(&mut h, camera(0.0), 0.0, way);
        other.draw(&mut fresh, camera(0.0), 0.0, way);
        assert_eq!(h.picture().unwrap(), fresh.picture().unwrap());
    }
    // The same frames give the same picture, from the first on.
    let mut film = || {
        other.draw(&mut fresh, camera(0.0), 0.0, AntiAliasing::None);
        for frame in 0..5 {
            let step = f64::from(frame);
            other.draw(&mut fresh, camera(0.02 * step), 0.03 * step, AntiAliasing::Temporal);
        }
        fresh.picture().unwrap()
    };
    assert_eq!(film(), film());
}

#[test]
fn motion_is_shown_where_it_is() {
    let Some(mut h) = headless(SIZE.0, SIZE.1) else { return };
    let scene = Scene::new(&h);
    let mut shot = |right: f64| {
        let instances = [at(right, 0.0, 0.0, 1.0)];
        let wall = [Instance::default()];
        let drawables = [
            Drawable { asset: &scene.ball, instances: &instances },
            Drawable { asset: &scene.wall, instances: &wall },
        ];
        let camera = Pose::look_at(DVec3::new(0.0, 0.0, 3.0), DVec3::ZERO, DVec3::Y, 0.8);
        let frame = Frame::new(camera, &drawables);
        h.frame(&Frame { settings: Settings { debug_view: DebugView::Motion, ..frame.settings }, ..frame })
            .unwrap();
        h.picture().unwrap()
    };
    shot(0.0);
    let picture = shot(0.1);
    let [ball, wall] = [(SIZE.0 / 2, SIZE.1 / 2), (4, 30)].map(|(x, y)| picture.get_pixel(x, y).0);
    assert!(ball[0] > 170 && ball[2] < 85 && ball[1].abs_diff(127) < 4, "{ball:?}");
    assert!(wall[..3].iter().all(|c| c.abs_diff(127) < 2), "{wall:?}");
}
