//! Shaders against their CPU references in f64.

use glam::DVec3;

use super::shapes::{asset, at, cube, sphere};
use super::{headless, keep};
use crate::cpu_reference::brdf::from_octahedral;
use crate::cpu_reference::surface::DepthPicture;
use crate::cpu_reference::{antialias, occlusion, tone};
use crate::frame::graph::Resource;
use crate::resources::descriptors::texture_2d;
use crate::resources::readback::read_texture;
use crate::{
    AmbientOcclusion, AntiAliasing, Drawable, Frame, GradientSky, Headless, Instance, Material,
    OcclusionMethod, OcclusionNormals, OcclusionRadius, Pose, Renderer, Sky, Target, ToneMapping,
};

#[test]
fn tone_curve_matches_its_cpu_reference() {
    let Some(mut h) = headless(4, 4) else { return };
    let camera = Pose::look_at(DVec3::ZERO, DVec3::NEG_Z, DVec3::Y, 0.1);
    for value in [0.001f32, 0.01, 0.05, 0.18, 0.4, 0.9, 2.0, 7.0] {
        let mut frame = Frame::new(camera, &[]);
        // Make all of the sky one radiance.
        let all = glam::Vec3::splat(value * 0.5);
        frame.environment.sky =
            Sky::Plain(GradientSky { zenith: all, horizon: all, ground: all, ..GradientSky::default() });
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
fn the_neutral_curve_matches_its_cpu_reference_and_keeps_base_colours() {
    let Some(mut h) = headless(4, 4) else { return };
    let camera = Pose::look_at(DVec3::ZERO, DVec3::NEG_Z, DVec3::Y, 0.1);
    for value in [[0.01, 0.02, 0.03], [0.5, 0.3, 0.1], [0.2, 0.9, 0.4], [8.0, 2.0, 0.5], [900.0, 0.0, 5.0]] {
        let mut frame = Frame::new(camera, &[]);
        let colour = glam::DVec3::from(value).as_vec3();
        let plain = GradientSky { zenith: colour, horizon: colour, ground: colour, ..GradientSky::default() };
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
        let plain = GradientSky { zenith: all, horizon: all, ground: all, ..GradientSky::default() };
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

/// The normals that the last frame drew, in view space.
pub(super) fn drawn_normals(h: &Headless, camera: Pose) -> Vec<Option<[f64; 3]>> {
    let stored: Vec<half::f16> = bytemuck::pod_collect_to_vec(&h.intermediate(Resource::Normal, 8).unwrap());
    let of = |texel: &[half::f16]| {
        let [x, y] = [texel[0].to_f64(), texel[1].to_f64()];
        let world = DVec3::from(from_octahedral([x, y]));
        (x <= 1.5).then(|| (camera.rotation.inverse() * world).to_array())
    };
    stored.chunks(4).map(of).collect()
}

/// Holds the last frame's occlusion, as the light gets it, against what its estimate comes to.
pub(super) fn blur_matches_its_cpu_reference(h: &Headless, cpu_reference: &occlusion::Blur<'_>) {
    let blurred = h.intermediate(Resource::Occlusion, 1).unwrap();
    let width = cpu_reference.picture.size_px[0] as usize;
    let off = blurred.iter().enumerate().filter(|(i, got)| {
        let want = cpu_reference.openness([(i % width) as i64, (i / width) as i64]);
        // Half a step, and what rounding in f32 leaves.
        (f64::from(**got) / 255.0 - want).abs() > 0.51 / 255.0
    });
    let off = off.count();
    // Neighbours that are as much deeper as occlusion reaches may count or not.
    assert!(off * 1000 <= blurred.len(), "{off} of {} pixels are off the CPU reference", blurred.len());
}

#[test]
fn occlusion_matches_its_cpu_reference() {
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
    let ways = |method| {
        [(16, OcclusionNormals::Nearest)]
            .into_iter()
            .chain(OcclusionNormals::ALL.map(|normals| (8, normals)))
            .map(move |(samples, normals)| (method, samples, normals))
    };
    for (method, samples, normals) in OcclusionMethod::ALL.into_iter().flat_map(ways) {
        let radius = OcclusionRadius::World(0.3);
        frame.settings.occlusion = Some(AmbientOcclusion {
            method,
            radius,
            strength: 1.0,
            samples,
            normals,
            ..AmbientOcclusion::default()
        });
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
        let drawn = drawn_normals(&h, camera);
        let cpu_reference = occlusion::Occlusion {
            picture,
            method,
            normals: match normals {
                OcclusionNormals::Nearest => occlusion::Normals::Nearest,
                OcclusionNormals::Drawn => occlusion::Normals::Drawn(&drawn),
                OcclusionNormals::Extended => occlusion::Normals::Extended,
            },
            radius: (0.3, 0.0),
            samples: samples as usize,
            turned: None,
        };
        let (mut sum, mut different, mut darkest) = (0.0, 0, 1.0f64);
        for (i, value) in raw.iter().enumerate() {
            let pixel = [(i % width as usize) as i64, (i / width as usize) as i64];
            let want = cpu_reference.openness(pixel, 1.0);
            let difference = (f64::from(*value) / 255.0 - want).abs();
            sum += difference;
            // Samples that land on a pixel's border or a threshold may go either way in f32.
            different += usize::from(difference > 0.01);
            darkest = darkest.min(want);
        }
        let mean = sum / raw.len() as f64;
        // Layers see nothing within four pixels, of the radius' dozen.
        let corner = if method == OcclusionMethod::HbaoPlus { 0.82 } else { 0.75 };
        assert!(darkest < corner, "the scene has no corner: {darkest}");
        assert!(
            mean < 0.004 && different * 50 < raw.len(),
            "{} {samples} {normals:?}: mean {mean}, {different} pixels differ",
            method.name()
        );
        let raw: Vec<f64> = raw.iter().map(|value| f64::from(*value) / 255.0).collect();
        blur_matches_its_cpu_reference(
            &h,
            &occlusion::Blur { picture, raw: &raw, radius: (f64::from(0.3_f32), 0.0), number: 0 },
        );
    }
}

#[test]
fn smoothed_edges_match_their_cpu_reference_and_come_nearer_to_the_truth() {
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
    let cpu_reference = antialias::Display { pixels: &pixels, size_px: [size.0, size.1] };
    let truth = scene(&mut fine, AntiAliasing::None);
    // As much light as the pixels that lie in one give together.
    let mean = |x: u32, y: u32, c: usize| {
        let of = |i: u32| truth.get_pixel(x * FINER + i % FINER, y * FINER + i / FINER)[c];
        let light = |i: u32| tone::decode_srgb(f64::from(of(i)) / 255.0);
        tone::encode_srgb((0..FINER * FINER).map(light).sum::<f64>() / f64::from(FINER * FINER))
    };
    let (mut different, mut before, mut after) = (0, 0.0, 0.0);
    for (x, y, pixel) in smooth.enumerate_pixels() {
        let want = cpu_reference.smoothed([i64::from(x), i64::from(y)]);
        for c in 0..3 {
            let got = f64::from(pixel[c]) / 255.0;
            different += usize::from((got - want[c]).abs() > 1.5 / 255.0);
            let mean = mean(x, y, c);
            after += (got - mean).powi(2);
            before += (f64::from(stairs.get_pixel(x, y)[c]) / 255.0 - mean).powi(2);
        }
    }
    assert!(different * 300 < pixels.len() * 3, "{different} values differ from the CPU reference's");
    // The errors' squares, of which edges have nearly all.
    assert!(after < 0.6 * before, "{before} {after}");
}

#[test]
fn srgb_targets_show_the_same_picture() {
    let Some(mut h) = headless(64, 64) else { return };
    let format = wgpu::TextureFormat::Rgba8UnormSrgb;
    let gpu = h.gpu().clone();
    let mut other = Renderer::new(&gpu, format).unwrap();
    let usage = wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::COPY_SRC;
    let target = gpu.device.create_texture(&texture_2d("picture", (64, 64), format, usage));
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
