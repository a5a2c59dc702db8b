//! Chromium's WGSL compiler, which refuses what naga accepts, on the renderer's shader modules.

use std::collections::BTreeSet;
use std::path::Path;

use glam::DVec3;
use lodestream_bake::scene::of_files;
use lodestream_client::core::Change;
use lodestream_daemon::SessionSettings;
use lodestream_render::{
    AmbientOcclusion, AntiAliasing, Bloom, DebugView, Frame, Gpu, Headless, Ink, Load, OcclusionMethod,
    OcclusionNormals, PartState, PnTriangles, PunctualLight, ReflectionMethod, Reflections, ReliefMethod,
    Renderer, SceneView, Settings, Target,
};
use lodestream_scene::parts::{PartTransform, ScenePart};
use lodestream_scene::section::{SectionPlane, SectionPlanes};

use super::tab;
use crate::support::daemon::Server;
use crate::support::picture::headless_of;
use crate::support::scene::{TestScene, prepare_all};

/// The search of relief that a tab has, in place of [`SEARCHES`] and before [`STEPS`]: with the feature `methods`, as here,
/// it is in no module.
const BISECTION: &str = "relief_bisection.wgsl";
const SEARCHES: &str = "relief_methods.wgsl";
const STEPS: &str = "relief_steps.wgsl";

/// Triangles with a clear coat, one of which transmits light.
const LACQUER: &str = r#"{"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0, 1]}],
"nodes": [{"mesh": 0}, {"mesh": 1, "translation": [0, 0, 1]}],
"meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "material": 0}]},
    {"primitives": [{"attributes": {"POSITION": 0}, "material": 1}]}],
"materials": [{"extensions": {"KHR_materials_clearcoat": {"clearcoatFactor": 1}}},
    {"extensions": {"KHR_materials_clearcoat": {"clearcoatFactor": 1},
        "KHR_materials_transmission": {"transmissionFactor": 1}}}],
"accessors": [{"bufferView": 0, "componentType": 5126, "type": "VEC3", "count": 3, "min": [0, 0, 0], "max": [1, 1, 0]}],
"bufferViews": [{"buffer": 0, "byteLength": 36}],
"buffers": [{"uri": "data:application/octet-stream;base64,AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAA", "byteLength": 36}]}"#;

/// Small: only the modules matter.
const SIZE_PX: [u32; 2] = [64, 36];

/// Settings that between them use every method.
fn variants() -> Vec<Settings> {
    let usual = Settings::default();
    let ambient = usual.occlusion.unwrap_or_default();
    let mut all = vec![
        Settings { wireframe: true, bloom: Some(Bloom::default()), ink: Some(Ink::default()), ..usual },
        Settings {
            anti_aliasing: AntiAliasing::Temporal,
            pn_triangles: Some(PnTriangles::default()),
            ..usual
        },
        Settings { render_scale: 0.5, occlusion: Some(AmbientOcclusion { half: true, ..ambient }), ..usual },
    ];
    let plane = SectionPlane::new(DVec3::X, 0.0).expect("a plane");
    let sections = SectionPlanes::new(&[plane]).expect("few planes");
    let cut = Settings { sections, ..usual };
    all.extend([
        cut,
        Settings { wireframe: true, ink: Some(Ink::default()), ..cut },
        Settings { pn_triangles: Some(PnTriangles::default()), ..cut },
        Settings { debug_view: DebugView::Overdraw, ..cut },
    ]);
    all.extend(OcclusionMethod::ALL.into_iter().flat_map(|method| {
        OcclusionNormals::ALL.map(|normals| Settings {
            occlusion: Some(AmbientOcclusion { method, normals, still: Some(method), ..ambient }),
            ..usual
        })
    }));
    all.extend(ReflectionMethod::ALL.map(|method| Settings {
        reflections: Some(Reflections { method, ..Reflections::default() }),
        ..usual
    }));
    all.extend(ReliefMethod::ALL.map(|relief_method| Settings { relief_method, ..usual }));
    all.extend(DebugView::ALL.map(|debug_view| Settings { debug_view, ..usual }));
    all
}

/// The text of a shader file.
fn file(name: &str) -> String {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../crates/render/src/shaders");
    std::fs::read_to_string(folder.join(name)).unwrap()
}

/// The small scene, a pane of glass, or lacquered triangles, one of which transmits light.
fn scenes() -> [Vec<Change>; 3] {
    let folder = tempfile::tempdir().unwrap();
    let lacquer = folder.path().join("lacquer.gltf");
    std::fs::write(&lacquer, LACQUER).unwrap();
    let path = folder.path().join("pane.obj");
    std::fs::write(&path, "mtllib pane.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl glass\nf 1 2 3\n").unwrap();
    std::fs::write(folder.path().join("pane.mtl"), "newmtl glass\nKd 1 1 1\nd 0.5\n").unwrap();
    let [glass, lacquer] = [path, lacquer].map(|path| {
        let scene = of_files(&[path]).unwrap();
        TestScene::open(&scene, prepare_all(&scene, &folder.path().join("cache"))).whole()
    });
    [TestScene::small().whole(), glass, lacquer]
}

/// Compiles and draws with all settings.
fn compile_all(headless: &mut Headless) {
    for changes in scenes() {
        let mut view = SceneView::new();
        view.push(changes);
        view.upload(headless.gpu(), headless.renderer(), usize::MAX, 0.0).unwrap();
        let camera = view.header().expect("a scene").camera.pose();
        let light =
            PunctualLight { position: camera.eye.to_array(), intensity: [9.0; 3], range: 50.0, spot: None };
        for settings in variants() {
            headless.renderer().compiler(headless.gpu(), &settings, true).compile();
            for lights in [&[][..], &[light]] {
                view.with_frame(camera, settings, f32::MAX, |frame| {
                    headless.frame(&Frame { lights, ..*frame })
                })
                .unwrap();
            }
        }
        // A part that moves has motion vectors.
        let settings = Settings { anti_aliasing: AntiAliasing::Temporal, ..Settings::default() };
        for x in [0.0, 0.1] {
            let state = PartState {
                transform: Some(PartTransform::by(DVec3::X * x).unwrap()),
                ..PartState::default()
            };
            view.set_parts(headless.gpu(), &[(ScenePart { instance: 0, part: 0 }, state)]).unwrap();
            view.with_frame(camera, settings, f32::MAX, |frame| headless.frame(frame)).unwrap();
        }
    }
}

/// The texts of the modules that drawing into a host's targets, colour and depth, adds.
fn into_a_host() -> BTreeSet<&'static str> {
    let gpu = Gpu::headless().unwrap();
    let mut renderer = Renderer::new(&gpu, wgpu::TextureFormat::Rgba8Unorm).unwrap();
    let mut view = SceneView::new();
    view.push(TestScene::small().whole());
    view.upload(&gpu, &renderer, usize::MAX, 0.0).unwrap();
    let camera = view.header().expect("a scene").camera;
    let size = (SIZE_PX[0], SIZE_PX[1]);
    let texture = |format| {
        let texture = gpu.device.create_texture(&wgpu::TextureDescriptor {
            label: None,
            size: wgpu::Extent3d { width: size.0, height: size.1, depth_or_array_layers: 1 },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format,
            usage: wgpu::TextureUsages::RENDER_ATTACHMENT,
            view_formats: &[],
        });
        texture.create_view(&Default::default())
    };
    let [colour, depth] = [wgpu::TextureFormat::Rgba8Unorm, wgpu::TextureFormat::Depth32Float].map(texture);
    let target = Target { colour: &colour, depth: Some(&depth), size, load: Load::Keep };
    let mut encoder = gpu.device.create_command_encoder(&Default::default());
    let seen = camera.view(SIZE_PX, 1.0);
    view.record(&gpu, &mut renderer, &mut encoder, &target, &seen, Settings::default(), f32::MAX).unwrap();
    gpu.queue.submit([encoder.finish()]);
    gpu.shader_texts().into_iter().collect()
}

/// The names of shader files whose text is in none of the modules.
fn absent(texts: &BTreeSet<String>) -> BTreeSet<String> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../crates/render/src/shaders");
    let files = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let absent = files.filter(|file| {
        let text = std::fs::read_to_string(file).unwrap();
        !texts.iter().any(|module| module.contains(&text))
    });
    absent.map(|file| file.file_name().unwrap().to_string_lossy().into_owned()).collect()
}

#[test]
fn chromium_compiles_the_shader_modules() {
    let (Some(mut tab), Some(mut headless)) = (tab(SIZE_PX), headless_of(SIZE_PX)) else { return };
    compile_all(&mut headless);
    let drawn: BTreeSet<&str> = headless.gpu().shader_texts().into_iter().chain(into_a_host()).collect();
    let (searches, bisection, steps) = (file(SEARCHES), file(BISECTION), file(STEPS));
    let in_a_tab = drawn.iter().filter(|text| text.contains(&searches) && text.contains(&steps));
    let mut texts: BTreeSet<String> = in_a_tab.map(|text| text.replace(&searches, &bisection)).collect();
    texts.extend(drawn.iter().map(|text| (*text).to_owned()));
    println!("{} modules", texts.len());
    assert_eq!(absent(&texts), BTreeSet::new(), "files of shaders that no frame here uses");
    // WebGPU needs a page of this machine.
    let server = Server::start(TestScene::small().source(), SessionSettings::default());
    tab.navigate(&server.page_url());
    for text in texts {
        let source = serde_json::to_string(&text).unwrap();
        let faults = tab.evaluate(&format!(
            "(async () => {{
                globalThis.device ??= await (await navigator.gpu.requestAdapter()).requestDevice();
                const module = device.createShaderModule({{ code: {source} }});
                const {{ messages }} = await module.getCompilationInfo();
                return messages.filter(({{ type }}) => type === 'error').map((m) => `${{m.lineNum}}: ${{m.message}}`);
            }})()"
        ));
        assert!(faults == serde_json::json!([]), "{faults} in {text}");
    }
}
