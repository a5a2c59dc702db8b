//! Parts of a whole file: each placed mesh is one, with all its primitives.

use serde_json::json;
use tempfile::TempDir;

use super::{Model, write};
use crate::gltf::{CopyTolerance, contents};

/// A quad that is placed by these nodes, all roots, and another mesh of two such quads.
fn placed(nodes: serde_json::Value) -> Model {
    let mut model = Model::quad();
    let primitive = model.primitive().clone();
    model.push("meshes", json!({"primitives": [primitive, primitive], "name": "pair"}));
    let all: Vec<usize> = (0..nodes.as_array().unwrap().len()).collect();
    model.json["nodes"] = nodes;
    model.json["scenes"][0]["nodes"] = json!(all);
    model
}

#[test]
fn every_placed_mesh_is_a_part_whose_number_finds_its_name() {
    let model = placed(json!([
        {"mesh": 0, "name": "door", "extras": {"fire": 30}},
        {"mesh": 1, "translation": [3, 0, 0]},
        // Nothing is left of it, and it counts as no part.
        {"mesh": 0, "name": "gone", "scale": [1, 0, 0]},
        // A flat one is drawn.
        {"mesh": 0, "name": "flat", "scale": [1, 1, 0]},
        {"mesh": 0, "name": "door again", "translation": [6, 0, 0]},
    ]));
    assert_eq!(model.read().unwrap().mesh.parts, [0, 0, 1, 1, 1, 1, 2, 2, 3, 3]);
    let dir = TempDir::new().unwrap();
    let path = write(&dir, "a.glb", model.glb());
    for copies in [None, Some(CopyTolerance::Length(1e-3))] {
        let contents = contents(&path, copies).unwrap();
        let parts = contents.merged_parts().unwrap();
        let infos: Vec<_> = parts.map(|(node, mesh)| contents.part_names.of(node, mesh)).collect();
        let names: Vec<&str> = infos.iter().map(|info| &*info.name).collect();
        assert_eq!(names, ["door", "pair", "flat", "door again"]);
        assert_eq!(infos[0].extras.as_deref(), Some("{\"fire\":30}"));
    }
}

#[test]
fn a_file_that_places_one_mesh_has_no_parts() {
    let model = placed(json!([{"mesh": 1}]));
    let imported = model.read().unwrap();
    assert_eq!((imported.mesh.faces.len(), imported.mesh.parts.len()), (4, 0));
    let dir = TempDir::new().unwrap();
    assert!(contents(&write(&dir, "a.glb", model.glb()), None).unwrap().merged_parts().is_none());
}
