//! glTF files in scenes: meshes as assets, nodes as instances.

use std::path::PathBuf;

use crate::preparation_settings::{Precision, Round};
use lodestream_geometry::Codec;
use lodestream_import::Part;
use tempfile::TempDir;

use super::{Scene, of_files, parse};

/// Two meshes, "hull" and "mast" (placed twice, once mirrored), of one triangle each, which differ.
fn ship(dir: &TempDir) -> PathBuf {
    let bytes: Vec<u8> =
        [0f32, 0., 0., 1., 0., 0., 0., 1., 0., 5., 0., 0.].iter().flat_map(|v| v.to_le_bytes()).collect();
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
            {"name": "mast", "primitives": [{"attributes": {"POSITION": 1}}]},
        ],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "type": "VEC3", "count": 3},
            {"bufferView": 0, "byteOffset": 12, "componentType": 5126, "type": "VEC3", "count": 3},
        ],
        "bufferViews": [{"buffer": 0, "byteLength": 48}],
        "buffers": [{"byteLength": 48, "uri": format!("data:;base64,{data}")}],
    });
    let path = dir.path().join("ship.gltf");
    std::fs::write(&path, text.to_string()).unwrap();
    path
}

fn names(scene: &Scene) -> Vec<&str> {
    scene.assets.iter().map(|asset| asset.name.as_str()).collect()
}

#[test]
fn gltf_meshes_are_placed_by_their_nodes() {
    let dir = TempDir::new().unwrap();
    let scene = of_files(&[ship(&dir)]).unwrap();
    assert_eq!(scene.name, "ship");
    assert_eq!(names(&scene), ["ship/hull", "ship/mast", "ship/mast-2"]);
    let [model] = &scene.models[..] else { panic!("{:?}", scene.models) };
    let model = &model.parts;
    assert_eq!(model.iter().map(|i| i.asset).collect::<Vec<_>>(), [0, 1, 2]);
    assert_eq!((model[1].placement.translation, model[1].placement.scale), ([1.0, 2.0, 3.0], 2.0));
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
    let preparation_settings = scene.assets[1].preparation_settings;
    assert_eq!(
        (preparation_settings.uv_bits, preparation_settings.normal_tolerance),
        ("10".parse().ok(), "4.5".parse().ok())
    );
    assert_eq!(preparation_settings.round, Round::try_from(0.25).ok());
    assert_eq!(
        (preparation_settings.codec, scene.assets[4].preparation_settings.codec),
        (Some(Codec::Zstd.into()), None)
    );
    assert_eq!(scene.assets[3].preparation_settings.precision, "9".parse().ok().map(Precision::Bits));
    assert_eq!(scene.assets[4].preparation_settings.round, Some(Round::Heap));
    let instances = scene.instances.unwrap();
    assert_eq!(instances.iter().map(|i| i.asset).collect::<Vec<_>>(), [0, 1, 2, 3, 4]);
    // A quarter turn about y takes (1, 2, 3) to (3, 2, -1); the instance scales that by three and moves it.
    let expected = [19.0, 6.0, -3.0];
    for (found, expected) in instances[1].placement.translation.iter().zip(expected) {
        assert!((found - expected).abs() < 1e-5, "{:?}", instances[1].placement.translation);
    }
    assert_eq!(instances[1].placement.scale, 6.0);
    for (from, to, fragment) in [
        ("mesh = \"mast\"", "mesh = \"sail\"", "no mesh named \"sail\"; it has 2: hull, mast"),
        ("mesh = \"mast\"", "mesh = \"mast\"\nmerge = true", "exclude each other"),
        ("uv_bits = 10", "uv_bits = 17", ":2: asset \"fleet\": uv_bits: 1 to 16"),
        ("4.5", "181", "normal_tolerance: 0 to 180"),
        ("\"melax\"", "\"best\"", "metric: qem, melax, clustering or clustering-seams"),
        ("0.25", "0.7", "round_size: heap, or a share"),
        ("\"zstd\"", "\"gzip\"", "codec: auto, range, axis-aligned or zstd"),
        ("ship.gltf\"\n        uv", "no.gltf\"\n        uv", "no.gltf: cannot be read"),
    ] {
        let message = parse(&at, &text.replacen(from, to, 1)).unwrap_err().to_string();
        assert!(message.contains(fragment), "{message:?} lacks {fragment:?}");
    }
}

#[test]
fn models_with_the_name_of_a_numbered_duplicate_stay_distinct() {
    let named = |files: &[&str]| {
        let files: Vec<PathBuf> = files.iter().map(PathBuf::from).collect();
        let names: Vec<String> =
            of_files(&files).unwrap().assets.into_iter().map(|asset| asset.name).collect();
        names
    };
    assert_eq!(named(&["chair-2.obj", "chair.obj"]), ["chair-2", "chair"]);
    assert_eq!(named(&["a/chair.obj", "b/chair.obj", "chair-2.obj"]), ["chair", "chair-2", "chair-2-2"]);
    assert_eq!(named(&["a/chair.obj", "chair-2.obj", "b/chair.obj"]), ["chair", "chair-2", "chair-3"]);
}

#[test]
fn meshes_with_the_name_of_a_numbered_form_stay_distinct() {
    let dir = TempDir::new().unwrap();
    let path = ship(&dir);
    // "mast" is placed twice, once mirrored: its second form is "mast-2".
    let text = std::fs::read_to_string(&path).unwrap().replace("hull", "mast-2");
    std::fs::write(&path, text).unwrap();
    assert_eq!(
        names(&of_files(std::slice::from_ref(&path)).unwrap()),
        ["ship/mast-2", "ship/mast", "ship/mast-3"]
    );
    // A scene file's own names stay, wherever they stand.
    let text = "[[asset]]\nname = 'ship'\nfile = 'ship.gltf'\n\
        [[asset]]\nname = 'ship/mast'\nfile = 'ship.gltf'\nmerge = true\n\
        [[instance]]\nasset = 'ship/mast'\n";
    let scene = parse(&dir.path().join("scene.toml"), text).unwrap();
    assert_eq!(names(&scene), ["ship/mast-2", "ship/mast-3", "ship/mast-4", "ship/mast"]);
}

/// In f32, coordinates of a map have steps of half a metre.
#[test]
fn boxes_at_the_coordinates_of_a_map_stand_to_the_micrometre() {
    let dir = TempDir::new().unwrap();
    let path = ship(&dir);
    let mut file: serde_json::Value = serde_json::from_slice(&std::fs::read(&path).unwrap()).unwrap();
    let place = |n: u32| [408_201.25 + 0.05 * f64::from(n), 112.0, 4_080_928.5];
    let node = |n: u32| serde_json::json!({"mesh": 0, "translation": place(n), "scale": [0.03, 0.03, 0.03]});
    let nodes: Vec<_> = (0..40).map(node).collect();
    file["nodes"] = serde_json::json!(nodes);
    file["scenes"][0]["nodes"] = serde_json::json!((0..40).collect::<Vec<u32>>());
    std::fs::write(&path, file.to_string()).unwrap();
    let scene = of_files(&[path]).unwrap();
    assert_eq!(scene.assets.len(), 1);
    let near = |a: [f64; 3], b: [f64; 3]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-6);
    for (part, n) in scene.models[0].parts.iter().zip(0..) {
        assert!(near(part.placement.translation, place(n)), "{n}: {part:?}");
    }
    // And as what a client gets.
    let sphere = lodestream_geometry::index::Sphere { center: [0.5, 0.5, 0.0], radius: 0.71 };
    let entry = lodestream_scene::description::AssetEntry { sphere, ..Default::default() };
    let composed = crate::compose::compose(&scene, &[entry], &[]).unwrap();
    let mut composed: Vec<[f64; 3]> =
        composed.pages.iter().flat_map(|page| &page.instances).map(|i| i.placement.translation).collect();
    composed.sort_by(|a, b| a[0].total_cmp(&b[0]));
    assert!(composed.len() == 40 && (0..).zip(&composed).all(|(n, at)| near(*at, place(n))), "{composed:?}");
}
