//! GPU memory of meshes that are refined and undone along a flight: it follows what is shown, and pictures stay whole.

use glam::DVec3;
use lodestream_client::core::{Change, IndexRun, MeshChange, NewAsset, Vertex};
use lodestream_geometry::refine::RenderVertex;
use lodestream_scene::asset::Material;
use lodestream_scene::description::Instance;

use super::headless;
use crate::{Headless, Pose, SceneView, Settings};

/// Assets in a row.
const ASSETS: u32 = 24;
/// Most bytes that a frame uploads.
const BUDGET: usize = 200_000;
/// Squares per side of a mesh, by its distance along the row from the camera.
const SIDES: [u32; 4] = [50, 36, 24, 14];
const FAR_SIDE: u32 = 4;
/// Bytes of the largest mesh, before its vertices are packed.
const MOST_MESH_BYTES: usize = 51 * 51 * 72 + 2 * 50 * 50 * 12;

/// A wavy square of `side` squares per side.
fn mesh(asset: u32, side: u32) -> MeshChange {
    let at = |n: u32| n as f32 / side as f32;
    let corners = (0..=side).flat_map(|y| (0..=side).map(move |x| (x, y)));
    let vertices: Vec<Vertex> = corners
        .map(|(x, y)| {
            let position = [at(x), at(y), 0.1 * (9.0 * at(x) * at(y) + asset as f32).sin()];
            let data = RenderVertex {
                position,
                normal: [0.0, 0.0, 1.0],
                uv: [0.0; 2],
                color: [40 * (asset % 6) as u8, (255.0 * at(x)) as u8, (255.0 * at(y)) as u8, 255],
                morph_from: position,
                smooth: true,
                part: 0,
                skin: Default::default(),
                second_uv: [0.0; 2],
            };
            Vertex { data, birth_s: 0.0, level: 0 }
        })
        .collect();
    let squares = (0..side * side).map(|n| n % side + n / side * (side + 1));
    let faces: Vec<_> =
        squares.flat_map(|a| [[a, a + 1, a + side + 2], [a, a + side + 2, a + side + 1]]).collect();
    MeshChange {
        asset,
        vertex_slots: vertices.len() as u32,
        index_slots: vec![faces.len() as u32],
        vertices: vec![(0, vertices)],
        indices: vec![IndexRun { material: 0, first: 0, faces }],
    }
}

fn side(asset: u32, camera: u32) -> u32 {
    SIDES.get(asset.abs_diff(camera) as usize).copied().unwrap_or(FAR_SIDE)
}

/// A scene as a camera at an asset needs it.
fn scene(camera: u32) -> Vec<Change> {
    let instances = (0..ASSETS).map(|asset| Instance::at(asset, [f64::from(asset), 0.0, 0.0])).collect();
    let assets = (0..ASSETS).flat_map(|asset| {
        let new = NewAsset {
            asset,
            origin: [0.0; 3],
            center: [0.5, 0.5, 0.0],
            radius: 1.0,
            materials: vec![Material::default()],
            textures: Vec::new(),
            shared: Vec::new(),
        };
        [Change::Asset(new), Change::Mesh(mesh(asset, side(asset, camera)))]
    });
    [Change::Instances(instances)].into_iter().chain(assets).chain([Change::FirstFrame]).collect()
}

fn picture(h: &mut Headless, scene: &SceneView) -> Vec<u8> {
    let middle = f64::from(ASSETS) / 2.0;
    let eye = DVec3::new(middle, 0.5, 14.0);
    let camera = Pose::look_at(eye, DVec3::new(middle, 0.5, 0.0), DVec3::Y, 0.9);
    scene.with_frame(camera, Settings::default(), f32::MAX, |frame| h.frame(frame)).unwrap();
    h.picture().unwrap().into_raw()
}

/// Uploads and draws until nothing waits, and some frames more; all of these show the same.
fn rest(h: &mut Headless, view: &mut SceneView) -> Vec<u8> {
    let uploaded = |h: &Headless, view: &mut SceneView| {
        let bytes = view.upload(h.gpu(), h.renderer(), BUDGET, 0.0).unwrap();
        assert!(bytes <= BUDGET + MOST_MESH_BYTES, "{bytes} bytes in a frame");
        bytes
    };
    while view.waiting() > 0 {
        uploaded(h, view);
        picture(h, view);
    }
    let whole = picture(h, view);
    for _ in 0..12 {
        uploaded(h, view);
        assert!(picture(h, view) == whole, "a picture changes while meshes move in memory");
    }
    whole
}

#[test]
fn memory_of_meshes_is_as_after_a_long_flight_as_without() {
    let Some(mut h) = headless(240, 60) else { return };
    let mut view = SceneView::new();
    view.push(scene(0));
    rest(&mut h, &mut view);
    let cameras = (1..ASSETS).chain((0..ASSETS - 1).rev());
    let mut before = 0;
    for camera in std::iter::repeat_n(cameras, 2).flatten() {
        let changed = (0..ASSETS).filter(|&asset| side(asset, before) != side(asset, camera));
        view.push(changed.map(|asset| Change::Mesh(mesh(asset, side(asset, camera)))).collect());
        before = camera;
        let shown = rest(&mut h, &mut view);
        let bytes = h.renderer().mesh_bytes();
        if camera % 8 > 0 {
            continue;
        }
        let Some(mut other) = headless(240, 60) else { return };
        let mut fresh = SceneView::new();
        fresh.push(scene(camera));
        assert!(rest(&mut other, &mut fresh) == shown, "at {camera}");
        let needed = other.renderer().mesh_bytes();
        println!("at {camera}: {bytes} bytes, {needed} without the flight");
        assert!(bytes <= 2 * needed, "at {camera}: {bytes} bytes, {needed} without the flight");
    }
}
