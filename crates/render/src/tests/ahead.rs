//! Work done before the first frame, so that the frame does not wait for it.

use glam::DVec3;

use super::headless;
use super::shapes::{asset, at, sphere};
use super::terrain::{entry, scene};
use crate::resources::descriptors::texture_2d;
use crate::{
    AmbientOcclusion, AntiAliasing, Drawable, Environment, Frame, Gpu, Ink, Material, PnTriangles, Pose,
    Renderer, Settings, Shadows, SkyMaps, Target, TileSource, Water,
};

const SIDE: u32 = 64;
const FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba8Unorm;

/// Settings of all kinds that a window uses.
fn kinds() -> Vec<Settings> {
    let full = Settings::default();
    vec![
        full,
        Settings { anti_aliasing: AntiAliasing::Temporal, ..full },
        Settings { anti_aliasing: AntiAliasing::None, relief: false, ..full },
        Settings { shadows: None, occlusion: None, ..full },
        Settings { wireframe: true, water: false, ..full },
        Settings {
            pn_triangles: Some(PnTriangles::default()),
            anti_aliasing: AntiAliasing::Temporal,
            ..full
        },
        Settings { ink: Some(Ink::default()), pn_triangles: Some(PnTriangles::default()), ..full },
        // The first settings of a slow device.
        Settings {
            render_scale: 0.25,
            occlusion: None,
            shadows: Some(Shadows { cascades: 2, ..Shadows::default() }),
            ..full
        },
        Settings {
            render_scale: 0.5,
            occlusion: Some(AmbientOcclusion { samples: 4, ..AmbientOcclusion::default() }),
            ..full
        },
    ]
}

fn picture(gpu: &Gpu) -> wgpu::Texture {
    let usage = wgpu::TextureUsages::RENDER_ATTACHMENT;
    gpu.device.create_texture(&texture_2d("picture", (SIDE, SIDE), FORMAT, usage))
}

fn record(gpu: &Gpu, renderer: &mut Renderer, frame: &Frame<'_>) {
    let target = picture(gpu);
    let view = target.create_view(&Default::default());
    let mut encoder = gpu.device.create_command_encoder(&Default::default());
    let counters = renderer.record(gpu, &mut encoder, &Target::colour(&view, (SIDE, SIDE)), frame).unwrap();
    assert!(counters.terrain_triangles > 0 && counters.triangles > counters.terrain_triangles);
    gpu.queue.submit([encoder.finish()]);
}

/// All pipelines of the settings, the terrain's included, are compiled ahead and none while a frame is recorded.
#[test]
fn compiler_covers_all_pipelines_of_the_settings() {
    let Some(h) = headless(SIDE, SIDE) else { return };
    let gpu = h.gpu();
    let ball = asset(&h, &sphere(8), Material::default());
    let drawables = [Drawable { asset: &ball, instances: &[at(0.0, 60.0, 10.0, 12.0)] }];
    let camera = Pose::look_at(DVec3::new(60.0, 140.0, 130.0), DVec3::new(0.0, -8.0, 10.0), DVec3::Y, 0.9);
    let mut ground = scene(&h, &entry(3));
    ground.prepare(gpu, &TileSource::Immediate, &camera, (SIDE, SIDE), 2.0).unwrap();
    let water = Some(Water { level: -5.0, clarity: 3.0, ripples: 2.0 });
    for settings in kinds() {
        let frame =
            Frame { terrain: Some(ground.frame()), water, settings, ..Frame::new(camera, &drawables) };
        let mut lazy = Renderer::without_pipelines(gpu, FORMAT).unwrap();
        let before = gpu.compiled_pipelines();
        record(gpu, &mut lazy, &frame);
        let needed = gpu.compiled_pipelines() - before;
        assert!(needed > 4, "a frame needs some: {needed}");

        let mut renderer = Renderer::without_pipelines(gpu, FORMAT).unwrap();
        let compiler = renderer.compiler(gpu, &settings, true);
        std::thread::scope(|scope| {
            (0..2).for_each(|_| drop(scope.spawn(|| compiler.compile())));
        });
        let before = gpu.compiled_pipelines();
        record(gpu, &mut renderer, &frame);
        assert_eq!(gpu.compiled_pipelines() - before, 0, "of {needed}, with {settings:?}");
    }
}

#[test]
fn precomputed_sky_maps_equal_those_of_a_frame() {
    let Some(mut h) = headless(SIDE, SIDE) else { return };
    let ball = asset(&h, &sphere(16), Material::default());
    let drawables = [Drawable { asset: &ball, instances: &[at(0.0, 0.0, 0.0, 1.0)] }];
    let camera = Pose::look_at(DVec3::new(0.4, 1.1, 3.2), DVec3::ZERO, DVec3::Y, 0.9);
    let environment = Environment { to_sun: DVec3::new(0.3, 0.4, 0.2), ..Environment::default() };
    let frame = Frame { environment, ..Frame::new(camera, &drawables) };
    let before = h.renderer().skies_computed();
    h.frame(&frame).unwrap();
    let computed = h.picture().unwrap();
    assert_eq!(h.renderer().skies_computed(), before + 1);

    let evening = Environment { to_sun: DVec3::new(0.3, 0.02, 0.2), ..environment };
    let [maps, others] = [environment, evening].map(|environment| SkyMaps::new(&environment));
    h.frame(&Frame { environment: evening, sky: Some(&others), ..frame }).unwrap();
    assert_ne!(h.picture().unwrap(), computed, "evenings look different");
    h.frame(&Frame { sky: Some(&maps), ..frame }).unwrap();
    assert_eq!(h.renderer().skies_computed(), before + 1, "nothing is computed twice");
    assert_eq!(h.picture().unwrap(), computed);

    h.frame(&Frame { environment: evening, sky: Some(&maps), ..frame }).unwrap();
    assert_eq!(h.renderer().skies_computed(), before + 2, "another light's maps are of no use");
}

#[cfg(feature = "client")]
#[test]
fn a_scenes_first_frame_waits_neither_for_its_sky_nor_for_a_pipeline() {
    use lodestream_client::core::Change;
    use lodestream_scene::description::{
        Camera, DEFAULT_AMBIENT, DEFAULT_BACKGROUND, SceneHeader, SceneLighting,
    };

    let Some(h) = headless(SIDE, SIDE) else { return };
    let gpu = h.gpu();
    let header = SceneHeader {
        name: "valley".into(),
        fingerprint: [7; 16],
        asset_count: 0,
        instance_count: 0,
        page_count: 0,
        light: SceneLighting { direction: [0.3, 0.8, 0.5], color: [1.0; 3], ambient: DEFAULT_AMBIENT },
        background: DEFAULT_BACKGROUND,
        terrain: Some(Box::new(entry(3))),
        camera: Camera {
            eye: [60.0, 140.0, 130.0],
            target: [0.0, -8.0, 10.0],
            up: [0.0, 1.0, 0.0],
            fov_y: 0.9,
        },
        root_slope: 0.0,
    };
    let mut scene = crate::SceneView::new();
    scene.push(vec![Change::Scene(Box::new(header.clone())), Change::FirstFrame]);
    let settings = Settings::default();
    let mut renderer = Renderer::without_pipelines(gpu, FORMAT).unwrap();
    renderer.compiler(gpu, &settings, true).compile();
    let pipelines = gpu.compiled_pipelines();
    scene.upload(gpu, &renderer, usize::MAX, 0.0).unwrap();
    assert!(scene.is_whole());

    let target = picture(gpu);
    let view = target.create_view(&Default::default());
    let mut encoder = gpu.device.create_command_encoder(&Default::default());
    let (into, view) = (Target::colour(&view, (SIDE, SIDE)), header.camera.view([SIDE, SIDE], 4.0));
    let counters = scene.record(gpu, &mut renderer, &mut encoder, &into, &view, settings, f32::MAX).unwrap();
    gpu.queue.submit([encoder.finish()]);
    assert!(counters.terrain_triangles > 0);
    assert_eq!(renderer.skies_computed(), 0, "the header was here long before");
    assert_eq!(gpu.compiled_pipelines(), pipelines);
}
