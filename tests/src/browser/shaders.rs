//! Chromium's WGSL compiler, which refuses what naga accepts, on the renderer's shader modules.

use std::collections::BTreeSet;
use std::path::Path;

use lodestream_daemon::SessionSettings;
use lodestream_render::{
    AmbientOcclusion, AntiAliasing, Bloom, DebugView, Frame, Headless, Ink, OcclusionMethod,
    OcclusionNormals, PnTriangles, PunctualLight, ReflectionMethod, Reflections, ReliefMethod, SceneView,
    Settings,
};

use super::tab;
use crate::support::daemon::Server;
use crate::support::picture::headless_of;
use crate::support::scene::TestScene;

/// Files that no frame here needs: of transparent materials, hosts' targets, moving objects and materials with
/// relief.
const NOT_DRAWN: [&str; 5] = [
    "composite.wgsl",
    "forward.wgsl",
    "mesh_motion.wgsl",
    "no_punctual_lights.wgsl",
    "relief_bisection.wgsl",
];

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

/// Compiles and draws with all settings.
fn compile_all(headless: &mut Headless) {
    let mut view = SceneView::new();
    view.push(TestScene::small().whole());
    view.upload(headless.gpu(), headless.renderer(), usize::MAX, 0.0).unwrap();
    let camera = view.header().expect("a scene").camera.pose();
    let light =
        PunctualLight { position: camera.eye.to_array(), intensity: [9.0; 3], range: 50.0, spot: None };
    for settings in variants() {
        headless.renderer().compiler(headless.gpu(), &settings, true).compile();
        for lights in [&[][..], &[light]] {
            view.with_frame(camera, settings, f32::MAX, |frame| headless.frame(&Frame { lights, ..*frame }))
                .unwrap();
        }
    }
}

/// The names of shader files whose text is in none of the modules.
fn absent(texts: &[&str]) -> BTreeSet<String> {
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
    let texts = headless.gpu().shader_texts();
    let absent = absent(&texts);
    println!("{} modules, absent: {absent:?}", texts.len());
    assert_eq!(absent, NOT_DRAWN.map(str::to_owned).into(), "files of shaders that no frame here uses");
    // WebGPU needs a page of this machine.
    let server = Server::start(TestScene::small().source(), SessionSettings::default());
    tab.navigate(&server.page_url());
    for text in texts {
        let source = serde_json::to_string(text).unwrap();
        let faults = tab.evaluate(&format!(
            "(async () => {{
                globalThis.device ??= await (await navigator.gpu.requestAdapter()).requestDevice();
                const module = device.createShaderModule({{ code: {source} }});
                const {{ messages }} = await module.getCompilationInfo();
                return messages.filter(({{ type }}) => type === 'error').map((m) => `${{m.lineNum}}: ${{m.message}}`);
            }})()"
        ));
        assert_eq!(faults, serde_json::json!([]), "{text}");
    }
}
