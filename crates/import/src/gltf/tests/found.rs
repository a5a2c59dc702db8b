//! Files as programs write them, against the specification: they are read, with a warning where something is odd.

use serde_json::json;
use tempfile::TempDir;

use super::{Model, contents, write};
use crate::{Imported, dependencies, import};

/// A GLB of two chunks as they are, without padding between.
fn glb(text: &[u8], bin: &[u8], gap: usize) -> Vec<u8> {
    let length = 12 + 8 + text.len() + gap + 8 + bin.len();
    let mut out = b"glTF".to_vec();
    out.extend(2u32.to_le_bytes());
    out.extend((length as u32).to_le_bytes());
    for (kind, bytes, after) in [(b"JSON", text, gap), (b"BIN\0", bin, 0)] {
        out.extend((bytes.len() as u32).to_le_bytes());
        out.extend(kind);
        out.extend(bytes);
        out.extend(vec![0; after]);
    }
    out
}

fn read(bytes: &[u8]) -> Imported {
    let dir = TempDir::new().unwrap();
    let path = write(&dir, "a.glb", bytes);
    let imported = import(&path).unwrap();
    // Each part tells them.
    assert!(contents(&path, None).unwrap().warnings.is_empty());
    imported
}

/// The JSON of a quad, of a length that is `more` above a multiple of 4.
fn text(model: &Model, more: usize) -> Vec<u8> {
    let mut text = model.json.to_string().into_bytes();
    while text.len() % 4 != more {
        text.push(b' ');
    }
    text
}

#[test]
fn chunks_whose_lengths_are_no_multiples_of_4_are_read_with_a_warning() {
    let model = Model::quad();
    for more in 1..4 {
        // The next chunk follows at once, or at a multiple of 4.
        for gap in [0, 4 - more] {
            let imported = read(&glb(&text(&model, more), &model.bin, gap));
            assert_eq!(imported.mesh.faces.len(), 2);
            let [warning] = &imported.warnings[..] else { panic!("{:?}", imported.warnings) };
            assert!(warning.contains("no multiples of 4"), "{warning}");
        }
    }
    let imported = read(&glb(&text(&model, 0), &[&model.bin[..], &[0]].concat(), 0));
    assert_eq!((imported.mesh.faces.len(), imported.warnings.len()), (2, 1));
}

#[test]
fn json_padded_with_zero_bytes_is_read_with_a_warning_and_white_space_without() {
    let model = Model::quad();
    for (padding, warnings) in [(&b"\0\0\0\0"[..], 1), (b" \0 \n\0\0", 1), (b"\r\n\t ", 0)] {
        let mut text = [model.json.to_string().as_bytes(), padding].concat();
        while text.len() % 4 != 0 {
            text.push(padding[padding.len() - 1]);
        }
        let imported = read(&glb(&text, &model.bin, 0));
        assert_eq!((imported.mesh.faces.len(), imported.warnings.len()), (2, warnings), "{padding:?}");
    }
}

#[test]
fn boxes_far_from_the_origin_stand_to_the_micrometre() {
    let mut model = Model::quad();
    let place = |n: u32| [408_201.25 + 0.05 * f64::from(n), 112.0, 4_080_928.5];
    let mut nodes: Vec<_> =
        (0..20).map(|n| json!({"mesh": 0, "translation": place(n), "scale": [0.03, 0.03, 0.03]})).collect();
    let [x, y, z] = place(20);
    nodes.push(json!({"mesh": 0, "matrix": [0.03, 0, 0, 0, 0, 0.03, 0, 0, 0, 0, 0.03, 0, x, y, z, 1]}));
    model.json["nodes"] = json!(nodes);
    model.json["scenes"][0]["nodes"] = json!((0..21).collect::<Vec<u32>>());
    let imported = model.read().unwrap();
    let dir = TempDir::new().unwrap();
    let placed = contents(&write(&dir, "a.glb", model.glb()), None).unwrap().placed;
    for n in 0..21 {
        let face = imported.mesh.faces[2 * n as usize];
        let [low, high] = [face[0], face[1]].map(|corner| imported.mesh.positions[corner.position as usize]);
        let expected = place(n);
        for axis in 0..3 {
            assert!((low[axis] - expected[axis]).abs() < 1e-6, "{n}: {low:?}");
            let end = expected[axis] + if axis == 0 { 0.03 } else { 0.0 };
            assert!((high[axis] - end).abs() < 1e-6, "{n}: {high:?}");
            assert!((placed[n as usize].placement.translation[axis] - expected[axis]).abs() < 1e-6, "{n}");
        }
    }
}

#[test]
fn pictures_and_buffers_that_are_not_where_they_are_said_to_be_are_found_beside_the_model() {
    let mut model = Model::quad();
    let uvs = model.floats("VEC2", 2, &[0., 0., 1., 0., 1., 1., 0., 1.]);
    model.attribute("TEXCOORD_0", uvs);
    model.push_material(json!({
        "pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}, "normalTexture": {"index": 1},
        "emissiveTexture": {"index": 2}, "emissiveFactor": [1, 1, 1],
    }));
    model.json["textures"] = json!([{"source": 0}, {"source": 1}, {"source": 2}]);
    model.json["images"] =
        json!([{"uri": "C:\\art\\Grey%20Wood.png"}, {"uri": "tex/BUMP.png"}, {"uri": "../../lamp.png"}]);
    model.json["buffers"][0]["uri"] = json!("Model.BIN");
    let dir = TempDir::new().unwrap();
    for name in ["grey wood.png", "bump.png", "lamp.png"] {
        write(&dir, name, name);
    }
    write(&dir, "model.bin", &model.bin);
    let path = write(&dir, "a.gltf", model.json.to_string());
    let imported = import(&path).unwrap();
    assert!(imported.warnings.is_empty(), "{:?}", imported.warnings);
    let maps = &imported.materials[0].maps;
    let names = [&maps.color, &maps.normal, &maps.emission].map(|image| image.clone().unwrap().path);
    assert_eq!(names, ["grey wood.png", "bump.png", "lamp.png"].map(|name| dir.path().join(name)));
    // With the places where they would be found first.
    let listed =
        ["Model.BIN", "model.bin", "grey wood.png", "tex/BUMP.png", "BUMP.png", "bump.png", "lamp.png"];
    assert_eq!(dependencies(&path, &std::fs::read(&path).unwrap()), listed.map(|name| dir.path().join(name)));
}
