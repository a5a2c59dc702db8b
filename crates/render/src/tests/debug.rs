//! What passes hand on, shown in place of the picture, against what the scene is known to be.

use glam::{DQuat, DVec3};
use image::RgbaImage;

use super::shapes::{asset, at, cube, join, quad, sphere};
use super::{headless, keep};
use crate::cpu_reference::brdf::octahedral;
use crate::cpu_reference::debug;
use crate::cpu_reference::depth::view_ray;
use crate::frame::graph::Resource;
use crate::resources::descriptors::texture_2d;
use crate::resources::readback::read_texture;
use crate::{
    Alpha, DebugView, Drawable, Frame, Headless, Instance, Load, Material, PassId, Pose, Renderer, Settings,
    Target,
};

const SIZE: [u32; 2] = [96, 54];
const COLOUR: [f32; 3] = [0.25, 0.5, 0.75];

fn camera() -> Pose {
    Pose::look_at(DVec3::new(0.0, 0.0, 3.0), DVec3::ZERO, DVec3::Y, 0.8)
}

fn settings(debug_view: DebugView) -> Settings {
    Settings { debug_view, ..Settings::default() }
}

/// A plane through zero that is turned about y and fills the view.
fn plane<R>(
    h: &mut Headless,
    draw: impl FnOnce(&mut Headless, &dyn Fn(DebugView) -> Frame<'static>) -> R,
) -> R {
    let material = Material { base_colour: COLOUR, roughness: 0.3, metallic: 0.6, ..Material::default() };
    let wall = asset(h, &quad([-9.0, -9.0, 0.0], [18.0, 0.0, 0.0], [0.0, 18.0, 0.0], 1.0), material);
    let turned = Instance { rotation: DQuat::from_rotation_y(0.5), ..Instance::default() };
    // A test's few frames may live as long as it.
    let wall: &'static _ = Box::leak(Box::new(wall));
    let instances: &'static [Instance] = Box::leak(Box::new([turned]));
    let drawables: &'static [Drawable<'static>] = Box::leak(Box::new([Drawable { asset: wall, instances }]));
    draw(h, &|view| Frame { settings: settings(view), ..Frame::new(camera(), drawables) })
}

fn picture(h: &mut Headless, frame: &Frame<'_>) -> RgbaImage {
    h.frame(frame).unwrap();
    h.picture().unwrap()
}

/// View depth of the plane at a pixel.
fn plane_depth(x: u32, y: u32) -> f64 {
    let (tx, ty) = camera().tan_half_fov(SIZE[0], SIZE[1]);
    // The camera looks along −z from (0, 0, 3): view axes are the world's.
    let ray = DVec3::from(view_ray([i64::from(x), i64::from(y)], SIZE, [tx, ty]));
    let normal = DQuat::from_rotation_y(0.5) * DVec3::Z;
    -DVec3::new(0.0, 0.0, 3.0).dot(normal) / ray.dot(normal)
}

fn assert_shows(picture: &RgbaImage, want: impl Fn(u32, u32) -> Option<[f64; 3]>, what: &str) {
    let mut compared = 0;
    for (x, y, got) in picture.enumerate_pixels() {
        let Some(want) = want(x, y) else { continue };
        compared += 1;
        for (got, want) in got.0.iter().zip(want) {
            assert!((f64::from(*got) - 255.0 * want).abs() <= 1.1, "{what} at {x}, {y}: {got} {want}");
        }
    }
    assert!(compared > SIZE[0] * SIZE[1] / 2, "{what}: {compared} pixels");
}

#[test]
fn a_plane_shows_its_normal_albedo_surface_and_depth_in_every_pixel() {
    let Some(mut h) = headless(SIZE[0], SIZE[1]) else { return };
    plane(&mut h, |h, frame| {
        let normal = debug::normal(octahedral((DQuat::from_rotation_y(0.5) * DVec3::Z).to_array()));
        assert_shows(&picture(h, &frame(DebugView::Normal)), |_, _| Some(normal), "normal");
        let albedo = debug::albedo(COLOUR.map(f64::from));
        assert_shows(&picture(h, &frame(DebugView::Albedo)), |_, _| Some(albedo), "albedo");
        let surface = debug::surface(0.3, 0.6, 1.0);
        assert_shows(&picture(h, &frame(DebugView::Surface)), |_, _| Some(surface), "surface");
        let depth = |x, y| {
            let depth = plane_depth(x, y);
            // Where an octave ends, rounding decides about the colour.
            let octaves = depth.log2();
            ((octaves - octaves.round()).abs() > 1e-4).then(|| debug::depth(depth))
        };
        assert_shows(&picture(h, &frame(DebugView::Depth)), depth, "depth");
        keep(h, "debug-depth");
    });
}

/// What is drawn smaller is shown as it is, each texel for those pixels that it stands for.
#[test]
fn upscaled_debug_values_are_not_interpolated() {
    let Some(mut h) = headless(SIZE[0], SIZE[1]) else { return };
    plane(&mut h, |h, frame| {
        let mut half = frame(DebugView::Depth);
        half.settings.render_scale = 0.5;
        let small = picture(h, &half);
        assert!(small.enumerate_pixels().all(|(x, y, pixel)| pixel == small.get_pixel(x / 2 * 2, y / 2 * 2)));
    });
}

#[test]
fn occlusion_and_sunlight_views_match_their_passes_or_are_white() {
    let Some(mut h) = headless(SIZE[0], SIZE[1]) else { return };
    let box_ = asset(&h, &cube(), Material::default());
    let ball = asset(&h, &sphere(24), Material::default());
    let drawables = [
        Drawable { asset: &box_, instances: &[at(0.0, -1.0, 0.0, 2.0)] },
        Drawable { asset: &ball, instances: &[at(-0.2, 0.3, 0.2, 0.6)] },
    ];
    let camera = Pose::look_at(DVec3::new(0.6, 1.3, 2.2), DVec3::new(0.0, 0.1, 0.0), DVec3::Y, 0.8);
    let frame = |view| Frame { settings: settings(view), ..Frame::new(camera, &drawables) };
    for (view, resource, bytes) in
        [(DebugView::Occlusion, Resource::Occlusion, 1), (DebugView::Sunlight, Resource::Sunlight, 2)]
    {
        let shown = picture(&mut h, &frame(view));
        let seen = h.coverage().unwrap();
        let texels = h.intermediate(resource, bytes).unwrap();
        let value = |x, y| {
            let i = (y * SIZE[0] + x) as usize;
            if seen[i] { f64::from(texels[i * bytes as usize]) / 255.0 } else { 0.0 }
        };
        assert_shows(&shown, |x, y| Some([value(x, y); 3]), view.name());
        let dark = shown.pixels().zip(&seen).filter(|(pixel, seen)| **seen && pixel[0] < 250).count();
        assert!(dark > 20, "{view:?}: {dark}");
        let mut without = frame(view);
        (without.settings.occlusion, without.settings.shadows) = (None, None);
        let white = picture(&mut h, &without);
        assert!(white.pixels().zip(&seen).all(|(pixel, seen)| pixel[0] == if *seen { 255 } else { 0 }));
    }
}

/// Colours of the cascades' view against the numbers that the lookups of the maps left: light alone tells those of one
/// cascade apart.
#[test]
fn cascade_view_shows_the_deciding_cascade() {
    let Some(mut h) = headless(SIZE[0], SIZE[1]) else { return };
    // A floor from the eye's feet to a hundred times as far.
    let floor =
        asset(&h, &quad([-40.0, 0.0, 2.0], [80.0, 0.0, 0.0], [0.0, 0.0, -160.0], 1.0), Material::default());
    let ball = asset(&h, &sphere(16), Material::default());
    let balls: Vec<Instance> = (0..7).map(|i| at(0.3, 0.4, 0.5 - f64::from(1 << i), 0.8)).collect();
    let drawables = [
        Drawable { asset: &floor, instances: &[Instance::default()] },
        Drawable { asset: &ball, instances: &balls },
    ];
    let camera = Pose::look_at(DVec3::new(0.0, 0.6, 1.5), DVec3::new(0.0, 0.3, -2.0), DVec3::Y, 0.9);
    let mut frame = Frame { settings: settings(DebugView::Cascade), ..Frame::new(camera, &drawables) };
    frame.settings.anti_aliasing = crate::AntiAliasing::None;
    let shown = picture(&mut h, &frame);
    keep(&h, "debug-cascade");
    let sunlight = h.intermediate(Resource::Sunlight, 2).unwrap();
    let cascade = |x: u32, y: u32| sunlight[2 * (y * SIZE[0] + x) as usize + 1];
    let seen = h.coverage().unwrap();
    // Hues as the sum over all pixels of a cascade says them.
    let mut sums = std::collections::BTreeMap::<u8, [f64; 3]>::new();
    for (x, y, pixel) in shown.enumerate_pixels().filter(|(x, y, _)| seen[(y * SIZE[0] + x) as usize]) {
        let sum = sums.entry(cascade(x, y)).or_default();
        (0..3).for_each(|c| sum[c] += f64::from(pixel[c]));
    }
    sums.remove(&255);
    assert!(sums.len() >= 3, "{sums:?}");
    let hues: Vec<[f64; 3]> = sums.values().map(|sum| sum.map(|c| c / sum.iter().sum::<f64>())).collect();
    let apart = |a: &[f64; 3], b: &[f64; 3]| (0..3).map(|c| (a[c] - b[c]).abs()).fold(0.0, f64::max);
    for (i, a) in hues.iter().enumerate() {
        assert!(hues[..i].iter().all(|b| apart(a, b) > 0.05), "{hues:?}");
    }
    // Elsewhere, and without shadows, it is the picture.
    frame.settings.shadows = None;
    let without = picture(&mut h, &frame);
    frame.settings.debug_view = DebugView::Material;
    assert_eq!(picture(&mut h, &frame), without);
}

#[test]
fn overdraw_counts_what_was_drawn_before_something_nearer() {
    let Some(mut h) = headless(SIZE[0], SIZE[1]) else { return };
    let far = quad([-9.0, -9.0, -1.0], [18.0, 0.0, 0.0], [0.0, 18.0, 0.0], 1.0);
    let near = quad([0.0, -9.0, 0.0], [9.0, 0.0, 0.0], [0.0, 18.0, 0.0], 1.0);
    for (mesh, behind) in [(join(&[far.clone(), near.clone()]), 2.0), (join(&[near, far]), 1.0)] {
        let quads = asset(&h, &mesh, Material::default());
        let drawables = [Drawable { asset: &quads, instances: &[Instance::default()] }];
        let frame = Frame { settings: settings(DebugView::Overdraw), ..Frame::new(camera(), &drawables) };
        let counters = h.frame(&frame).unwrap();
        assert_eq!(counters.passes, [PassId::Overdraw, PassId::Debug]);
        assert_overdraw(&h, [1.0, behind]);
    }
}

/// Asserts the overdraw of the picture's left and right half.
fn assert_overdraw(h: &Headless, [left, right]: [f64; 2]) {
    let counts = |x| if x < SIZE[0] / 2 { left } else { right };
    let texels = h.intermediate(Resource::Overdraw, 2).unwrap();
    let texels: Vec<half::f16> = bytemuck::pod_collect_to_vec(&texels);
    for (i, got) in (0..).zip(texels) {
        assert_eq!(got.to_f64(), counts(i % SIZE[0]), "pixel {i}");
    }
    assert_shows(&h.picture().unwrap(), |x, _| Some(debug::count(counts(x))), "overdraw");
}

#[test]
fn overdraw_skips_holes_and_transparent_surfaces_hide_nothing() {
    let Some(mut h) = headless(SIZE[0], SIZE[1]) else { return };
    let half = |left: f32, z: f32| quad([left, -9.0, z], [9.0, 0.0, 0.0], [0.0, 18.0, 0.0], 1.0);
    let hole = Material { opacity: 0.2, alpha: Alpha::Mask(0.5), ..Material::default() };
    let pane = Material { opacity: 0.2, alpha: Alpha::Blend, ..Material::default() };
    let hole = asset(&h, &half(-9.0, 0.0), hole);
    // The nearer of two is drawn first, and the other lies behind it.
    let panes = asset(&h, &join(&[half(0.0, 0.5), half(0.0, 0.0)]), pane);
    let wall = quad([-9.0, -9.0, -1.0], [18.0, 0.0, 0.0], [0.0, 18.0, 0.0], 1.0);
    let wall = asset(&h, &wall, Material::default());
    let instances = &[Instance::default()];
    let drawables = [&hole, &panes, &wall].map(|asset| Drawable { asset, instances });
    for (drawables, halves) in [(&drawables[..], [1.0, 3.0]), (&drawables[..2], [0.0, 2.0])] {
        let frame = Frame { settings: settings(DebugView::Overdraw), ..Frame::new(camera(), drawables) };
        h.frame(&frame).unwrap();
        assert_overdraw(&h, halves);
    }
}

#[test]
fn unlit_surfaces_have_no_normal() {
    let Some(mut h) = headless(SIZE[0], SIZE[1]) else { return };
    let wall = quad([-9.0, -9.0, 0.0], [18.0, 0.0, 0.0], [0.0, 18.0, 0.0], 1.0);
    let wall = asset(&h, &wall, Material { unlit: true, base_colour: COLOUR, ..Material::default() });
    let drawables = [Drawable { asset: &wall, instances: &[Instance::default()] }];
    let frame = |view| Frame { settings: settings(view), ..Frame::new(camera(), &drawables) };
    let none = debug::normal([2.0; 2]);
    assert_shows(&picture(&mut h, &frame(DebugView::Normal)), |_, _| Some(none), "normal");
    let albedo = debug::albedo(COLOUR.map(f64::from));
    assert_shows(&picture(&mut h, &frame(DebugView::Albedo)), |_, _| Some(albedo), "albedo");
}

#[test]
fn debug_views_cost_nothing_unless_requested() {
    let Some(mut h) = headless(SIZE[0], SIZE[1]) else { return };
    plane(&mut h, |h, frame| {
        let before = picture(h, &frame(DebugView::Material));
        assert!(h.intermediate(Resource::Overdraw, 2).is_none());
        for view in DebugView::ALL {
            h.frame(&frame(view)).unwrap();
        }
        assert_eq!(picture(h, &frame(DebugView::Material)), before);
        // Where nothing is drawn there is nothing to show.
        let empty = Frame { settings: settings(DebugView::Normal), ..Frame::new(camera(), &[]) };
        assert_eq!(h.frame(&empty).unwrap().passes, [PassId::Sky, PassId::ToneMap]);
    });
}

/// A host's colour with an sRGB format shows the same, and keeps what is nearer.
#[test]
fn debug_views_work_in_a_hosts_targets() {
    let Some(mut h) = headless(SIZE[0], SIZE[1]) else { return };
    let format = wgpu::TextureFormat::Rgba8UnormSrgb;
    let usage = wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::COPY_SRC;
    let texture = |h: &Headless, format| {
        h.gpu().device.create_texture(&texture_2d("a host's", SIZE.into(), format, usage))
    };
    let colour = texture(&h, format);
    let depth = texture(&h, wgpu::TextureFormat::Depth32Float);
    let views = [&colour, &depth].map(|texture| texture.create_view(&Default::default()));
    let mut host = Renderer::new(h.gpu(), format).unwrap();
    plane(&mut h, |h, frame| {
        let frame = frame(DebugView::Normal);
        let want = picture(h, &frame);
        for (with_depth, load) in [(false, Load::Clear), (true, Load::Clear), (true, Load::Keep)] {
            let target = Target {
                depth: with_depth.then_some(&views[1]),
                load,
                ..Target::colour(&views[0], (SIZE[0], SIZE[1]))
            };
            let mut encoder = h.gpu().device.create_command_encoder(&Default::default());
            host.record(h.gpu(), &mut encoder, &target, &frame).unwrap();
            h.gpu().queue.submit([encoder.finish()]);
            let got = read_texture(h.gpu(), &colour, 4).unwrap();
            // In the last round the same surface lies there already, and what is not nearer does not replace it.
            let off = got.iter().zip(want.as_raw()).map(|(a, b)| a.abs_diff(*b)).max();
            assert!(off <= Some(1), "{with_depth} {load:?}: {off:?}");
        }
        let stored: Vec<f32> = bytemuck::pod_collect_to_vec(&read_texture(h.gpu(), &depth, 4).unwrap());
        assert_eq!(stored, h.depth().unwrap());
    });
}
