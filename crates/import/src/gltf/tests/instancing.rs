//! Nodes with several instances of their mesh.

use lodestream_scene::placement::Placement;
use serde_json::{Value, json};
use tempfile::TempDir;

use super::{BYTE, Model, contents, places, write};

/// A quad in three places: unchanged, moved and turned by half a turn about y, moved and enlarged.
fn thrice() -> Model {
    let mut model = Model::quad();
    let translations = model.floats("VEC3", 3, &[0., 0., 0., 10., 0., 0., 20., 0., 0.]);
    let rotations = model.accessor(BYTE, "VEC4", 3, &[0, 0, 0, 127, 0, 127, 0, 0, 0, 0, 0, 127]);
    model.json["accessors"][rotations]["normalized"] = json!(true);
    let scales = model.floats("VEC3", 3, &[1., 1., 1., 1., 1., 1., 2., 2., 2.]);
    let attributes = json!({"TRANSLATION": translations, "ROTATION": rotations, "SCALE": scales, "_ID": 0});
    model.json["nodes"][0] = json!({
        "mesh": 0, "translation": [0, 5, 0], "extensions": {"EXT_mesh_gpu_instancing": {"attributes": attributes}},
    });
    model.json["extensionsUsed"] = json!(["EXT_mesh_gpu_instancing"]);
    model.json["extensionsRequired"] = json!(["EXT_mesh_gpu_instancing"]);
    model
}

#[test]
fn a_mesh_is_placed_at_each_of_its_nodes_instances() {
    let imported = thrice().read().unwrap();
    assert!(imported.warnings.is_empty(), "{:?}", imported.warnings);
    let faces = places(&imported);
    assert_eq!(faces.len(), 6);
    assert_eq!(faces[0], [[0., 5., 0.], [1., 5., 0.], [1., 6., 0.]]);
    let near = |a: [f64; 3], b: [f64; 3]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-6);
    assert!(near(faces[2][1], [9., 5., 0.]), "{:?}", faces[2]);
    assert_eq!(faces[4][2], [22., 7., 0.]);
    // As a scene: one mesh, three instances.
    let dir = TempDir::new().unwrap();
    let contents = contents(&write(&dir, "a.glb", thrice().glb()), None).unwrap();
    assert_eq!(contents.names.len(), 1);
    let [first, second, third] = &contents.placed[..] else { panic!("{:?}", contents.placed) };
    assert!(first.part == second.part && second.part == third.part);
    assert_eq!(second.placement.translation, [10., 5., 0.]);
    assert_eq!(third.placement, Placement { scale: 2.0, ..Placement::at([20., 5., 0.]) });
}

#[test]
fn malformed_instancing_is_refused_by_name() {
    let with = |path: &str, value: Value| {
        let mut model = thrice();
        *model.json.pointer_mut(path).unwrap() = value;
        model
    };
    let extension = "/nodes/0/extensions/EXT_mesh_gpu_instancing";
    let name = "nodes[0].extensions.EXT_mesh_gpu_instancing";
    with(extension, json!({"attributes": 7})).refused(&[name, "not understood"]);
    with(extension, json!({})).refused(&[name, "has no TRANSLATION"]);
    with(extension, json!({"attributes": {"SCALE": 99}})).refused(&[name, "SCALE", "accessors[99]"]);
    with(extension, json!({"attributes": {"ROTATION": 2}})).refused(&[name, "ROTATION", "Vec3"]);
    with("/accessors/2/count", json!(2)).refused(&[name, "different lengths"]);
    // Values without bytes, each of which would make a mesh.
    let mut many = thrice();
    many.json["accessors"][4] = json!({"componentType": 5126, "type": "VEC3", "count": 60_000});
    many.json.pointer_mut(extension).unwrap()["attributes"] = json!({"SCALE": 4});
    many.refused(&[name, "60000 places in 0 bytes"]);
    let mut lost = thrice();
    let translations = lost.floats("VEC3", 3, &[0., 0., 0., f32::INFINITY, 0., 0., 0., 0., 0.]);
    lost.json.pointer_mut(extension).unwrap()["attributes"]["TRANSLATION"] = json!(translations);
    lost.refused(&["nodes[0]", "not finite"]);
}
