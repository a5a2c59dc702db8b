//! Shaders against their twins in f64.

use glam::DVec3;

use super::shapes::{asset, at, cube, fill, mips16, quad, sphere};
use super::{headless, keep};
use crate::graph::Resource;
use crate::readback::read_texture;
use crate::twin::depth::view_ray;
use crate::twin::relief::height_maps::bricks;
use crate::twin::relief::methods::{Method, Prepared};
use crate::twin::relief::ray::Ray;
use crate::twin::relief::{reach, steps};
use crate::twin::surface::DepthPicture;
use crate::twin::{antialias, brdf, occlusion, tone};
use crate::{
    AmbientOcclusion, AntiAliasing, AssetGpu, Drawable, Frame, Headless, Instance, Material, OcclusionMethod,
    OcclusionRadius, PlainSky, Pose, ReliefMethod, Renderer, Settings, Sky, Target, TextureData, TextureKind,
    TextureShape, ToneMapping,
};

#[test]
fn tone_curve_matches_its_twin() {
    let Some(mut h) = headless(4, 4) else { return };
    let camera = Pose::look_at(DVec3::ZERO, DVec3::NEG_Z, DVec3::Y, 0.1);
    for value in [0.001f32, 0.01, 0.05, 0.18, 0.4, 0.9, 2.0, 7.0] {
        let mut frame = Frame::new(camera, &[]);
        // Make all of the sky one radiance.
        let all = glam::Vec3::splat(value * 0.5);
        frame.environment.sky =
            Sky::Plain(PlainSky { zenith: all, horizon: all, ground: all, ..PlainSky::default() });
        frame.settings.exposure = 2.0;
        frame.settings.dither = false;
        h.frame(&frame).unwrap();
        let got = f64::from(h.picture().unwrap().get_pixel(2, 2)[0]);
        let want = tone::encode_srgb(tone::filmic(f64::from(value))) * 255.0;
        // Half a step of the target plus the radiance target's 11 bits.
        assert!((got - want).abs() < 0.8, "{value}: {got} {want}");
    }
}

#[test]
fn the_neutral_curve_matches_its_twin_and_keeps_base_colours() {
    let Some(mut h) = headless(4, 4) else { return };
    let camera = Pose::look_at(DVec3::ZERO, DVec3::NEG_Z, DVec3::Y, 0.1);
    for value in [[0.01, 0.02, 0.03], [0.5, 0.3, 0.1], [0.2, 0.9, 0.4], [8.0, 2.0, 0.5], [900.0, 0.0, 5.0]] {
        let mut frame = Frame::new(camera, &[]);
        let colour = glam::DVec3::from(value).as_vec3();
        let plain = PlainSky { zenith: colour, horizon: colour, ground: colour, ..PlainSky::default() };
        frame.environment.sky = Sky::Plain(plain);
        frame.settings.dither = false;
        frame.settings.tone_mapping = ToneMapping::Neutral;
        h.frame(&frame).unwrap();
        let got = h.picture().unwrap().get_pixel(2, 2).0;
        for (got, want) in got.into_iter().zip(tone::neutral(value)) {
            let want = tone::encode_srgb(want.clamp(0.0, 1.0)) * 255.0;
            assert!((f64::from(got) - want).abs() < 0.8, "{value:?}: {got} {want}");
        }
    }
    // What is lit by what it is made for looks as it is: a base colour and the four hundredths that it mirrors.
    let shown = tone::neutral([0.54, 0.34, 0.24]);
    assert!(shown.iter().zip([0.5, 0.3, 0.2]).all(|(got, want)| (got - want).abs() < 1e-12));
}

#[test]
fn dithered_gradients_have_no_bands_and_their_mean() {
    let (width, height) = (128, 64);
    let Some(mut h) = headless(width, height) else { return };
    let camera = Pose::look_at(DVec3::ZERO, DVec3::NEG_Z, DVec3::Y, 0.1);
    let mut frame = Frame::new(camera, &[]);
    for value in [0.0302_f32, 0.0304, 0.0307] {
        let all = glam::Vec3::splat(value);
        let plain = PlainSky { zenith: all, horizon: all, ground: all, ..PlainSky::default() };
        frame.environment.sky = Sky::Plain(plain);
        h.frame(&frame).unwrap();
        let stored: Vec<half::f16> =
            bytemuck::pod_collect_to_vec(&h.intermediate(Resource::Radiance, 8).unwrap());
        let exact = tone::encode_srgb(tone::filmic(stored[0].to_f64())) * 255.0;
        let picture = h.picture().unwrap();
        let shown = || picture.pixels().map(|pixel| f64::from(pixel[0]));
        let mean = shown().sum::<f64>() / f64::from(width * height);
        assert!((mean - exact).abs() < 0.02, "{mean} {exact}");
        assert!(shown().all(|x| (x - exact).abs() <= 1.0));
    }
}

#[test]
fn occlusion_matches_its_twin() {
    let (width, height) = (160, 90);
    let Some(mut h) = headless(width, height) else { return };
    let box_ = asset(&h, &cube(), Material::default());
    let ball = asset(&h, &sphere(24), Material::default());
    let drawables = [
        Drawable { asset: &box_, instances: &[at(0.0, -1.0, 0.0, 2.0), at(0.3, 0.25, 0.3, 0.5)] },
        Drawable { asset: &ball, instances: &[at(-0.4, 0.3, 0.2, 0.6)] },
    ];
    let camera = Pose::look_at(DVec3::new(0.6, 1.3, 2.2), DVec3::new(0.0, 0.1, 0.0), DVec3::Y, 0.8);
    let mut frame = Frame::new(camera, &drawables);
    for (method, samples) in OcclusionMethod::ALL.into_iter().flat_map(|method| [(method, 16), (method, 8)]) {
        let radius = OcclusionRadius::World(0.3);
        frame.settings.occlusion =
            Some(AmbientOcclusion { method, radius, strength: 1.0, samples, still: None });
        h.frame(&frame).unwrap();
        let depth = h.depth().unwrap();
        let raw = h.intermediate(Resource::OcclusionRaw, 1).unwrap();
        let (tx, ty) = camera.tan_half_fov(width, height);
        let picture = DepthPicture {
            stored: &depth,
            size_px: [width, height],
            tan_half_fov: [tx, ty],
            near: frame.settings.near,
        };
        let twin = occlusion::Occlusion {
            picture,
            method,
            radius: (0.3, 0.0),
            samples: samples as usize,
            turned: 0,
        };
        let (mut sum, mut different, mut darkest) = (0.0, 0, 1.0f64);
        for (i, value) in raw.iter().enumerate() {
            let pixel = [(i % width as usize) as i64, (i / width as usize) as i64];
            let want = twin.openness(pixel, 1.0);
            let difference = (f64::from(*value) / 255.0 - want).abs();
            sum += difference;
            // Samples that land on a pixel's border or a threshold may go either way in f32.
            different += usize::from(difference > 0.01);
            darkest = darkest.min(want);
        }
        let mean = sum / raw.len() as f64;
        // Layers see nothing within four pixels, of the radius' dozen.
        let corner = if method == OcclusionMethod::HbaoPlus { 0.8 } else { 0.75 };
        assert!(darkest < corner, "the scene has no corner: {darkest}");
        assert!(
            mean < 0.004 && different * 50 < raw.len(),
            "{} {samples}: mean {mean}, {different} pixels differ",
            method.name()
        );
    }
}

#[test]
fn smoothed_edges_match_their_twin_and_come_nearer_to_the_truth() {
    const FINER: u32 = 8;
    let size = (120, 68);
    let Some(mut h) = headless(size.0, size.1) else { return };
    let Some(mut fine) = headless(size.0 * FINER, size.1 * FINER) else { return };
    let camera = Pose::look_at(DVec3::new(0.6, 1.3, 2.2), DVec3::new(0.0, 0.1, 0.0), DVec3::Y, 0.8);
    let scene = |h: &mut Headless, anti_aliasing: AntiAliasing| {
        let box_ = asset(h, &cube(), Material::default());
        let ball = asset(h, &sphere(24), Material { base_colour: [0.1, 0.2, 0.5], ..Material::default() });
        let drawables = [
            Drawable { asset: &box_, instances: &[at(0.0, -1.0, 0.0, 2.0), at(0.3, 0.25, 0.3, 0.5)] },
            Drawable { asset: &ball, instances: &[at(-0.4, 0.3, 0.2, 0.6)] },
        ];
        let mut frame = Frame::new(camera, &drawables);
        frame.settings.anti_aliasing = anti_aliasing;
        h.frame(&frame).unwrap();
        h.picture().unwrap()
    };
    let stairs = scene(&mut h, AntiAliasing::None);
    let smooth = scene(&mut h, AntiAliasing::Spatial);
    keep(&h, "smoothed-edges");
    let display = h.intermediate(Resource::Display, 4).unwrap();
    let pixels: Vec<[f64; 3]> =
        display.chunks(4).map(|p| std::array::from_fn(|c| f64::from(p[c]) / 255.0)).collect();
    let twin = antialias::Display { pixels: &pixels, size_px: [size.0, size.1] };
    let truth = scene(&mut fine, AntiAliasing::None);
    // As much light as the pixels that lie in one give together.
    let mean = |x: u32, y: u32, c: usize| {
        let of = |i: u32| truth.get_pixel(x * FINER + i % FINER, y * FINER + i / FINER)[c];
        let light = |i: u32| tone::decode_srgb(f64::from(of(i)) / 255.0);
        tone::encode_srgb((0..FINER * FINER).map(light).sum::<f64>() / f64::from(FINER * FINER))
    };
    let (mut different, mut before, mut after) = (0, 0.0, 0.0);
    for (x, y, pixel) in smooth.enumerate_pixels() {
        let want = twin.smoothed([i64::from(x), i64::from(y)]);
        for c in 0..3 {
            let got = f64::from(pixel[c]) / 255.0;
            different += usize::from((got - want[c]).abs() > 1.5 / 255.0);
            let mean = mean(x, y, c);
            after += (got - mean).powi(2);
            before += (f64::from(stairs.get_pixel(x, y)[c]) / 255.0 - mean).powi(2);
        }
    }
    assert!(different * 300 < pixels.len() * 3, "{different} values differ from the twin's");
    // The errors' squares, of which edges have nearly all.
    assert!(after < 0.6 * before, "{before} {after}");
}

/// The unit square in the plane z = 0 under bricks this deep. Its colours say where on it they lie, 256 steps along u and
/// v.
fn wall_of_coordinates(h: &Headless, relief_depth: f32) -> AssetGpu {
    const SIZE: u32 = 64;
    let shape = |kind, size| TextureShape::full(size, size, kind);
    let material = Material {
        base_colour: [1.0; 3],
        relief_depth,
        colour_texture: Some(0),
        height_texture: Some(1),
        ..Material::default()
    };
    let shapes = [shape(TextureKind::Colour, 256), shape(TextureKind::Height, SIZE)];
    let mut wall = h.renderer().create_asset(h.gpu(), DVec3::ZERO, &[material], &shapes);
    fill(h, &mut wall, &quad([0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], 1.0));
    for level in 0..shapes[0].levels {
        let (w, rows) = shapes[0].level_size(level);
        // Means of the texels that a coarser one covers.
        let mean = |k: u32, n: u32| (k * (256 / n) + (256 / n - 1) / 2) as u8;
        let texel = |i: u32| [mean(i % w, w), mean(i / w, rows), 0, 255];
        let pixels: Vec<u8> = (0..w * rows).flat_map(texel).collect();
        wall.update_texture(h.gpu(), 0, level, TextureData::Rgba8(&pixels)).unwrap();
    }
    for (level, heights) in mips16(&bricks(SIZE as usize)).iter().enumerate() {
        wall.update_texture(h.gpu(), 1, level as u32, TextureData::R16(heights)).unwrap();
    }
    wall
}

/// What a frame shows of [`wall_of_coordinates`]: for each pixel of it the ray from the eye, where that meets the wall, and
/// the place that is shown there, both in texture coordinates.
fn places(
    h: &mut Headless,
    wall: &AssetGpu,
    camera: Pose,
    settings: Settings,
) -> Vec<(DVec3, [f64; 2], [f64; 2])> {
    let drawables = [Drawable { asset: wall, instances: &[Instance::default()] }];
    h.frame(&Frame { settings, ..Frame::new(camera, &drawables) }).unwrap();
    let (width, height) = h.size();
    let covered = h.coverage().unwrap();
    let albedo = h.intermediate(Resource::Albedo, 4).unwrap();
    let (tx, ty) = camera.tan_half_fov(width, height);
    let seen = covered.iter().enumerate().filter(|(_, covered)| **covered).map(|(i, _)| {
        let pixel = [(i % width as usize) as i64, (i / width as usize) as i64];
        let ray = (camera.rotation * DVec3::from(view_ray(pixel, [width, height], [tx, ty]))).normalize();
        let p = camera.eye + ray * (-camera.eye.z / ray.z);
        // Texel centre k holds the value k: undo the half texel. Texture space: v down.
        let got = [0, 1].map(|c| (f64::from(albedo[i * 4 + c]) + 0.5) / 256.0);
        (ray, [p.x, 1.0 - p.y], got)
    });
    seen.collect()
}

#[test]
fn relief_matches_its_twin_and_the_exact_hit() {
    let Some(mut h) = headless(128, 96) else { return };
    let map = bricks(64);
    // Deep, so that a search without its binary part would be off by more than a colour step.
    let relief_depth = 0.3f32;
    let wall = wall_of_coordinates(&h, relief_depth);
    let camera = Pose::look_at(DVec3::new(0.9, 0.75, 0.35), DVec3::new(0.45, 0.5, 0.0), DVec3::Y, 0.5);
    let (mut n, mut off_twin, mut off_exact, mut moved) = (0, 0, 0, 0);
    for (ray, start, got) in places(&mut h, &wall, camera, Settings::default()) {
        let cosine = -ray.z;
        let reach = reach(f64::from(relief_depth), cosine);
        let span = [ray.x * reach, -ray.y * reach];
        let uv = |s: f64| [0, 1].map(|a| start[a] + span[a] * s);
        let traced = uv(map.trace(start, span, steps(Settings::default().relief_steps, cosine)));
        let exact = uv(map.intersect(start, span));
        let inside = |q: [f64; 2]| q.iter().all(|x| (0.02..0.98).contains(x));
        if !inside(got) || !inside(traced) || !inside(exact) {
            continue;
        }
        let apart = |a: [f64; 2]| (a[0] - got[0]).hypot(a[1] - got[1]);
        n += 1;
        // Two steps of the 8-bit coordinates.
        off_twin += usize::from(apart(traced) > 2.0 / 256.0);
        off_exact += usize::from(apart(exact) > 2.5 / 256.0);
        moved += usize::from(apart(start) > 4.0 / 256.0);
    }
    keep(&h, "relief-accuracy");
    assert!(n > 3000, "only {n} pixels to compare");
    assert!(moved * 4 > n, "relief moved only {moved} of {n} pixels");
    assert!(off_twin * 500 < n, "{off_twin} of {n} pixels off the twin");
    // Linear steps jump over some crests, which this deep a relief has at every joint.
    assert!(off_exact * 20 < n, "{off_exact} of {n} pixels off the exact hit");
}

#[test]
fn each_way_of_relief_matches_its_twin() {
    let Some(mut h) = headless(128, 96) else { return };
    let map = Prepared::new(bricks(64));
    let depth = 0.15;
    let wall = wall_of_coordinates(&h, depth as f32);
    let camera = Pose::look_at(DVec3::new(0.9, 0.75, 0.35), DVec3::new(0.45, 0.5, 0.0), DVec3::Y, 0.5);
    // Few enough that terraces are wider than a step of the colours.
    let relief_steps = 12;
    for way in ReliefMethod::ALL {
        let twin = match way {
            ReliefMethod::Parallax => Method::Parallax,
            ReliefMethod::SteepParallax => Method::SteepParallax,
            ReliefMethod::ParallaxOcclusion => Method::ParallaxOcclusion,
            ReliefMethod::Relief => Method::Relief,
        };
        let settings = Settings { relief_method: way, relief_steps, ..Settings::default() };
        let seen = places(&mut h, &wall, camera, settings);
        keep(&h, &format!("relief-way-{}", way.name()));
        // Off each twin, its own first.
        let mut off = [(twin, 0), (Method::None, 0), (Method::SteepParallax, 0), (Method::Relief, 0)];
        let mut n = 0;
        for (ray, start, got) in seen {
            let cosine = -ray.z;
            let reach = reach(depth, cosine);
            let ray = Ray { start, span: [ray.x * reach, -ray.y * reach], cosine };
            // A limited offset is divided by the whole way, which the twin's ray is for less.
            let ray_of = |method| match method {
                Method::Parallax => Ray { cosine: depth / reach, ..ray },
                _ => ray,
            };
            let places = off.map(|(method, _)| {
                let ray = ray_of(method);
                ray.at(method.find(&map, &ray, steps(relief_steps, cosine)).at)
            });
            let inside = |q: &[f64; 2]| q.iter().all(|x| (0.02..0.98).contains(x));
            if !inside(&got) || !places.iter().all(inside) {
                continue;
            }
            n += 1;
            for (off, place) in off.iter_mut().zip(places) {
                off.1 += usize::from((place[0] - got[0]).hypot(place[1] - got[1]) > 2.0 / 256.0);
            }
        }
        assert!(n > 3000, "only {n} pixels to compare");
        assert!(off[0].1 * 100 < n, "{}: {} of {n} pixels off the twin", way.name(), off[0].1);
        for (other, off) in &off[1..] {
            assert!(
                *other == twin || off * 10 > n,
                "{} draws {}: {off} of {n} differ",
                way.name(),
                other.name()
            );
        }
    }
}

#[test]
fn bricks_do_not_swim_along_a_wall_that_is_seen_ever_more_from_its_side() {
    let Some(mut h) = headless(160, 120) else { return };
    let depth = 0.04;
    let wall = wall_of_coordinates(&h, depth as f32);
    let middle = DVec3::new(0.5, 0.5, 0.0);
    for degrees in [30.0, 55.0, 70.0, 80.0, 86.0_f64] {
        let (sine, cosine) = degrees.to_radians().sin_cos();
        let camera = Pose::look_at(middle + DVec3::new(sine, 0.0, cosine) * 4.0, middle, DVec3::Y, 0.2);
        let seen = places(&mut h, &wall, camera, Settings::default());
        keep(&h, &format!("relief-{degrees}"));
        let far = |[x, y]: &[f64; 2]| (0.3..0.7).contains(x) && (0.3..0.7).contains(y);
        let shifts: Vec<f64> = seen
            .iter()
            .filter(|(_, from, _)| far(from))
            .map(|(_, from, to)| (to[0] - from[0]).hypot(to[1] - from[1]) / depth)
            .collect();
        let most = shifts.iter().fold(0.0_f64, |a, b| a.max(*b));
        let mean = shifts.iter().sum::<f64>() / shifts.len() as f64;
        println!("{degrees}: along the wall by {mean:.2} depths in the mean, {most:.2} at most");
        // A step of the colours, and what a footprint of them is rounded to.
        let rounding = 1.5 / 256.0 / depth;
        assert!(
            shifts.len() > 100 && most < degrees.to_radians().tan().min(2.0) + rounding,
            "{degrees}: {most}"
        );
    }
}

/// IEEE 754 binary16 to f64.
fn half(bits: u16) -> f64 {
    let (exponent, fraction) = (i32::from(bits >> 10 & 31), f64::from(bits & 1023) / 1024.0);
    let size =
        if exponent == 0 { fraction * 2f64.powi(-14) } else { (1.0 + fraction) * 2f64.powi(exponent - 15) };
    if bits >> 15 == 1 { -size } else { size }
}

#[test]
fn relief_normals_follow_the_height_map_on_any_placement() {
    const SIZE: u32 = 64;
    let (width, height) = (64, 64);
    let Some(mut h) = headless(width, height) else { return };
    let depth = 0.25;
    let material = Material { relief_depth: depth as f32, height_texture: Some(0), ..Material::default() };
    let shape = TextureShape { levels: 1, ..TextureShape::full(SIZE, SIZE, TextureKind::Height) };
    // Heights rise to the right, or downwards in the picture (v up: they fall with v).
    for (direction, want) in [(0, [-depth, 0.0, 1.0]), (1, [0.0, depth, 1.0])] {
        let ramp = |i: u32| (if direction == 0 { i % SIZE } else { i / SIZE }) * 65_535 / SIZE;
        let heights: Vec<u16> = (0..SIZE * SIZE).map(|i| ramp(i) as u16).collect();
        let mut wall = h.renderer().create_asset(h.gpu(), DVec3::ZERO, &[material], &[shape]);
        fill(&h, &mut wall, &quad([-0.5, -0.5, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], 1.0));
        wall.update_texture(h.gpu(), 0, 0, TextureData::R16(&heights)).unwrap();
        for instance in [
            Instance::default(),
            Instance {
                translation: DVec3::new(100.0, -3.0, 7.0),
                rotation: glam::DQuat::from_axis_angle(DVec3::new(1.0, 2.0, -0.5).normalize(), 1.1),
                scale: 3.0,
            },
        ] {
            let drawables = [Drawable { asset: &wall, instances: &[instance] }];
            let eye = instance.to_world(DVec3::new(0.2, -0.1, 1.3));
            let up = instance.rotation * DVec3::Y;
            let camera = Pose::look_at(eye, instance.to_world(DVec3::ZERO), up, 0.25);
            h.frame(&Frame::new(camera, &drawables)).unwrap();
            let normals = h.intermediate(Resource::Normal, 8).unwrap();
            let pixel = &normals[((height / 2 * width + width / 2) * 8) as usize..];
            let stored = [0, 1].map(|c| half(u16::from_le_bytes([pixel[2 * c], pixel[2 * c + 1]])));
            let got = brdf::from_octahedral(stored);
            let want = instance.rotation * DVec3::from(want).normalize();
            assert!((DVec3::from(got) - want).length() < 0.01, "{direction}: {got:?} {want}");
        }
    }
}

#[test]
fn srgb_targets_show_the_same_picture() {
    let Some(mut h) = headless(64, 64) else { return };
    let format = wgpu::TextureFormat::Rgba8UnormSrgb;
    let gpu = h.gpu().clone();
    let mut other = Renderer::new(&gpu, format).unwrap();
    let target = gpu.device.create_texture(&wgpu::TextureDescriptor {
        label: None,
        size: wgpu::Extent3d { width: 64, height: 64, depth_or_array_layers: 1 },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format,
        usage: wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::COPY_SRC,
        view_formats: &[],
    });
    let ball = asset(&h, &sphere(24), Material::default());
    let drawables = [Drawable { asset: &ball, instances: &[Instance::default()] }];
    let camera = Pose::look_at(DVec3::new(0.0, 0.0, 2.0), DVec3::ZERO, DVec3::Y, 0.7);
    let frame = Frame::new(camera, &drawables);
    h.frame(&frame).unwrap();
    let mut encoder = gpu.device.create_command_encoder(&Default::default());
    let view = target.create_view(&Default::default());
    other.record(&gpu, &mut encoder, &Target::colour(&view, (64, 64)), &frame).unwrap();
    gpu.queue.submit([encoder.finish()]);
    let encoded = read_texture(&gpu, &target, 4).unwrap();
    let worst = h.picture().unwrap().iter().zip(&encoded).map(|(a, b)| a.abs_diff(*b)).max();
    assert!(worst <= Some(1), "{worst:?}");
}
