//! Animations: what moves, and where it is at a time.

use std::f64::consts::PI;

use glam::{DQuat, DVec3};
use lodestream_scene::animation::{AnimatedModel, Interpolation};
use serde_json::{Value, json};
use tempfile::TempDir;

use super::{FLOAT, Model, SHORT, contents, write};
use crate::gltf::{Contents, CopyTolerance};

/// A quad on node 1, below node 0.
fn quad() -> Model {
    let mut model = Model::quad();
    model.json["nodes"] = json!([{"name": "base", "children": [1]}, {"mesh": 0}]);
    model.json["animations"] = json!([]);
    model
}

impl Model {
    /// Adds an animation of one channel.
    fn animate(&mut self, node: usize, path: &str, how: &str, times: &[f32], values: &[f32]) -> usize {
        let (shape, per) = if path == "rotation" { ("VEC4", 4) } else { ("VEC3", 3) };
        let (input, output) = (self.floats("SCALAR", 1, times), self.floats(shape, per, values));
        let animation = json!({
            "name": how, "channels": [{"sampler": 0, "target": {"node": node, "path": path}}],
            "samplers": [{"input": input, "output": output, "interpolation": how}],
        });
        self.push("animations", animation)
    }

    fn contents(&self) -> Contents {
        let dir = TempDir::new().unwrap();
        contents(&write(&dir, "a.glb", self.glb()), Some(CopyTolerance::Length(1e-4))).unwrap()
    }

    /// What moves, without a warning.
    fn animation(&self) -> AnimatedModel {
        let contents = self.contents();
        assert!(contents.warnings.is_empty(), "{:?}", contents.warnings);
        contents.animation.unwrap().model
    }

    /// The warning about animations of a file of which nothing can be played.
    fn still(&self, fragments: &[&str]) {
        let contents = self.contents();
        assert!(contents.animation.is_none(), "{:?}", contents.animation);
        let [warning] = &contents.warnings[..] else { panic!("{:?}", contents.warnings) };
        assert!(fragments.iter().all(|fragment| warning.contains(fragment)), "{warning}");
    }
}

/// Where the mesh's corner at (1, 0, 0) is at a time of a clip, by the placement and the movement within it.
fn corner(contents: &Contents, clip: usize, time_s: f64) -> DVec3 {
    let animation = contents.animation.as_ref().unwrap();
    let transform = animation.model.transforms_at(animation.model.clips.get(clip), time_s)[0];
    transform.within(&contents.placed[animation.placed[0]].placement).to_world(DVec3::X)
}

fn near(a: DVec3, b: [f64; 3]) -> bool {
    a.distance(b.into()) < 1e-6
}

#[test]
fn each_interpolation_puts_a_mesh_where_gltf_says() {
    let mut model = quad();
    model.json["nodes"][0]["translation"] = json!([0.0, 0.0, 5.0]);
    let times = [0.0, 2.0];
    model.animate(1, "translation", "LINEAR", &times, &[0., 0., 0., 4., 2., 0.]);
    model.animate(1, "translation", "STEP", &times, &[0., 0., 0., 4., 2., 0.]);
    let tangents = [[0.0; 3], [0.0; 3], [1., 0., 0.], [0., 1., 0.], [4., 2., 0.], [0.0; 3]].concat();
    model.animate(1, "translation", "CUBICSPLINE", &times, &tangents);
    let half = std::f32::consts::FRAC_1_SQRT_2;
    // The negative of a quarter turn is the same rotation.
    model.animate(0, "rotation", "LINEAR", &times, &[0., 0., 0., 1., 0., 0., -half, -half]);
    model.animate(0, "scale", "LINEAR", &times, &[1., 1., 1., 3., 3., 3.]);
    let contents = model.contents();
    assert!(contents.warnings.is_empty(), "{:?}", contents.warnings);
    let animation = &contents.animation.as_ref().unwrap().model;
    let names: Vec<&str> = animation.clips.iter().map(|clip| &*clip.name).collect();
    assert_eq!(names, ["LINEAR", "STEP", "CUBICSPLINE", "LINEAR-2", "LINEAR-3"]);
    assert_eq!(animation.clips[2].channels[0].interpolation, Interpolation::CubicSpline);
    assert!(near(corner(&contents, 0, 0.5), [2.0, 0.5, 5.0]));
    assert!(
        near(corner(&contents, 1, 1.999), [1.0, 0.0, 5.0])
            && near(corner(&contents, 1, 2.0), [5.0, 2.0, 5.0])
    );
    // At the middle: half of the value, an eighth of two seconds of the one tangent, minus that of the other.
    assert!(near(corner(&contents, 2, 1.0), [1.0 + 2.0 + 0.25, 1.0 - 0.25, 5.0]));
    let eighth = DQuat::from_rotation_z(PI / 4.0) * DVec3::X;
    assert!(near(corner(&contents, 3, 1.0), [eighth.x, eighth.y, 5.0]));
    assert!(near(corner(&contents, 4, 1.0), [2.0, 0.0, 5.0]));
}

#[test]
fn integers_stand_for_shares_and_unmoved_nodes_are_multiplied_out() {
    let mut model = quad();
    model.json["nodes"] = json!([
        {"name": "site", "translation": [1e7, 0.0, 0.0], "children": [1]},
        {"rotation": [0.0, 0.0, 1.0, 0.0], "children": [2]},
        {"children": [3], "scale": [2.0, 2.0, 2.0]},
        {"mesh": 0, "translation": [0.0, 1.0, 0.0]},
        {"mesh": 0},
    ]);
    model.json["scenes"][0]["nodes"] = json!([0, 4]);
    let times = model.floats("SCALAR", 1, &[0.0, 1.0]);
    let turns: Vec<u8> = [0_i16, 0, 0, 32767, 0, 0, 32767, 0].iter().flat_map(|x| x.to_le_bytes()).collect();
    let turns = model.accessor(SHORT, "VEC4", 2, &turns);
    model.json["accessors"][turns]["normalized"] = json!(true);
    model.push(
        "animations",
        json!({
            "channels": [{"sampler": 0, "target": {"node": 2, "path": "rotation"}}],
            "samplers": [{"input": times, "output": turns}],
        }),
    );
    let contents = model.contents();
    let animation = contents.animation.as_ref().unwrap();
    assert_eq!(
        (animation.model.nodes.len(), &animation.placed[..]),
        (1, &[0][..]),
        "one moves, with one mesh"
    );
    assert_eq!(animation.model.clips[0].name, "animation 0");
    // Half a turn above it, then none, then half a turn more.
    assert!(near(corner(&contents, 0, 0.0), [1e7 - 2.0, -2.0, 0.0]));
    assert!(near(corner(&contents, 0, 1.0), [1e7 + 2.0, 2.0, 0.0]), "{}", corner(&contents, 0, 1.0));
}

#[test]
fn copies_mirrors_and_uneven_scales_of_the_mesh_itself_move_as_they_are() {
    let mut model = quad();
    // The linear map of the mesh has shares that no placement has; the movement above it is even.
    for local in
        [json!({"scale": [-1.0, 2.0, 1.0]}), json!({"scale": [-2.0, 2.0, 2.0], "translation": [0, 3, 0]})]
    {
        model.json["nodes"][1] = local.clone();
        model.json["nodes"][1]["mesh"] = json!(0);
        model.json["animations"] = json!([]);
        let half = std::f32::consts::FRAC_1_SQRT_2;
        model.animate(0, "rotation", "LINEAR", &[0.0, 2.0], &[0., 0., 0., 1., 0., 0., half, half]);
        let contents = model.contents();
        assert!(contents.warnings.is_empty(), "{:?}", contents.warnings);
        let crate::Part::Mesh { linear, .. } = contents.placed[0].part else { panic!() };
        let animation = &contents.animation.as_ref().unwrap().model;
        let transform = animation.transforms_at(animation.clips.first(), 1.0)[0];
        let corner = DVec3::new(1.0, 1.0, 0.0);
        let found = transform.within(&contents.placed[0].placement);
        let found = found.to_world(glam::DMat3::from_cols_array_2d(&linear) * corner);
        let scale: Vec<f64> = serde_json::from_value(local["scale"].clone()).unwrap();
        let moved = corner * DVec3::from_slice(&scale)
            + DVec3::Y * if local["translation"].is_null() { 0.0 } else { 3.0 };
        assert!(found.distance(DQuat::from_rotation_z(PI / 4.0) * moved) < 1e-6, "{found}");
    }
}

#[test]
fn what_does_not_move_yet_is_said_once() {
    let mut model = quad();
    model.animate(1, "scale", "LINEAR", &[0.0, 1.0], &[1., 1., 1., 1., 2., 1.]);
    let weights = json!({"sampler": 0, "target": {"node": 1, "path": "weights"}});
    let pointer = json!({"sampler": 0, "target": {"path": "pointer"}});
    let channels = model.json["animations"][0]["channels"].as_array_mut().unwrap();
    channels.extend([weights.clone(), weights, pointer]);
    let contents = model.contents();
    assert!(contents.animation.is_some());
    let [warning] = &contents.warnings[..] else { panic!("{:?}", contents.warnings) };
    for fragment in ["a.glb: animations:", "morph targets (ignored): 2", "extensions (ignored): 1", "uneven"]
    {
        assert!(warning.contains(fragment), "{warning}");
    }
    // A node without meshes moves nothing, and is not worth a warning.
    let mut model = quad();
    model.push("nodes", json!({"name": "camera"}));
    model.animate(2, "translation", "LINEAR", &[0.0, 1.0], &[0.0; 6]);
    let contents = model.contents();
    assert!(contents.animation.is_none() && contents.warnings.is_empty(), "{:?}", contents.warnings);
}

#[test]
fn channels_that_cannot_be_read_are_left_out_with_a_warning() {
    let with = |change: &dyn Fn(&mut Model)| {
        let mut model = quad();
        model.animate(1, "translation", "LINEAR", &[0.0, 1.0], &[0., 0., 0., 1., 1., 1.]);
        change(&mut model);
        model
    };
    let set = |path: &'static str, value: Value| {
        with(&move |model| *model.json.pointer_mut(path).unwrap() = value.clone())
    };
    let name = "animations[0].channels[0]";
    set("/animations/0/channels/0/sampler", json!(1)).still(&[name, "sampler that does not exist"]);
    set("/animations/0/samplers/0/interpolation", json!("QUADRATIC")).still(&[name, "unknown interpolation"]);
    set("/animations/0/samplers/0/input", json!(99)).still(&[name, "0 times for 2 values"]);
    set("/animations/0/samplers/0/output", json!(99)).still(&[name, "accessors[99]"]);
    set("/animations/0/samplers/0/output", json!(1)).still(&[name, "2 times for 6 values"]);
    set("/accessors/2/count", json!(1)).still(&[name, "1 times for 2 values"]);
    set("/accessors/3/type", json!("VEC4")).still(&[name, "Vec4"]);
    set("/bufferViews/3/byteLength", json!(4)).still(&[name, "accessors[3]", "reaches beyond"]);
    // A count that would need terabytes is refused before anything is reserved.
    set("/accessors/2/count", json!(4_000_000_000_u32)).still(&["too long"]);
    for times in [[1.0, 1.0], [-1.0, 1.0], [0.0, f32::NAN]] {
        with(&|model| {
            let times = model.floats("SCALAR", 1, &times);
            model.json["animations"][0]["samplers"][0]["input"] = json!(times);
        })
        .still(&[name, "ascend"]);
    }
    with(&|model| {
        let values = model.floats("VEC3", 3, &[0., 0., f32::INFINITY, 0., 0., 0.]);
        model.json["animations"][0]["samplers"][0]["output"] = json!(values);
    })
    .still(&[name, "not finite"]);
    // Types of the JSON itself are errors of the file.
    let mut damaged = quad();
    damaged.json["animations"] = json!([{"channels": [{"sampler": "x"}], "samplers": []}]);
    damaged.refused(&["not valid glTF", "usize"]);
}

#[test]
fn channels_that_share_their_bytes_do_not_multiply_them() {
    let mut model = quad();
    let times: Vec<f32> = (0..50_000).map(|at| at as f32).collect();
    let bytes: Vec<u8> = times.iter().flat_map(|x| x.to_le_bytes()).collect();
    let input = model.accessor(FLOAT, "SCALAR", 50_000, &bytes);
    let output = model.accessor(FLOAT, "VEC3", 50_000, &bytes.repeat(3));
    let channel = json!({"sampler": 0, "target": {"node": 1, "path": "translation"}});
    model.push(
        "animations",
        json!({
            "channels": vec![channel; 1000], "samplers": [{"input": input, "output": output}],
        }),
    );
    let contents = model.contents();
    let animation = contents.animation.unwrap().model;
    assert_eq!((animation.timelines.len(), animation.clips[0].channels.len()), (1, 8));
    assert!(contents.warnings[0].contains("the rest is left out"), "{:?}", contents.warnings);
    // What stays the same costs two keyframes, and keeps the duration.
    let mut model = quad();
    model.animate(1, "translation", "STEP", &times, &[7.0; 150_000]);
    let animation = model.animation();
    assert_eq!(animation.clips[0].channels[0].values.len(), 6);
    assert_eq!(animation.duration_s(&animation.clips[0]), 49_999.0);
}
