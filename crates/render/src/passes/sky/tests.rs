//! Shader functions of the sky against their CPU reference.

use glam::{DVec3, Vec3};

use super::SkyGpu;
use crate::cpu_reference::sky::{Sky as ReferenceSky, environment_brdf, split_sum};
use crate::frame::accumulation::AccumulationStep;
use crate::frame::fullscreen::{fullscreen, fullscreen_pipeline};
use crate::frame::graph::PassId;
use crate::frame::timing::PassEncoder;
use crate::frame::uniforms::FrameUniform;
use crate::passes::gbuffer::shader;
use crate::passes::temporal::TemporalStep;
use crate::resources::descriptors::{texture_2d, uniform_buffer, wgsl};
use crate::resources::gpu::Gpu;
use crate::resources::readback::read_texture;
use crate::tests::headless;
use crate::{Atmosphere, Environment, Frame, GradientSky, Haze, Pose, Sky, Studio};

const SIDE: u32 = 32;
/// The shader's outputs, in the order of pixels.
const SHOWN: [&str; 5] = ["sky", "ambient", "reflected", "split sum", "hazed"];

const SHADER: &str = concat!(
    wgsl!("common", "fullscreen", "sky"),
    "
    @fragment
    fn fs_test(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
        let i = u32(at.y) * 32u + u32(at.x);
        let z = 1.0 - (f32(i) + 0.5) / 512.0;
        let azimuth = f32(i) * 2.4;
        let across = sqrt(max(1.0 - z * z, 0.0));
        let d = vec3(across * cos(azimuth), across * sin(azimuth), z);
        let share = f32(i % 29u) / 28.0;
        switch (i % 5u) {
            case 0u: { return vec4(sky(d), 1.0); }
            case 1u: { return vec4(ambient(d), 1.0); }
            case 2u: { return vec4(reflected(d, share), 1.0); }
            case 3u: { return vec4(environment_brdf(abs(z), share), 0.0, 1.0); }
            default: { return vec4(hazed(vec3(0.5, 0.1, 2.0), d, pow(10.0, 7.0 * share)), 1.0); }
        }
    }"
);

/// The direction of a pixel.
fn direction(i: u32) -> DVec3 {
    let z = 1.0 - (f64::from(i) + 0.5) / 512.0;
    // In f32, as in the shader.
    let (sine, cosine) = f64::from(i as f32 * 2.4f32).sin_cos();
    let across = (1.0 - z * z).max(0.0).sqrt();
    DVec3::new(across * cosine, across * sine, z)
}

/// The results of the shader's functions in an environment.
fn pixels(gpu: &Gpu, sky: &mut SkyGpu, environment: Environment) -> Vec<[f32; 4]> {
    let camera = Pose::look_at(DVec3::ZERO, DVec3::X, DVec3::Z, 1.0);
    let frame = Frame { environment, ..Frame::new(camera, &[]) };
    let light = sky.light(gpu, &environment, None);
    let uniform = FrameUniform::new(
        &frame,
        &light,
        (SIDE, SIDE),
        (SIDE, SIDE),
        &TemporalStep::NONE,
        1.0,
        AccumulationStep::default(),
    );
    let device = &gpu.device;
    let buffer = uniform_buffer::<FrameUniform>(gpu, "frame");
    gpu.queue.write_buffer(&buffer, 0, bytemuck::bytes_of(&uniform));
    let module = shader(gpu, "sky test", SHADER);
    let format = wgpu::TextureFormat::Rgba32Float;
    let pipeline = fullscreen_pipeline(gpu, &module, "fs_test", format.into(), &[]);
    let usage = wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::COPY_SRC;
    let target = device.create_texture(&texture_2d("test", (SIDE, SIDE), format, usage));
    let [seen, lobes, split_sum] = sky.views();
    let entry = |binding, resource| wgpu::BindGroupEntry { binding, resource };
    let view = wgpu::BindingResource::TextureView;
    let group = device.create_bind_group(&wgpu::BindGroupDescriptor {
        label: None,
        layout: &pipeline.get_bind_group_layout(0),
        entries: &[
            entry(0, buffer.as_entire_binding()),
            entry(10, view(&seen)),
            entry(11, view(&lobes)),
            entry(12, wgpu::BindingResource::Sampler(sky.sampler())),
            entry(13, view(&split_sum)),
        ],
    });
    let mut encoder = device.create_command_encoder(&Default::default());
    let into = target.create_view(&Default::default());
    let mut pass = PassEncoder::new(&mut encoder, None);
    fullscreen(&mut pass, PassId::Sky, &pipeline, &group, &crate::Target::colour(&into, (0, 0)));
    gpu.queue.submit([encoder.finish()]);
    gpu.check().unwrap();
    bytemuck::pod_collect_to_vec(&read_texture(gpu, &target, 16).unwrap())
}

fn at(degrees: f64, up: DVec3) -> DVec3 {
    let (sine, cosine) = degrees.to_radians().sin_cos();
    up * sine + up.any_orthonormal_vector() * cosine
}

#[test]
fn the_sky_shader_matches_its_cpu_reference() {
    let Some(h) = headless(4, 4) else { return };
    let mut sky = SkyGpu::new(h.gpu());
    let plain = Sky::Plain(GradientSky::default());
    let tilted = DVec3::new(0.3, -0.5, 0.8).normalize();
    let haze = Some(Haze { visibility: 2e4 });
    let table = split_sum();
    let mut worst = [0.0f64; SHOWN.len()];
    for (kind, up, degrees) in [
        (Sky::Atmosphere(Atmosphere::default()), DVec3::Z, 40.0),
        (Sky::Atmosphere(Atmosphere { aerosol: 40.0, ..Atmosphere::default() }), tilted, 3.0),
        (plain, DVec3::Y, 60.0),
        (Sky::Studio(Studio { key: Vec3::new(0.9, 0.8, 0.6), ground: true }), DVec3::Y, 47.5),
    ] {
        let environment = Environment { to_sun: at(degrees, up), up, sky: kind, haze };
        let got = pixels(h.gpu(), &mut sky, environment);
        let light = sky.light(h.gpu(), &environment, None);
        let map = sky.map().unwrap();
        let cpu_reference = ReferenceSky {
            up: light.up,
            side: light.side,
            to_sun: light.to_sun,
            disc: map.disc,
            disc_radius: super::atmosphere::SUN_RADIUS,
            seen: &map.seen,
            layers: &map.lobes,
            irradiance: map.irradiance,
            haze: f64::from(light.haze),
        };
        for (i, got) in (0..SIDE * SIDE).zip(got) {
            let d = direction(i);
            let share = f64::from(i % 29) / 28.0;
            let want = match i % 5 {
                0 => cpu_reference.sky(d),
                1 => cpu_reference.ambient(d),
                2 => cpu_reference.reflected(d, share),
                3 => DVec3::from([environment_brdf(&table, d.z.abs(), share)].map(|[a, b]| [a, b, 0.0])[0]),
                _ => cpu_reference.hazed(DVec3::new(0.5, 0.1, 2.0), d, 10f64.powf(7.0 * share)),
            };
            let got = Vec3::from_slice(&got[..3]).as_dvec3();
            let off = (got - want).abs().max_element() / (1.0 + want.max_element());
            let kind = &mut worst[i as usize % SHOWN.len()];
            *kind = kind.max(off);
        }
    }
    for (shown, worst) in SHOWN.iter().zip(worst) {
        println!("{shown}: worst {worst:.5}");
        // Textures are f16, filters have eight bits between texels, and azimuths in f32 have lost four digits.
        assert!(worst < 6e-3, "{shown}: {worst}");
    }
}

#[test]
fn nothing_makes_the_sky_not_a_number() {
    let Some(h) = headless(4, 4) else { return };
    let mut sky = SkyGpu::new(h.gpu());
    let strange = Atmosphere {
        aerosol: f32::NAN,
        ground: Vec3::splat(9.0),
        brightness: f32::INFINITY,
        adaptation: -1.0,
    };
    let mut check = |environment: Environment| {
        let all = pixels(h.gpu(), &mut sky, environment);
        assert!(all.iter().flatten().all(|x| x.is_finite() && *x >= -0.01), "{environment:?}");
    };
    for degrees in [90.0, 45.0, 0.5, 0.0, -1.0, -30.0, -90.0] {
        check(Environment { to_sun: at(degrees, DVec3::Y), ..Environment::default() });
    }
    for visibility in [0.0, -1.0, f64::NAN, f64::INFINITY, 1e-300, 1e-3, 1.0, 6.371e6, 1e300] {
        check(Environment { haze: Some(Haze { visibility }), ..Environment::default() });
    }
    for vector in [DVec3::ZERO, DVec3::NAN, DVec3::splat(1e300), DVec3::splat(1e-300), DVec3::NEG_Y] {
        check(Environment { to_sun: vector, ..Environment::default() });
        check(Environment { up: vector, sky: Sky::Atmosphere(strange), ..Environment::default() });
        let studio = Sky::Studio(Studio { key: Vec3::new(f32::NAN, -1.0, 1e30), ground: true });
        check(Environment { up: vector, sky: studio, ..Environment::default() });
    }
}
