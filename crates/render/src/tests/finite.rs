//! What is no number, or infinite, in a history or in what a frame adds to it: it is gone with the next frame.

use glam::DVec3;
use half::f16;

use super::headless;
use super::shapes::{asset, at, cube, quad, sphere};
use crate::frame::accumulation::AccumulationStep;
use crate::frame::camera::{clip_from_view, view_from_world};
use crate::frame::graph::Resource;
use crate::frame::targets::RADIANCE;
use crate::frame::timing::PassEncoder;
use crate::frame::uniforms::FrameUniform;
use crate::image_compare::compare;
use crate::passes::sky::SkyGpu;
use crate::passes::temporal::{Resolve, TemporalStep};
use crate::resources::descriptors::{texture_2d, uniform_buffer};
use crate::resources::readback::read_texture;
use crate::{
    AntiAliasing, AssetGpu, Drawable, Environment, Frame, GradientSky, Headless, Instance, Material, Pose,
    Settings, Sky,
};

const SIZE: (u32, u32) = (72, 48);

struct Scene {
    box_: AssetGpu,
    ball: AssetGpu,
    floor: AssetGpu,
}

impl Scene {
    fn new(h: &Headless) -> Self {
        let of = |mesh, base_colour| asset(h, mesh, Material { base_colour, ..Material::default() });
        Self {
            box_: of(&cube(), [0.8; 3]),
            ball: of(&sphere(16), [0.1, 0.3, 0.6]),
            floor: of(&quad([-4.0, -0.5, 2.0], [8.0, 0.0, 0.0], [0.0, 0.0, -6.0], 1.0), [0.5; 3]),
        }
    }

    /// Draws a frame of which camera and ball have come so far.
    fn draw(&self, h: &mut Headless, moved: f64, settings: Settings, environment: Environment) {
        let drawables = [
            Drawable { asset: &self.box_, instances: &[at(-0.6, 0.0, 0.0, 1.0)] },
            Drawable { asset: &self.ball, instances: &[at(0.6 + moved, 0.1, 0.3, 0.8)] },
            Drawable { asset: &self.floor, instances: &[Instance::default()] },
        ];
        let eye = DVec3::new(0.4 + moved, 0.9, 2.6);
        let camera = Pose::look_at(eye, DVec3::new(moved, 0.2, 0.0), DVec3::Y, 0.8);
        h.frame(&Frame { settings, environment, ..Frame::new(camera, &drawables) }).unwrap();
    }
}

fn settings() -> Settings {
    Settings { anti_aliasing: AntiAliasing::Temporal, ..Settings::default() }
}

fn texels(h: &Headless, resource: Resource) -> Vec<[f32; 4]> {
    let bytes = h.intermediate(resource, 8).expect("the frame has it");
    let values: Vec<f16> = bytemuck::pod_collect_to_vec(&bytes);
    values.chunks(4).map(|texel| std::array::from_fn(|i| texel[i].to_f32())).collect()
}

fn all_finite(h: &Headless) -> bool {
    texels(h, Resource::History).iter().flatten().all(|x| x.is_finite())
}

/// Fills the history that the next frame goes on from.
fn poison(h: &Headless, value: f64) {
    let texture = h.renderer().intermediate(Resource::History).expect("there is one");
    let view = texture.create_view(&Default::default());
    let colour = wgpu::Color { r: value, g: value, b: value, a: value };
    let mut encoder = h.gpu().device.create_command_encoder(&Default::default());
    drop(encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
        label: Some("poison"),
        color_attachments: &[Some(crate::frame::fullscreen::attachment(&view, wgpu::LoadOp::Clear(colour)))],
        ..Default::default()
    }));
    h.gpu().queue.submit([encoder.finish()]);
}

/// A value that is none stayed in the mean of a picture that stands, and spread under one that moves.
#[test]
fn a_history_that_is_not_finite_is_dropped() {
    let (Some(mut h), Some(mut fresh)) = (headless(SIZE.0, SIZE.1), headless(SIZE.0, SIZE.1)) else { return };
    let (scene, other) = (Scene::new(&h), Scene::new(&fresh));
    for speed in [0.0, 0.02] {
        other.draw(&mut fresh, 4.0 * speed, settings(), Environment::default());
        let want = fresh.picture().unwrap();
        for value in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            (0..4).for_each(|i| scene.draw(&mut h, f64::from(i) * speed, settings(), Environment::default()));
            poison(&h, value);
            assert!(!all_finite(&h), "{value} can be in a history");
            for frame in 4..8 {
                scene.draw(&mut h, f64::from(frame) * speed, settings(), Environment::default());
                assert!(all_finite(&h), "{value}, moving by {speed}: frame {frame}");
                if frame == 4 {
                    // As where there was no frame before, but through other points of its pixels.
                    assert!(texels(&h, Resource::History).iter().all(|texel| texel[3] == 1.0));
                    let found = compare(&h.picture().unwrap(), &want, None).unwrap();
                    assert!(found.mean_difference < 4.0, "{value}, moving by {speed}: {found:?}");
                }
            }
        }
    }
}

#[test]
fn a_nan_exposure_leaves_no_trace() {
    let Some(mut h) = headless(SIZE.0, SIZE.1) else { return };
    let scene = Scene::new(&h);
    scene.draw(&mut h, 0.0, settings(), Environment::default());
    let none = Settings { exposure: f32::NAN, ..settings() };
    scene.draw(&mut h, 0.0, none, Environment::default());
    assert!(all_finite(&h));
    scene.draw(&mut h, 0.0, settings(), Environment::default());
    let lit = h.picture().unwrap().pixels().filter(|pixel| pixel[0] > 20).count();
    assert!(all_finite(&h) && lit * 10 > (SIZE.0 * SIZE.1) as usize * 9, "{lit} pixels are lit");
}

/// Sides of what the pass alone is given.
const SIDE: u32 = 16;

/// Radiance and an old history in, the new history out.
fn resolved(h: &Headless, [radiance, old]: [&[[f32; 4]]; 2], still: bool) -> Vec<[f32; 4]> {
    let (gpu, size) = (h.gpu(), (SIDE, SIDE));
    let texture = |format, values: &[[f32; 4]]| {
        let usage = wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST;
        let texture = gpu.device.create_texture(&texture_2d("values", size, format, usage));
        if !values.is_empty() {
            let texels: Vec<[f16; 4]> = values.iter().map(|texel| texel.map(f16::from_f32)).collect();
            let layout = wgpu::TexelCopyBufferLayout {
                offset: 0,
                bytes_per_row: Some(SIDE * 8),
                rows_per_image: None,
            };
            let into = texture.as_image_copy();
            gpu.queue.write_texture(into, bytemuck::cast_slice(&texels), layout, texture.size());
        }
        texture
    };
    let radiance = texture(RADIANCE, radiance);
    let old = texture(RADIANCE, old);
    // All of it sky: a camera that stands moves nothing.
    let depth = texture(wgpu::TextureFormat::R32Float, &[]);
    let camera = Pose::look_at(DVec3::Z, DVec3::ZERO, DVec3::Y, 0.8);
    let environment = Environment { sky: Sky::Plain(GradientSky::default()), ..Environment::default() };
    let frame = Frame { environment, ..Frame::new(camera, &[]) };
    let before = clip_from_view(&camera, frame.settings.near, size) * view_from_world(&camera);
    let step = TemporalStep { before, history: 6.0, still, ..TemporalStep::NONE };
    let sky = SkyGpu::new(gpu).light(gpu, &environment, None);
    let uniform = FrameUniform::new(&frame, &sky, size, size, &step, 1.0, AccumulationStep::default());
    let buffer = uniform_buffer::<FrameUniform>(gpu, "frame");
    gpu.queue.write_buffer(&buffer, 0, bytemuck::bytes_of(&uniform));
    let resolve = Resolve::new(gpu);
    let new = resolve.history(gpu, size);
    let mut encoder = gpu.device.create_command_encoder(&Default::default());
    let [radiance, depth] = [radiance, depth].map(|texture| texture.create_view(&Default::default()));
    let mut passes = PassEncoder::new(&mut encoder, None);
    resolve.record(gpu, &mut passes, &buffer, (&radiance, &depth, None), [&old, &new]);
    gpu.queue.submit([encoder.finish()]);
    let values: Vec<f16> = bytemuck::pod_collect_to_vec(&read_texture(gpu, &new, 8).unwrap());
    values.chunks(4).map(|texel| std::array::from_fn(|i| texel[i].to_f32())).collect()
}

#[test]
fn single_nan_values_neither_persist_nor_spread() {
    let Some(h) = headless(SIDE, SIDE) else { return };
    let [x, y] = [7, 5_usize];
    let spot = y * SIDE as usize + x;
    // A grey that both agree on: half of it after it was weighed.
    let even = |colour: [f32; 4]| vec![colour; (SIDE * SIDE) as usize];
    let (radiance, old) = (even([1.0, 1.0, 1.0, 0.0]), even([0.5, 0.5, 0.5, 4.0]));
    for still in [true, false] {
        let good = resolved(&h, [&radiance, &old], still);
        assert!(good.iter().all(|t| (t[0] - 0.5).abs() < 1e-3 && t[3] == 5.0), "{still}: {:?}", good[spot]);
        for value in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            let mut bad = old.clone();
            bad[spot][1] = value;
            let got = resolved(&h, [&radiance, &bad], still);
            // There the frame alone counts, and around it as far as a lookup may reach.
            assert!(got.iter().all(|t| (t[1] - 0.5).abs() < 1e-3), "{value} {still}: {got:?}");
            assert_eq!(got[spot][3], 1.0, "{value} {still}");
            let far = got.iter().enumerate().filter(|(i, texel)| {
                let at = [i % SIDE as usize, i / SIDE as usize];
                at[0].abs_diff(x).max(at[1].abs_diff(y)) > if still { 0 } else { 3 } && texel[3] != 5.0
            });
            assert_eq!(far.count(), 0, "{value} {still}: it spreads");
        }
        let mut bad = radiance.clone();
        bad[spot][2] = f32::NAN;
        let got = resolved(&h, [&bad, &old], still);
        assert!(got.iter().all(|t| (t[2] - 0.5).abs() < 1e-3), "{still}: {got:?}");
        assert_eq!(got[spot][3], 4.0, "{still}: what is no number adds nothing");
        // Infinite light is as bright as can be.
        bad[spot] = [f32::INFINITY; 4];
        let got = resolved(&h, [&bad, &old], still);
        assert!(
            got.iter().flatten().all(|x| x.is_finite()) && got[spot][0] > 0.5,
            "{still}: {:?}",
            got[spot]
        );
    }
}
