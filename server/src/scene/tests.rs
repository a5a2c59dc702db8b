//! glTF files in scenes: meshes as assets, nodes as instances.

use std::path::PathBuf;

use lodestream_geometry::Codec;
use lodestream_import::Part;
use lodestream_import::recipe::{Precision, Round};
use tempfile::TempDir;

use super::{Scene, of_files, parse};

/// Two meshes, "hull" and "mast" (placed twice, once mirrored), of one triangle each.
fn ship(dir: &TempDir) -> PathBuf {
    let bytes: Vec<u8> =
        [0f32, 0., 0., 1., 0., 0., 0., 1., 0.].iter().flat_map(|v| v.to_le_bytes()).collect();
    let data = data_encoding::BASE64.encode(&bytes);
    let text = serde_json::json!({
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": [0, 1, 2]}],
        "nodes": [
            {"mesh": 0},
            {"mesh": 1, "translation": [1, 2, 3], "scale": [2, 2, 2]},
            {"mesh": 1, "scale": [1, -1, 1]},
        ],
        "meshes": [
            {"name": "hull", "primitives": [{"attributes": {"POSITION": 0}}]},
            {"name": "mast", "primitives": [{"attributes": {"POSITION": 0}}]},
        ],
        "accessors": [{"bufferView": 0, "componentType": 5126, "type": "VEC3", "count": 3}],
        "bufferViews": [{"buffer": 0, "byteLength": 36}],
        "buffers": [{"byteLength": 36, "uri": format!("data:;base64,{data}")}],
    });
    let path = dir.path().join("ship.gltf");
    std::fs::write(&path, text.to_string()).unwrap();
    path
}

fn names(scene: &Scene) -> Vec<&str> {
    scene.assets.iter().map(|asset| asset.name.as_str()).collect()
}

#[test]
fn a_gltf_file_is_its_meshes_where_its_nodes_have_them() {
    let dir = TempDir::new().unwrap();
    let scene = of_files(&[ship(&dir)]).unwrap();
    assert_eq!(scene.name, "ship");
    assert_eq!(names(&scene), ["ship/hull", "ship/mast", "ship/mast-2"]);
    let [model] = &scene.models[..] else { panic!("{:?}", scene.models) };
    assert_eq!(model.iter().map(|i| i.asset).collect::<Vec<_>>(), [0, 1, 2]);
    assert_eq!((model[1].translation, model[1].scale), ([1.0, 2.0, 3.0], 2.0));
}

#[test]
fn scene_files_place_gltf_models_whole_by_mesh_and_merged() {
    let dir = TempDir::new().unwrap();
    ship(&dir);
    let text = r#"
        [[asset]]
        name = "fleet"
        file = "ship.gltf"
        uv_bits = 10
        normal_tolerance = 4.5
        metric = "melax"
        round_size = 0.25
        codec = "zstd"
        [[asset]]
        name = "pole"
        file = "ship.gltf"
        mesh = "mast"
        position_bits = 9
        [[asset]]
        name = "toy"
        file = "ship.gltf"
        merge = true
        round_size = "heap"
        [[instance]]
        asset = "fleet"
        translation = [10, 0, 0]
        rotation = { yaw = 90 }
        scale = 3
        [[instance]]
        asset = "pole"
        [[instance]]
        asset = "toy"
    "#;
    let at = dir.path().join("scene.toml");
    let scene = parse(&at, text).unwrap();
    assert_eq!(names(&scene), ["fleet/hull", "fleet/mast", "fleet/mast-2", "pole", "toy"]);
    assert_eq!(scene.assets[4].part, Part::Whole);
    let recipe = scene.assets[1].recipe;
    assert_eq!((recipe.uv_bits, recipe.normal_tolerance), ("10".parse().ok(), "4.5".parse().ok()));
    assert_eq!(recipe.round, Round::try_from(0.25).ok());
    assert_eq!((recipe.codec, scene.assets[4].recipe.codec), (Some(Codec::Plain), None));
    assert_eq!(scene.assets[3].recipe.precision, "9".parse().ok().map(Precision::Bits));
    assert_eq!(scene.assets[4].recipe.round, Some(Round::Heap));
    let instances = scene.instances.unwrap();
    assert_eq!(instances.iter().map(|i| i.asset).collect::<Vec<_>>(), [0, 1, 2, 3, 4]);
    // A quarter turn about y takes (1, 2, 3) to (3, 2, -1); three times that, moved.
    let expected = [19.0, 6.0, -3.0];
    for (found, expected) in instances[1].translation.iter().zip(expected) {
        assert!((found - expected).abs() < 1e-5, "{:?}", instances[1].translation);
    }
    assert_eq!(instances[1].scale, 6.0);
    for (from, to, fragment) in [
        ("mesh = \"mast\"", "mesh = \"sail\"", "no mesh named \"sail\"; it has 2: hull, mast"),
        ("mesh = \"mast\"", "mesh = \"mast\"\nmerge = true", "exclude each other"),
        ("uv_bits = 10", "uv_bits = 17", ":2: asset \"fleet\": uv_bits: 1 to 16"),
        ("4.5", "181", "normal_tolerance: 0 to 180"),
        ("\"melax\"", "\"best\"", "metric: qem or melax"),
        ("0.25", "0.7", "round_size: heap, or a share"),
        ("\"zstd\"", "\"gzip\"", "codec: range or zstd"),
        ("ship.gltf\"\n        uv", "no.gltf\"\n        uv", "no.gltf: cannot be read"),
    ] {
        let message = parse(&at, &text.replacen(from, to, 1)).unwrap_err().to_string();
        assert!(message.contains(fragment), "{message:?} lacks {fragment:?}");
    }
}
