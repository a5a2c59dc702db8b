//! Data that arrives faster than frames can upload: meshes by slots and textures by rows, shown once they are complete.

use std::sync::Arc;

use glam::DVec3;
use lodestream_client::core::{Change, IndexRun, MeshChange, NewAsset, TextureChange, TexturePixels, Vertex};
use lodestream_geometry::refine::RenderVertex;
use lodestream_scene::asset::{Material, TextureFormat, TextureInfo, TextureKind, TextureLevel};
use lodestream_scene::description::Instance;

use super::headless;
use crate::{Headless, Pose, SceneView, Settings};

/// Texels on a side of the texture's finest level, and bytes of its rows.
const SIDE: u32 = 256;
const ROW_BYTES: usize = 4 * SIDE as usize;

fn vertex(x: f32, y: f32, color: [u8; 4]) -> Vertex {
    let data = RenderVertex {
        position: [x, y, 0.0],
        normal: [0.0, 0.0, 1.0],
        uv: [0.5 + 0.5 * x, 0.5 + 0.5 * y],
        color,
        morph_from: [x, y, 0.0],
        smooth: true,
        part: 0,
        skin: Default::default(),
        second_uv: [0.0; 2],
    };
    Vertex { data, birth_s: 0.0, level: 0 }
}

/// The square again, of `side` squares per side, in many runs.
fn grid(side: u32, color: [u8; 4]) -> MeshChange {
    let at = |n: u32| 2.0 * n as f32 / side as f32 - 1.0;
    let places = (0..=side).flat_map(|y| (0..=side).map(move |x| (x, y)));
    let vertices: Vec<Vertex> = places.map(|(x, y)| vertex(at(x), at(y), color)).collect();
    let corner = |x: u32, y: u32| y * (side + 1) + x;
    let faces = (0..side * side).map(|n| (n % side, n / side)).flat_map(|(x, y)| {
        let [a, b, c, d] = [(x, y), (x + 1, y), (x + 1, y + 1), (x, y + 1)].map(|(x, y)| corner(x, y));
        [[a, b, c], [a, c, d]]
    });
    let faces: Vec<[u32; 3]> = faces.collect();
    let runs = (0..).step_by(50).zip(vertices.chunks(50));
    let face_runs = (0..).step_by(70).zip(faces.chunks(70));
    MeshChange {
        asset: 0,
        vertices: runs.map(|(first, run)| (first, run.to_vec())).collect(),
        indices: face_runs.map(|(first, run)| IndexRun { material: 0, first, faces: run.to_vec() }).collect(),
        vertex_slots: vertices.len() as u32,
        index_slots: vec![faces.len() as u32],
    }
}

/// A square that fills the picture, with a texture of two levels.
fn square() -> Vec<Change> {
    let level = |side| TextureLevel { width: side, height: side, bytes: 1, format: TextureFormat::Png };
    let texture = TextureInfo {
        kind: TextureKind::Color,
        width: SIDE,
        height: SIDE,
        planes: 0,
        mean: Some([255; 3]),
        uv_per_unit: 1.0,
        levels: [SIDE / 2, SIDE].map(level).to_vec(),
    };
    let corners = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)];
    vec![
        Change::Instances(vec![Instance::at(0, [0.0; 3])]),
        Change::Asset(NewAsset {
            asset: 0,
            origin: [0.0; 3],
            center: [0.0; 3],
            radius: 2.0,
            materials: vec![Material { base_color_texture: Some(0), ..Material::default() }],
            textures: vec![texture],
            shared: Vec::new(),
        }),
        Change::Mesh(MeshChange {
            asset: 0,
            vertices: vec![(0, corners.map(|(x, y)| vertex(x, y, [255; 4])).to_vec())],
            indices: vec![IndexRun { material: 0, first: 0, faces: vec![[0, 1, 2], [0, 2, 3]] }],
            vertex_slots: 4,
            index_slots: vec![2],
        }),
        Change::FirstFrame,
    ]
}

/// A level of one colour, above of another than below.
fn level(level: u8, side: u32, colours: [[u8; 4]; 2]) -> Change {
    let half = (side * side / 2) as usize;
    let texels = [colours[0].repeat(half), colours[1].repeat(half)].concat();
    let pixels = Arc::new(TexturePixels::Rgba8(texels));
    Change::Texture(TextureChange { asset: 0, texture: 0, level, tile: None, pixels })
}

fn picture(h: &mut Headless, scene: &SceneView) -> Vec<u8> {
    let camera = Pose::look_at(DVec3::new(0.0, 0.0, 1.5), DVec3::ZERO, DVec3::Y, 0.8);
    let settings = Settings { occlusion: None, shadows: None, ..Settings::default() };
    scene.with_frame(camera, settings, f32::MAX, |frame| h.frame(frame)).unwrap();
    h.picture().unwrap().into_raw()
}

const RED: [u8; 4] = [200, 20, 20, 255];
const BLUE: [u8; 4] = [20, 20, 200, 255];

/// A level of a megabyte must be uploaded over several frames if the budget is small.
#[test]
fn a_long_texture_level_is_spread_over_frames_and_shown_once_it_is_whole() {
    let Some(mut h) = headless(256, 256) else { return };
    let mut at_once = SceneView::new();
    let coarse = level(0, SIDE / 2, [BLUE; 2]);
    let fine = level(1, SIDE, [RED, BLUE]);
    at_once.push([square(), vec![coarse.clone(), fine.clone()]].concat());
    at_once.upload(h.gpu(), h.renderer(), usize::MAX, 0.0).unwrap();
    assert_eq!(at_once.waiting(), 0);
    let sharp = picture(&mut h, &at_once);

    let mut scene = SceneView::new();
    scene.push([square(), vec![coarse]].concat());
    scene.upload(h.gpu(), h.renderer(), usize::MAX, 0.0).unwrap();
    let blurred = picture(&mut h, &scene);
    assert_ne!(blurred, sharp);
    let fine_bytes = fine.bytes();
    scene.push(vec![fine]);
    let budget = 60_000;
    let mut spent = 0;
    while spent < fine_bytes {
        let before = picture(&mut h, &scene);
        assert_eq!(before, blurred, "after {spent} bytes of {fine_bytes}");
        let bytes = scene.upload(h.gpu(), h.renderer(), budget, 0.0).unwrap();
        spent += bytes;
        let filled = bytes >= budget || spent == fine_bytes;
        assert!(bytes < budget + ROW_BYTES && filled, "{bytes} of {budget}, {spent} of {fine_bytes}");
    }
    assert_eq!(scene.waiting(), 0);
    assert_eq!(picture(&mut h, &scene), sharp);
    // However small the budget, at least one row is uploaded.
    scene.push(vec![level(1, SIDE, [BLUE; 2])]);
    assert_eq!(scene.upload(h.gpu(), h.renderer(), 1, 0.0).unwrap(), ROW_BYTES);
}

/// A step with several textures continues where it stopped.
#[test]
fn an_interrupted_upload_loses_nothing() {
    let Some(mut h) = headless(256, 256) else { return };
    let step = || [square(), vec![level(0, SIDE / 2, [BLUE; 2]), level(1, SIDE, [RED, BLUE])]].concat();
    let mut pictures = Vec::new();
    for budget in [usize::MAX, 1, ROW_BYTES, 100_000] {
        let mut scene = SceneView::new();
        scene.push(step());
        let mut calls = 0;
        while scene.waiting() > 0 {
            scene.upload(h.gpu(), h.renderer(), budget, 0.0).unwrap();
            calls += 1;
        }
        assert_eq!(calls == 1, budget == usize::MAX, "{budget}");
        pictures.push(picture(&mut h, &scene));
    }
    assert!(pictures.windows(2).all(|pair| pair[0] == pair[1]));
}

/// Two megabytes of a mesh in one change must be uploaded over several frames.
#[test]
fn a_large_change_of_a_mesh_is_spread_over_frames_and_seen_at_once() {
    let Some(mut h) = headless(256, 256) else { return };
    let uploaded = |h: &Headless, changes: &[Change]| {
        let mut scene = SceneView::new();
        scene.push([&square()[..], changes].concat());
        scene.upload(h.gpu(), h.renderer(), usize::MAX, 0.0).unwrap();
        assert_eq!(scene.waiting(), 0);
        scene
    };
    // The first fits a frame, the second does not, and its buffers grow.
    let changes = [grid(1, RED), grid(40, BLUE)].map(Change::Mesh);
    let mut scene = uploaded(&h, &[]);
    let white = picture(&mut h, &scene);
    let [red, blue] = [1, 2].map(|count| {
        let scene = uploaded(&h, &changes[..count]);
        picture(&mut h, &scene)
    });
    assert!(white != red && red != blue);
    let all: usize = changes.iter().map(Change::bytes).sum();
    scene.push(changes.to_vec());
    let budget = 20_000;
    let mut spent = 0;
    while spent < all {
        let bytes = scene.upload(h.gpu(), h.renderer(), budget, 0.0).unwrap();
        spent += bytes;
        let filled = bytes >= budget || spent == all;
        assert!(bytes < budget + size_of::<Vertex>() && filled, "{bytes} of {budget}, {spent} of {all}");
        assert_eq!(scene.waiting() > 0, spent < all);
        let seen = picture(&mut h, &scene);
        assert!(seen == if spent < all { red.clone() } else { blue.clone() }, "{spent} of {all}");
    }
}
