//! A scene of a hundred thousand parts as a client reports it: instances, batches of parts, and proxies.

use lodestream_client::core::{Change, IndexRun, MeshChange, NewAsset, Vertex};
use lodestream_geometry::refine::RenderVertex;
use lodestream_scene::description::Instance;
use lodestream_scene::proxy::{Cut, Proxy};

use glam::DVec3;

use super::headless;
use crate::{AntiAliasing, Headless, Material, Pose, SceneView, Settings};

/// Materials of the whole scene.
const COLOURS: u32 = 8;

fn material(number: u32) -> Material {
    let share = (number % COLOURS) as f32 / COLOURS as f32;
    Material { base_color: [share, 0.5, 1.0 - share, 1.0], ..Material::default() }
}

/// An asset of `parts` triangles in a row, with some of the materials in turn.
fn asset(number: u32, parts: u32, materials: u32) -> [Change; 2] {
    let corner = |part: u32, [x, y]: [f32; 2]| {
        let position = [x + (part % 25) as f32, y, -((part / 25) as f32)];
        let data = RenderVertex {
            position,
            normal: [0.0, 0.0, 1.0],
            uv: [0.0; 2],
            color: [255; 4],
            morph_from: position,
            smooth: false,
            part,
            skin: Default::default(),
            second_uv: [0.0; 2],
        };
        Vertex { data, birth_s: 0.0, level: 0 }
    };
    let triangle = |part| [[0.0, 0.0], [0.8, 0.0], [0.4, 0.8]].map(|at| corner(part, at));
    let faces = |material: u32| {
        let own = (0..parts).filter(move |part| part % materials == material);
        own.map(|part| [3 * part, 3 * part + 1, 3 * part + 2]).collect::<Vec<_>>()
    };
    [
        Change::Asset(NewAsset {
            asset: number,
            origin: [0.0; 3],
            center: [12.5, 0.5, -10.0],
            radius: 25.0,
            materials: (0..materials).map(|i| material(number + i)).collect(),
            textures: Vec::new(),
            shared: Vec::new(),
        }),
        Change::Mesh(MeshChange {
            asset: number,
            vertices: vec![(0, (0..parts).flat_map(triangle).collect())],
            indices: (0..materials)
                .map(|i| IndexRun { material: i as u16, first: 0, faces: faces(i) })
                .collect(),
            vertex_slots: 3 * parts,
            index_slots: (0..materials).map(|i| faces(i).len() as u32).collect(),
        }),
    ]
}

fn place(number: u32) -> [f64; 3] {
    [f64::from(number % 250) * 2.0 - 250.0, 0.0, f64::from(number / 250) * 2.0 - 250.0]
}

#[test]
fn a_far_view_of_a_hundred_thousand_parts_takes_at_most_three_hundred_calls() {
    let Some(mut h) = headless(160, 90) else { return };
    // 60 assets of a part with 1,000 instances each, 40 of 500 parts with one, and 20 proxies for 20,000 instances of
    // 200 assets.
    let mut steps: Vec<Change> = Vec::new();
    let mut placed: Vec<u32> = (0..20_000).map(|i| 100 + i % 200).collect();
    placed.extend((0..60_000).map(|i| i % 60));
    placed.extend(60..100);
    let instances = (0..).zip(&placed).map(|(number, asset)| Instance::at(*asset, place(number)));
    steps.push(Change::Instances(instances.collect()));
    let proxies =
        (300..320).map(|asset| Proxy { asset, instance_count: 1000, error: 1.0, ..Proxy::default() });
    steps.push(Change::Proxies(proxies.collect()));
    steps.extend((0..60).flat_map(|number| asset(number, 1, 1)));
    steps.extend((60..100).flat_map(|number| asset(number, 500, 4)));
    steps.extend((100..300).flat_map(|number| asset(number, 1, 2)));
    steps.extend((300..320).flat_map(|number| asset(number, 200, 1)));
    let count = placed.len() as u32;
    steps.push(Change::Cut(Cut {
        proxies: (0..20).collect(),
        instances: count,
        covered: vec![[0, 20_000]],
        ..Cut::default()
    }));
    let mut view = SceneView::new();
    view.push(steps);
    view.upload(h.gpu(), h.renderer(), usize::MAX, 0.0).unwrap();

    let draw = |h: &mut Headless, shift: f64| {
        let eye = DVec3::new(shift, 500.0, 700.0);
        let camera = Pose::look_at(eye, DVec3::new(shift, 0.0, 0.0), DVec3::Y, 1.0);
        let settings = Settings { anti_aliasing: AntiAliasing::Temporal, ..Settings::default() };
        view.with_frame(camera, settings, f32::MAX, |frame| h.frame(frame)).unwrap()
    };
    for frame in 0..2 {
        let counters = draw(&mut h, f64::from(frame) * 40.0);
        assert_eq!(counters.instances, 60_000 + 40 + 20, "the cut");
        let parts = 60_000 + 40 * 500 + 20 * 1000;
        assert!(parts >= 100_000 && counters.calls <= 300, "{counters:?}");
        assert!(counters.calls > 0 && (counters.shadow_maps > 0 || frame > 0), "{counters:?}");
    }
}

/// Meshes arrive in pieces over many frames, among others that are replaced: what is drawn is as if they had come at
/// once.
#[test]
fn meshes_that_grow_and_are_replaced_in_shared_pages_keep_their_content() {
    let Some(mut h) = headless(160, 90) else { return };
    let instances = Change::Instances((0..30).map(|i| Instance::at(i, [0.0, f64::from(i), 0.0])).collect());
    let parts = |round: u32, number: u32| 1 + (number * 37 + round * 101) % 300;
    let settings = Settings { shadows: None, occlusion: None, ..Settings::default() };
    let picture = |h: &mut Headless, view: &SceneView| {
        let camera = Pose::look_at(DVec3::new(12.0, 15.0, 30.0), DVec3::new(12.0, 14.0, 0.0), DVec3::Y, 1.0);
        view.with_frame(camera, settings, f32::MAX, |frame| h.frame(frame)).unwrap();
        h.picture().unwrap().into_raw()
    };
    let whole = |h: &mut Headless, round: u32| {
        let mut view = SceneView::new();
        let assets = (0..30).flat_map(|number| asset(number, parts(round, number), 3));
        view.push([instances.clone()].into_iter().chain(assets).collect());
        view.upload(h.gpu(), h.renderer(), usize::MAX, 0.0).unwrap();
        picture(h, &view)
    };
    let mut view = SceneView::new();
    view.push(vec![instances.clone()]);
    for round in 0..3 {
        for number in 0..30 {
            let [asset_, mesh] = asset(number, parts(round, number), 3);
            // First a smaller mesh, which then grows.
            let [_, base] = asset(number, 1 + parts(round, number) / 3, 3);
            view.push(vec![asset_, base]);
            view.push(vec![mesh]);
        }
        while view.waiting() > 0 {
            view.upload(h.gpu(), h.renderer(), 20_000, 0.0).unwrap();
            picture(&mut h, &view);
        }
        let got = picture(&mut h, &view);
        assert!(got == whole(&mut h, round), "round {round}");
    }
}
