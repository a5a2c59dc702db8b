//! Meshes that follow joints of which some move.

use glam::DVec3;
use lodestream_geometry::mesh::skin::Skin;
use lodestream_scene::animation::SkinPose;
use serde_json::json;
use tempfile::TempDir;

use super::{Model, UBYTE, USHORT, contents, places, write};
use crate::gltf::Contents;
use crate::{CreaseAngle, Imported, import_part};

/// A quad whose left vertices follow one joint and whose right ones a second below it, which moves by (0, 0, 5) in a second.
fn arm() -> Model {
    let mut model = Model::quad();
    let joints = model.accessor(UBYTE, "VEC4", 4, &[0, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0]);
    let weights = [[1., 0., 0., 0.], [1., 0., 0., 0.], [1., 0., 0., 0.], [0.5, 0.5, 0., 0.]].concat();
    let weights = model.floats("VEC4", 4, &weights);
    let unmoved = [1., 0., 0., 0., 0., 1., 0., 0., 0., 0., 1., 0., 0., 0., 0., 1.];
    let mut second = unmoved;
    second[12] = -1.0;
    let inverse = model.floats("MAT4", 16, &[unmoved, second].concat());
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
    model.json["animations"] = json!([]);
    let times = model.floats("SCALAR", 1, &[0.0, 1.0]);
    let values = model.floats("VEC3", 3, &[3., 0., 0., 3., 0., 5.]);
    model.push(
        "animations",
        json!({
            "channels": [{"sampler": 0, "target": {"node": 3, "path": "translation"}}],
            "samplers": [{"input": times, "output": values}],
        }),
    );
    model
}

/// What a file contains, and the mesh that it places first.
fn read(model: &Model) -> (Contents, Imported) {
    let dir = TempDir::new().unwrap();
    let path = write(&dir, "a.glb", model.glb());
    let found = contents(&path, None).unwrap();
    let part = import_part(&path, &found.placed[0].part, CreaseAngle::default()).unwrap();
    (found, part)
}

/// Where a pose has the vertices of the faces.
fn posed(imported: &Imported, pose: &SkinPose) -> Vec<[[f64; 3]; 3]> {
    let at = |position: u32| {
        let (place, skin) =
            (imported.mesh.positions[position as usize], imported.mesh.skins[position as usize]);
        let [x, y, z] = pose.apply(skin.influences(), DVec3::from(place)).to_array();
        [x, y, z].map(|x| (x * 1e6).round() / 1e6)
    };
    imported.mesh.faces.iter().map(|face| face.map(|corner| at(corner.position))).collect()
}

#[test]
fn a_mesh_that_follows_joints_is_in_its_bind_pose_and_its_joints_take_it_where_gltf_says() {
    let (found, part) = read(&arm());
    assert!(found.warnings.is_empty(), "{:?}", found.warnings);
    // About where the first joint rests.
    assert_eq!(places(&part)[0], [[0., 7., 0.], [1., 7., 0.], [1., 8., 0.]]);
    let half = Skin::new([(0, 0.5), (1, 0.5)]);
    assert!(part.mesh.skins.contains(&half) && part.mesh.skins.contains(&Skin::new([(1, 1.0)])));
    let animation = found.animation.unwrap();
    assert_eq!((&animation.placed[..], animation.model.parts.len()), (&[0][..], 0));
    // At rest as a mesh whose joints never move: see the poses' tests.
    let rest = posed(&part, &animation.model.poses_at(None, 0.0)[0]);
    assert_eq!(rest[0], [[0., 7., 0.], [3., 7., 0.], [3., 9., 0.]]);
    let moved = posed(&part, &animation.model.poses_at(animation.model.clips.first(), 0.5)[0]);
    assert_eq!(moved[0], [[0., 7., 0.], [3., 7., 2.5], [3., 9., 2.5]]);
    // Half of (0, 8, 0), and half of (2, 9, 2.5); eight bits of weight.
    let between = DVec3::from(moved[1][2]).distance(DVec3::new(1.0, 8.5, 1.25));
    assert!(between < 0.01, "{moved:?}");
    // Errors are measured in the pose that differs most.
    assert!(!part.mesh.poses.is_empty() && part.mesh.poses[0].len() == 2);
}

#[test]
fn files_without_a_skeleton_that_moves_are_as_before() {
    let mut still = arm();
    still.json["animations"] = json!([]);
    let (found, part) = read(&still);
    assert!(found.animation.is_none() && part.mesh.skins.is_empty() && part.mesh.poses.is_empty());
    assert_eq!(places(&part)[0], [[0., 7., 0.], [3., 7., 0.], [3., 9., 0.]]);
    // What moves is no joint.
    let mut other = arm();
    other.json["animations"][0]["channels"][0]["target"]["node"] = json!(0);
    let (_, part) = read(&other);
    assert!(part.mesh.skins.is_empty());
    // All of a file as one mesh stands still, as its joints rest.
    let whole = arm().read().unwrap();
    assert!(whole.mesh.skins.is_empty());
    assert_eq!(places(&whole)[0], [[0., 7., 0.], [3., 7., 0.], [3., 9., 0.]]);
}

#[test]
fn a_node_above_all_joints_moves_them_and_the_mesh_of_two_nodes_follows_once_each() {
    let mut model = arm();
    model.json["animations"][0]["channels"][0]["target"]["node"] = json!(1);
    model.json["nodes"].as_array_mut().unwrap().push(json!({"mesh": 0, "skin": 0}));
    model.json["scenes"][0]["nodes"] = json!([0, 1, 4]);
    let (found, part) = read(&model);
    let animation = found.animation.unwrap();
    assert_eq!((&animation.placed[..], animation.model.skins.len()), (&[0, 1][..], 2));
    let poses = animation.model.poses_at(animation.model.clips.first(), 1.0);
    assert_eq!(poses[0], poses[1]);
    // From (0, 7, 0) to (3, 0, 5).
    assert_eq!(posed(&part, &poses[0])[0][0], [3., 0., 5.]);
}

#[test]
fn skeletons_that_vertices_cannot_name_or_that_vanish_stand_still_with_a_warning() {
    let mut large = arm();
    let joints: Vec<usize> = [2, 3].into_iter().chain((0..255).map(|_| 3)).collect();
    large.json["skins"][0] = json!({"joints": joints});
    let mut flat = arm();
    flat.json["nodes"][2]["scale"] = json!([1, 0, 1]);
    for model in [large, flat] {
        let (found, part) = read(&model);
        assert!(found.animation.is_none() && part.mesh.skins.is_empty());
        assert!(found.warnings[0].contains("skins (stand still): 1"), "{:?}", found.warnings);
    }
    // Joints in words, of which some do not exist.
    let mut words = arm();
    let bytes: Vec<u8> = [0_u16, 700, 0, 0].map(u16::to_le_bytes).concat().repeat(4);
    let joints = words.accessor(USHORT, "VEC4", 4, &bytes);
    words.attribute("JOINTS_0", joints);
    let (_, part) = read(&words);
    assert!(part.mesh.skins.iter().all(|skin| *skin == Skin::default()));
}
