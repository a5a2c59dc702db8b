//! Meshes with skins and morph targets: they stand as the file's nodes pose them.

use serde_json::json;
use tempfile::TempDir;

use super::{FLOAT, Model, UBYTE, UINT, contents, normal, places, write};
use crate::{CreaseAngle, Part, import_part};

/// The columns of a translation, as files have them.
fn moved(by: [f32; 3]) -> [f32; 16] {
    let [x, y, z] = by;
    [1., 0., 0., 0., 0., 1., 0., 0., 0., 0., 1., 0., x, y, z, 1.]
}

/// A quad whose left vertices follow one joint and whose right ones another. Its own node is far away.
fn skinned() -> Model {
    let mut model = Model::quad();
    let joints = model.accessor(UBYTE, "VEC4", 4, &[0, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0]);
    let weights = model.floats("VEC4", 4, &[1., 0., 0., 0.].repeat(4));
    let inverse = model.floats("MAT4", 16, &[moved([0.; 3]), moved([-1., 0., 0.])].concat());
    model.attribute("JOINTS_0", joints);
    model.attribute("WEIGHTS_0", weights);
    model.json["skins"] = json!([{"joints": [2, 3], "inverseBindMatrices": inverse}]);
    model.json["nodes"] = json!([
        {"mesh": 0, "skin": 0, "translation": [100, 0, 0]},
        {"children": [2], "translation": [0, 7, 0]},
        {"children": [3]},
        {"translation": [3, 0, 0], "scale": [1, 2, 1]},
    ]);
    model.json["scenes"][0]["nodes"] = json!([0, 1]);
    model
}

#[test]
fn a_skinned_mesh_stands_where_its_joints_are() {
    let imported = skinned().read().unwrap();
    assert!(imported.warnings.is_empty(), "{:?}", imported.warnings);
    // The right side is two high, and its joint three to the right.
    let [first, second] = places(&imported)[..] else { panic!() };
    assert_eq!(first, [[0., 7., 0.], [3., 7., 0.], [3., 9., 0.]]);
    assert_eq!(second, [[0., 7., 0.], [3., 9., 0.], [0., 8., 0.]]);
    // As a part of a scene as well.
    let dir = TempDir::new().unwrap();
    let path = write(&dir, "a.glb", skinned().glb());
    let found = contents(&path, None).unwrap();
    assert_eq!(found.placed[0].placement.translation, [0.0; 3]);
    assert_eq!(found.sizes, [None], "what the accessors state is not its size");
    let part = import_part(&path, &found.placed[0].part, CreaseAngle::default()).unwrap();
    assert_eq!(places(&part), places(&imported));
}

#[test]
fn normals_and_winding_follow_the_joints() {
    let mut model = skinned();
    let normals = model.floats("VEC3", 3, &[0., 0., 1.].repeat(4));
    model.attribute("NORMAL", normals);
    // A quarter of a turn about x, and a mirror.
    model.json["nodes"][1]["rotation"] = json!([0.5_f64.sqrt(), 0, 0, 0.5_f64.sqrt()]);
    let turned = model.read().unwrap();
    model.json["nodes"][1]["scale"] = json!([-1, 1, 1]);
    let mirrored = model.read().unwrap();
    for imported in [turned, mirrored] {
        for (face, place) in imported.mesh.faces.iter().zip(places(&imported)) {
            for corner in face {
                let [x, y, z] = imported.mesh.normals[corner.normal as usize];
                assert!(x.abs() < 1e-6 && (y + 1.0).abs() < 1e-6 && z.abs() < 1e-6, "{x} {y} {z}");
            }
            assert!(normal(place).y < 0.0, "the face turns as its normals do");
        }
    }
}

#[test]
fn weights_count_in_proportion_and_joints_that_are_missing_do_not() {
    let mut model = skinned();
    let joints = model.accessor(UBYTE, "VEC4", 4, &[0, 1, 0, 0].repeat(4));
    let weights =
        model.floats("VEC4", 4, &[0.5, 0.5, 0., 0., 2., 2., 0., 0., 0., 0., 0., 0., 0., 1., 0., 0.]);
    model.attribute("JOINTS_0", joints);
    model.attribute("WEIGHTS_0", weights);
    let imported = model.read().unwrap();
    let [first, second] = places(&imported)[..] else { panic!() };
    // Half of (0, 7) and half of (2, 7); half of (1, 7) and half of (3, 7); nobody's: the first joint's; the second's.
    assert_eq!(first, [[1., 7., 0.], [2., 7., 0.], [1., 8., 0.]]);
    assert_eq!(second[2], [2., 9., 0.]);
    let far = model.accessor(UBYTE, "VEC4", 4, &[0, 9, 0, 0].repeat(4));
    model.attribute("JOINTS_0", far);
    assert_eq!(places(&model.read().unwrap())[0][0], [0., 7., 0.]);
}

#[test]
fn a_mesh_in_two_poses_is_two() {
    let mut model = skinned();
    model.json["meshes"][0]["name"] = json!("body");
    model.json["skins"].as_array_mut().unwrap().push(json!({"joints": [1, 1]}));
    let nodes = model.json["nodes"].as_array_mut().unwrap();
    nodes.push(json!({"mesh": 0, "translation": [50, 0, 0]}));
    nodes.push(json!({"mesh": 0, "skin": 1}));
    nodes.push(json!({"mesh": 0, "skin": 0}));
    model.json["scenes"][0]["nodes"] = json!([0, 1, 4, 5, 6]);
    let imported = model.read().unwrap();
    let first: Vec<_> = places(&imported).iter().step_by(2).map(|face| face[1]).collect();
    assert_eq!(first, [[3., 7., 0.], [51., 0., 0.], [1., 7., 0.], [3., 7., 0.]]);
    let dir = TempDir::new().unwrap();
    let found = contents(&write(&dir, "a.glb", model.glb()), None).unwrap();
    assert_eq!(found.names, ["body", "body-2", "body-3"]);
    let meshes: Vec<usize> = found.placed.iter().map(|placed| placed.mesh).collect();
    assert_eq!(meshes, [0, 1, 2, 0]);
    assert!(matches!(found.placed[3].part, Part::Mesh { mesh: 0, .. }));
}

#[test]
fn skins_that_name_what_is_not_there_are_left_out_with_a_warning() {
    for (path, value) in [
        ("/skins/0/joints", json!([2, 9])),
        ("/skins/0/joints", json!([])),
        ("/skins/0/joints", json!([1, 2, 3])),
        ("/skins/0/inverseBindMatrices", json!(99)),
        ("/nodes/0/skin", json!(7)),
        ("/meshes/0/primitives/0/attributes/JOINTS_0", json!(null)),
    ] {
        let mut model = skinned();
        let slot = model.json.pointer_mut(path).unwrap();
        *slot = value;
        if slot.is_null() {
            model.primitive()["attributes"].as_object_mut().unwrap().remove("JOINTS_0");
        }
        let imported = model.read().unwrap();
        assert_eq!(places(&imported)[0][0], [100., 0., 0.], "{path}");
        let [warning] = &imported.warnings[..] else { panic!("{path}: {:?}", imported.warnings) };
        assert!(warning.contains("1 nodes have skins"), "{warning}");
    }
    let mut short = skinned();
    let weights = short.floats("VEC4", 4, &[1., 0., 0., 0.].repeat(2));
    short.attribute("WEIGHTS_0", weights);
    short.refused(&["JOINTS and WEIGHTS have fewer elements"]);
    // Nodes in a circle, outside of the scene.
    let mut circle = skinned();
    circle.json["nodes"][1] = json!({"children": [2]});
    circle.json["nodes"][3] = json!({"children": [2]});
    circle.json["scenes"][0]["nodes"] = json!([0]);
    assert_eq!(circle.read().unwrap().mesh.faces.len(), 2);
}

/// A quad with two morph targets: one lifts its first vertex and turns its normal, one moves all to the right.
fn morphed() -> Model {
    let mut model = Model::quad();
    let normals = model.floats("VEC3", 3, &[0., 0., 1.].repeat(4));
    model.attribute("NORMAL", normals);
    let value = model.view(&[0.0_f32, 0., 8.].map(f32::to_le_bytes).concat());
    let index = model.view(&0_u32.to_le_bytes());
    let lift = model.push(
        "accessors",
        json!({"componentType": FLOAT, "type": "VEC3", "count": 4, "sparse": {"count": 1,
            "indices": {"bufferView": index, "componentType": UINT}, "values": {"bufferView": value}}}),
    );
    let turn = model.floats("VEC3", 3, &[0., 2., -2.].repeat(4));
    let right = model.floats("VEC3", 3, &[4., 0., 0.].repeat(4));
    model.primitive()["targets"] = json!([{"POSITION": lift, "NORMAL": turn}, {"POSITION": right}]);
    model
}

#[test]
fn default_weights_of_morph_targets_are_applied() {
    let mut model = morphed();
    assert_eq!(places(&model.read().unwrap())[0][0], [0.0; 3]);
    assert!(model.read().unwrap().warnings[0].contains("morph targets"));
    model.json["meshes"][0]["weights"] = json!([0.5, 0.25]);
    let imported = model.read().unwrap();
    assert!(imported.warnings.is_empty(), "{:?}", imported.warnings);
    assert_eq!(places(&imported)[0], [[1., 0., 4.], [2., 0., 0.], [2., 1., 0.]]);
    assert_eq!(imported.mesh.normals[0], [0.0, 1.0, 0.0]);
    // A node's weights come first, and the node's place counts.
    model.json["nodes"][0] = json!({"mesh": 0, "weights": [0, 0.5], "translation": [0, 0, 9]});
    assert_eq!(places(&model.read().unwrap())[0][0], [2., 0., 9.]);
    // A file without scenes is a list of meshes.
    model.json["nodes"] = json!([]);
    model.json["scenes"] = json!([]);
    model.json.as_object_mut().unwrap().remove("scene");
    assert_eq!(places(&model.read().unwrap())[0][0], [1., 0., 4.]);
}

#[test]
fn morph_targets_move_a_mesh_before_its_joints_do() {
    let mut model = skinned();
    let up = model.floats("VEC3", 3, &[0., 1., 0.].repeat(4));
    model.primitive()["targets"] = json!([{"POSITION": up}]);
    model.json["meshes"][0]["weights"] = json!([1.0]);
    // Twice as high on the right.
    assert_eq!(places(&model.read().unwrap())[0], [[0., 8., 0.], [3., 9., 0.], [3., 11., 0.]]);
}

#[test]
fn malformed_morph_targets_are_refused_by_name_and_many_are_left_out() {
    let mut model = morphed();
    model.json["meshes"][0]["weights"] = json!([1.0]);
    let short = model.floats("VEC3", 3, &[0.; 6]);
    model.primitive()["targets"] = json!([{"POSITION": short}]);
    model.refused(&["targets[0].POSITION", "fewer elements"]);
    model.primitive()["targets"] = json!([{"NORMAL": 99}]);
    model.refused(&["targets[0].NORMAL", "accessors[99] does not exist"]);
    let up = model.floats("VEC3", 3, &[0., 1., 0.].repeat(4));
    model.primitive()["targets"] = json!(vec![json!({"POSITION": up}); 100]);
    model.json["meshes"][0]["weights"] = json!([1.0].repeat(100));
    let imported = model.read().unwrap();
    assert_eq!(places(&imported)[0][0], [0., 64., 0.]);
    assert!(imported.warnings[0].contains("morph targets"), "{:?}", imported.warnings);
}
