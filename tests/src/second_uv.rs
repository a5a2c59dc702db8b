//! A glTF file whose maps use two sets of texture coordinates looks the same on any client.

use std::path::{Path, PathBuf};

use data_encoding::BASE64;
use lodestream_bake::scene::of_files;
use lodestream_daemon::SessionSettings;
use serde_json::json;

use crate::support::daemon::{Server, Transport};
use crate::support::picture::{comparison, draw, headless, keep, same};
use crate::support::scene::{TestScene, prepare_all};
use crate::support::viewer::{Viewer, config};

/// Squares on a side of the mesh.
const SIDE: u16 = 60;

/// Sets of texture coordinates: one across the mesh, and charts of its left and its right half, turned and mirrored.
fn uv(set: usize, [x, y]: [f32; 2], right: bool) -> [f32; 2] {
    match (set, right) {
        (0, _) => [x, y],
        (_, false) => [0.05 + 0.4 * y, 0.1 + 1.6 * x],
        (_, true) => [0.95 - 0.4 * y, 0.1 + 1.6 * (1.0 - x)],
    }
}

/// A wavy sheet of two halves that are joined where they meet. Base colour has one value everywhere and uses `TEXCOORD_0`,
/// emission and occlusion use `TEXCOORD_1`; the attributes have these sets.
fn write_sheet(folder: &Path, sets: [usize; 2]) -> PathBuf {
    let (mut bytes, mut views, mut accessors) = (Vec::new(), Vec::new(), Vec::new());
    let mut push = |list: &[u8], kind: u32, shape: &str, count: usize| {
        views.push(json!({"buffer": 0, "byteOffset": bytes.len(), "byteLength": list.len()}));
        bytes.extend(list);
        bytes.resize(bytes.len().next_multiple_of(4), 0);
        accessors.push(
            json!({"bufferView": views.len() - 1, "componentType": kind, "type": shape, "count": count,
            "min": [0.0, 0.0, -0.1], "max": [1.0, 1.0, 0.1]}),
        );
    };
    let floats = |list: &[f32]| list.iter().flat_map(|number| number.to_le_bytes()).collect::<Vec<u8>>();
    let (mut positions, mut normals, mut uvs, mut faces) = (vec![], vec![], [vec![], vec![]], vec![]);
    for half in 0..2_u16 {
        let first = half * (SIDE / 2 + 1) * (SIDE + 1);
        for (i, j) in (0..=SIDE / 2).flat_map(|i| (0..=SIDE).map(move |j| (i, j))) {
            let [x, y] = [i + half * SIDE / 2, j].map(|n| f32::from(n) / f32::from(SIDE));
            positions.extend([x, y, 0.05 * (13.0 * x).sin() * (7.0 * y).cos()]);
            let slope =
                [0.65 * (13.0 * x).cos() * (7.0 * y).cos(), -0.35 * (13.0 * x).sin() * (7.0 * y).sin()];
            normals.extend(glam::Vec3::new(-slope[0], -slope[1], 1.0).normalize().to_array());
            for (list, set) in uvs.iter_mut().zip(sets) {
                list.extend(uv(set, [x, y], half == 1));
            }
        }
        let at = |i: u16, j: u16| first + i * (SIDE + 1) + j;
        for (i, j) in (0..SIDE / 2).flat_map(|i| (0..SIDE).map(move |j| (i, j))) {
            let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
            faces.extend([a, b, c, a, c, d]);
        }
    }
    let count = positions.len() / 3;
    push(&floats(&positions), 5126, "VEC3", count);
    push(&floats(&normals), 5126, "VEC3", count);
    uvs.iter().for_each(|list| push(&floats(list), 5126, "VEC2", count));
    push(
        &faces.iter().flat_map(|index| index.to_le_bytes()).collect::<Vec<u8>>(),
        5123,
        "SCALAR",
        faces.len(),
    );
    // More texels on a side than a tile has.
    let image = |texel: &dyn Fn(f32, f32) -> [f32; 3]| {
        let image = image::RgbImage::from_fn(300, 300, |x, y| {
            image::Rgb(texel(x as f32 / 300.0, y as f32 / 300.0).map(|value| (value * 255.0) as u8))
        });
        let mut png = std::io::Cursor::new(Vec::new());
        image.write_to(&mut png, image::ImageFormat::Png).unwrap();
        json!({"uri": format!("data:image/png;base64,{}", BASE64.encode(png.get_ref()))})
    };
    let wave = |x: f32| 0.5 + 0.5 * x.sin();
    let images = [
        image(&|_, _| [0.6, 0.5, 0.4]),
        image(&|x, y| [wave(40.0 * x), wave(30.0 * y), wave(25.0 * (x + y))]),
        image(&|x, y| [wave(20.0 * (x - y)); 3]),
    ];
    let uri = format!("data:application/octet-stream;base64,{}", BASE64.encode(&bytes));
    let second = |index: usize| json!({"index": index, "texCoord": 1});
    let file = json!({
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"indices": 4, "material": 0,
            "attributes": {"POSITION": 0, "NORMAL": 1, "TEXCOORD_0": 2, "TEXCOORD_1": 3}}]}],
        "materials": [{
            "pbrMetallicRoughness":
                {"baseColorTexture": {"index": 0}, "metallicRoughnessTexture": {"index": 0}, "metallicFactor": 0.0},
            "emissiveTexture": second(1), "emissiveFactor": [0.5, 0.5, 0.5], "occlusionTexture": second(2),
        }],
        "images": images, "textures": [{"source": 0}, {"source": 1}, {"source": 2}],
        "accessors": accessors, "bufferViews": views, "buffers": [{"byteLength": bytes.len(), "uri": uri}],
    });
    let path = folder.join("sheet.gltf");
    std::fs::write(&path, file.to_string()).unwrap();
    path
}

#[test]
fn maps_by_the_second_set_of_texture_coordinates_reach_every_client() {
    let Some(mut headless) = headless() else { return };
    let folder = tempfile::tempdir().unwrap();
    let open = |sets| {
        let scene = of_files(&[write_sheet(folder.path(), sets)]).unwrap();
        TestScene::open(&scene, prepare_all(&scene, &folder.path().join("cache")))
    };
    let scene = open([0, 1]);
    // One set is enough where both are equal.
    let expected = draw(&mut headless, open([1, 1]).whole());
    let other = draw(&mut headless, open([0, 0]).whole());
    let server = Server::start(scene.source(), SessionSettings::default());
    for transport in Transport::BOTH {
        let mut viewer = Viewer::start(&server.address(transport), config());
        let stats = viewer.settle().stats;
        assert_eq!((stats.decode_failures, stats.refused), (0, 0));
        let shown = draw(&mut headless, viewer.changes);
        keep(&shown, "second-uv");
        keep(&expected, "second-uv-expected");
        let found = comparison(&shown, &expected);
        assert!(same(&found), "{transport:?}: {found:?}");
        assert!(!same(&comparison(&shown, &other)), "{transport:?}: the first set is used");
    }
    server.assert_healthy();
}
