//! Maps that use the second set of texture coordinates show what they would show by the first one.

use std::sync::Arc;

use glam::DVec3;
use lodestream_client::core::{Change, IndexRun, MeshChange, NewAsset, TextureChange, TexturePixels, Vertex};
use lodestream_geometry::mesh::skin::Skin;
use lodestream_geometry::refine::RenderVertex;
use lodestream_scene::asset::{SecondUv, TILE_SIDE, TextureFormat, TextureInfo, TextureLevel, tile_place};
use lodestream_scene::description::Instance;

use super::headless;
use crate::{
    Alpha, Headless, Material, PnTriangles, Pose, SceneView, SectionPlane, SectionPlanes, Settings,
    TextureKind,
};

/// Squares on a side of the mesh.
const SIDE: u32 = 6;

/// The first set of texture coordinates, and another one.
fn uv(set: usize, x: f32, y: f32) -> [f32; 2] {
    match set {
        0 => [x, y],
        _ => [0.3 + 0.4 * y + 0.1 * x * x, 0.9 - 0.7 * x],
    }
}

/// A wavy square; each vertex has the coordinates of these sets.
fn mesh(sets: [usize; 2], skin: Skin) -> MeshChange {
    let vertex = |number: u32| {
        let [x, y] = [number % (SIDE + 1), number / (SIDE + 1)].map(|n| n as f32 / SIDE as f32);
        let position = [2.0 * x - 1.0, 2.0 * y - 1.0, 0.2 * (5.0 * x).sin() * y];
        let normal = glam::Vec3::new(-0.4 * (5.0 * x).cos() * y, 0.0, 1.0).normalize().to_array();
        let [uv, second_uv] = sets.map(|set| uv(set, x, y));
        let data = RenderVertex {
            position,
            normal,
            uv,
            second_uv,
            color: [255; 4],
            morph_from: position,
            smooth: true,
            part: 0,
            skin,
        };
        Vertex { data, birth_s: 0.0, level: 0 }
    };
    let vertices: Vec<Vertex> = (0..(SIDE + 1).pow(2)).map(vertex).collect();
    let at = |x: u32, y: u32| y * (SIDE + 1) + x;
    let squares = (0..SIDE * SIDE).map(|n| (n % SIDE, n / SIDE));
    let faces: Vec<[u32; 3]> = squares
        .flat_map(|(x, y)| {
            let [a, b, c, d] = [at(x, y), at(x + 1, y), at(x + 1, y + 1), at(x, y + 1)];
            [[a, b, c], [a, c, d]]
        })
        .collect();
    MeshChange {
        asset: 0,
        vertex_slots: vertices.len() as u32,
        index_slots: vec![faces.len() as u32],
        vertices: vec![(0, vertices)],
        indices: vec![IndexRun { material: 0, first: 0, faces }],
    }
}

/// Kinds of the textures, in the order of their indices: colour, surface, normals, emission, occlusion.
const KINDS: [TextureKind; 5] =
    [TextureKind::Color, TextureKind::Surface, TextureKind::Normal, TextureKind::Color, TextureKind::Surface];

/// A smooth value of a texture in 0..=1 that repeats nowhere.
fn value(texture: u16, channel: u32, [x, y]: [f32; 2]) -> f32 {
    let turn = |a: f32, b: f32| (a * x + b * y + f32::from(texture) + channel as f32).sin();
    0.5 + 0.25 * turn(9.0, 4.0) + 0.25 * turn(-3.0, 11.0)
}

fn texel(texture: u16, at: [f32; 2]) -> [u8; 4] {
    let values = [0, 1, 2, 3].map(|channel| value(texture, channel, at));
    let byte = |x: f32| (x * 255.0) as u8;
    match KINDS[usize::from(texture)] {
        TextureKind::Normal => [byte(0.3 + 0.4 * values[0]), byte(0.3 + 0.4 * values[1]), 230, 255],
        _ => values.map(byte),
    }
}

/// Texels of a rectangle of a level with `side` texels on a side; coordinates beyond the level repeat.
fn texels(texture: u16, side: u32, [x, y]: [i64; 2], [width, height]: [i64; 2]) -> Arc<TexturePixels> {
    let at = |n: i64| n.rem_euclid(i64::from(side)) as f32 / side as f32;
    let rows = (y..y + height).flat_map(|j| (x..x + width).map(move |i| [at(i), at(j)]));
    Arc::new(TexturePixels::Rgba8(rows.flat_map(|place| texel(texture, place)).collect()))
}

/// Two levels of every texture, of which the finer one is in tiles if it is so large.
fn textures(finest: u32) -> (Vec<TextureInfo>, Vec<Change>) {
    let level = |side| TextureLevel { width: side, height: side, bytes: 1, format: TextureFormat::Png };
    let info = |kind| TextureInfo {
        kind,
        width: finest,
        height: finest,
        planes: 0,
        mean: None,
        uv_per_unit: 1.0,
        levels: [finest / 2, finest].map(level).to_vec(),
    };
    let mut changes = Vec::new();
    for texture in 0..KINDS.len() as u16 {
        for (level, side) in [(0, finest / 2), (1, finest)] {
            let change =
                |tile, pixels| Change::Texture(TextureChange { asset: 0, texture, level, tile, pixels });
            if side <= TILE_SIDE {
                let all = [i64::from(side); 2];
                changes.push(change(None, texels(texture, side, [0; 2], all)));
                continue;
            }
            for tile in 0..(side.div_ceil(TILE_SIDE).pow(2)) as u16 {
                let first = tile_place([side; 2], tile).map(|n| i64::from(n * TILE_SIDE) - 2);
                let size = [i64::from(TILE_SIDE.min(side)) + 4; 2];
                changes.push(change(Some(tile), texels(texture, side, first, size)));
            }
        }
    }
    (KINDS.map(info).to_vec(), changes)
}

fn scene(h: &Headless, material: &Material, mesh: MeshChange, finest: u32) -> SceneView {
    let (textures, texels) = textures(finest);
    let mut view = SceneView::new();
    let asset = NewAsset {
        asset: 0,
        origin: [0.0; 3],
        center: [0.0; 3],
        radius: 2.0,
        materials: vec![material.clone()],
        textures,
        shared: Vec::new(),
    };
    let instances = vec![Instance::at(0, [0.0; 3])];
    let changes = vec![Change::Instances(instances), Change::Asset(asset), Change::Mesh(mesh)];
    view.push([changes, texels].concat());
    view.upload(h.gpu(), h.renderer(), usize::MAX, 0.0).unwrap();
    view
}

fn picture(h: &mut Headless, scene: &SceneView, settings: &Settings) -> Vec<u8> {
    let camera = Pose::look_at(DVec3::new(0.4, 0.3, 2.2), DVec3::ZERO, DVec3::Y, 0.9);
    scene.with_frame(camera, *settings, f32::MAX, |frame| h.frame(frame)).unwrap();
    h.picture().unwrap().into_raw()
}

/// Share of values that differ by more than rounding.
fn differing(a: &[u8], b: &[u8]) -> f64 {
    let differ = a.iter().zip(b).filter(|(a, b)| a.abs_diff(**b) > 3).count();
    differ as f64 / a.len() as f64
}

/// A material with one of the maps, and the same with the map's set of texture coordinates changed.
fn with_one_map(map: usize) -> [Material; 2] {
    let plain = Material { roughness: 0.7, metallic: 0.4, ..Material::default() };
    let first = match map {
        0 => Material { base_color_texture: Some(0), ..plain },
        1 => Material { surface_texture: Some(1), ..plain },
        2 => Material { normal_texture: Some(2), ..plain },
        3 => Material { emission_texture: Some(3), emission: [0.4; 3], ..plain },
        // By the other set than the surface map, which is none.
        _ => Material {
            occlusion_texture: Some(4),
            second_uv: SecondUv { surface: true, ..SecondUv::default() },
            ..plain
        },
    };
    let second_uv = SecondUv { color: map == 0, surface: map == 1, normal: map == 2, emission: map == 3 };
    [first.clone(), Material { second_uv, ..first }]
}

/// Asserts that a map looks by the second set as it does by the first in a mesh whose first set this is, and other than by
/// the mesh's own first set.
fn assert_set_is_used(
    h: &mut Headless,
    [first, second]: [Material; 2],
    skin: Skin,
    finest: u32,
    settings: &Settings,
) {
    let what = format!("{second:?} of {finest} texels, {settings:?}");
    let shown = scene(h, &second, mesh([0, 1], skin), finest);
    let shown = picture(h, &shown, settings);
    let same = scene(h, &first, mesh([1, 0], Skin::default()), finest);
    let same = picture(h, &same, settings);
    let differs = differing(&shown, &same);
    assert!(differs < 2e-3, "{differs} of the values differ: {what}");
    let other = scene(h, &first, mesh([0, 1], Skin::default()), finest);
    let other = picture(h, &other, settings);
    let differs = differing(&shown, &other);
    assert!(differs > 0.05, "only {differs} of the values differ by the first set: {what}");
}

#[test]
fn each_map_uses_the_set_of_texture_coordinates_that_the_material_states() {
    let Some(mut h) = headless(96, 96) else { return };
    for map in 0..KINDS.len() {
        assert_set_is_used(&mut h, with_one_map(map), Skin::default(), 64, &Settings::default());
    }
}

#[test]
fn tiles_of_a_map_are_found_by_the_second_set() {
    let Some(mut h) = headless(96, 96) else { return };
    for map in 0..KINDS.len() {
        assert_set_is_used(&mut h, with_one_map(map), Skin::default(), 2 * TILE_SIDE, &Settings::default());
    }
}

#[test]
fn holes_shadows_cuts_and_transparency_follow_the_colour_maps_set() {
    let Some(mut h) = headless(96, 96) else { return };
    let cut = SectionPlanes::new(&[SectionPlane::new(DVec3::new(1.0, 0.2, 0.0), 0.4).unwrap()]).unwrap();
    for alpha in [Alpha::Mask(0.5), Alpha::Blend] {
        let materials = with_one_map(0).map(|material| Material { alpha, ..material });
        for sections in [SectionPlanes::NONE, cut] {
            let settings = Settings { sections, ..Settings::default() };
            assert_set_is_used(&mut h, materials.clone(), Skin::default(), 64, &settings);
        }
    }
}

#[test]
fn skinned_vertices_and_patches_have_the_second_set() {
    let Some(mut h) = headless(96, 96) else { return };
    assert_set_is_used(&mut h, with_one_map(0), Skin::new([(1, 1.0)]), 64, &Settings::default());
    let patches = Settings { pn_triangles: Some(PnTriangles::default()), ..Settings::default() };
    assert_set_is_used(&mut h, with_one_map(0), Skin::default(), 64, &patches);
}
