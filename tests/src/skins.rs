//! A mesh that follows the joints of a skeleton plays on any client of its scene, and in the viewer.

use std::f64::consts::FRAC_PI_2;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use data_encoding::BASE64;
use glam::DVec3;
use lodestream_bake::scene::of_files;
use lodestream_daemon::SessionSettings;
use lodestream_scene::animation::Moment;
use lodestream_scene::parts::ScenePart;
use serde_json::{Value, json};

use crate::support::LIMIT;
use crate::support::daemon::{Server, Transport};
use crate::support::picture::skipped;
use crate::support::program::Program;
use crate::support::scene::{TestScene, prepare_all};
use crate::support::viewer::{Viewer, config};

/// Rings of the tube along y, and its sides.
const RINGS: u16 = 80;
const SIDES: u16 = 40;

/// A tube from y = 0 to 4 whose upper half bends to −x by a right angle in two seconds. Its node is elsewhere, and in the
/// file it rests with the upper half bent a little to the other side.
pub(crate) fn write_arm(folder: &Path) -> PathBuf {
    let (mut bytes, mut views, mut accessors) = (Vec::new(), Vec::new(), Vec::new());
    let mut push = |list: Vec<u8>, kind: u32, shape: &str, count: usize| {
        views.push(json!({"buffer": 0, "byteOffset": bytes.len(), "byteLength": list.len()}));
        bytes.extend(list);
        bytes.resize(bytes.len().next_multiple_of(4), 0);
        accessors.push(json!({"bufferView": views.len() - 1, "componentType": kind, "type": shape,
            "count": count, "min": [-4.0, -4.0, -4.0], "max": [4.0, 4.0, 4.0]}));
    };
    let floats = |list: &[f32]| list.iter().flat_map(|number| number.to_le_bytes()).collect::<Vec<u8>>();
    let (mut positions, mut normals, mut joints, mut weights) = (vec![], vec![], vec![], vec![]);
    for (ring, side) in (0..RINGS).flat_map(|ring| (0..SIDES).map(move |side| (ring, side))) {
        let turn = std::f32::consts::TAU * f32::from(side) / f32::from(SIDES);
        let y = 4.0 * f32::from(ring) / f32::from(RINGS - 1);
        let share = (2.0 * (y - 1.75)).clamp(0.0, 1.0);
        positions.extend([0.3 * turn.cos(), y, 0.3 * turn.sin()]);
        normals.extend([turn.cos(), 0.0, turn.sin()]);
        joints.extend([0_u8, 1, 0, 0]);
        weights.extend([1.0 - share, share, 0.0, 0.0]);
    }
    let mut faces: Vec<u16> = Vec::new();
    for (i, j) in (0..RINGS - 1).flat_map(|i| (0..SIDES).map(move |j| (i, j))) {
        let at = |i: u16, j: u16| i * SIDES + j % SIDES;
        let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
        faces.extend([a, b, c, a, c, d]);
    }
    let count = usize::from(RINGS) * usize::from(SIDES);
    push(floats(&positions), 5126, "VEC3", count);
    push(floats(&normals), 5126, "VEC3", count);
    push(joints, 5121, "VEC4", count);
    push(floats(&weights), 5126, "VEC4", count);
    push(faces.iter().flat_map(|index| index.to_le_bytes()).collect(), 5123, "SCALAR", faces.len());
    let column = |y: f32| {
        [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, -y, 0.0, 1.0]].concat()
    };
    push(floats(&[column(0.0), column(2.0)].concat()), 5126, "MAT4", 2);
    push(floats(&[0.0, 2.0]), 5126, "SCALAR", 2);
    let half = std::f32::consts::FRAC_1_SQRT_2;
    push(floats(&[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, half, half]), 5126, "VEC4", 2);
    let rest = (-0.2_f64).sin_cos();
    let uri = format!("data:application/octet-stream;base64,{}", BASE64.encode(&bytes));
    let file: Value = json!({
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0, 1]}],
        "nodes": [
            {"name": "arm", "mesh": 0, "skin": 0, "translation": [50.0, 0.0, 0.0]},
            {"name": "shoulder", "children": [2]},
            {"name": "elbow", "translation": [0.0, 2.0, 0.0], "rotation": [0.0, 0.0, rest.0, rest.1]},
        ],
        "skins": [{"joints": [1, 2], "inverseBindMatrices": 5}],
        "meshes": [{"primitives": [{"indices": 4,
            "attributes": {"POSITION": 0, "NORMAL": 1, "JOINTS_0": 2, "WEIGHTS_0": 3}}]}],
        "animations": [{
            "name": "bend", "channels": [{"sampler": 0, "target": {"node": 2, "path": "rotation"}}],
            "samplers": [{"input": 6, "output": 7}],
        }],
        "accessors": accessors, "bufferViews": views, "buffers": [{"byteLength": bytes.len(), "uri": uri}],
    });
    let path = folder.join("arm.gltf");
    std::fs::write(&path, file.to_string()).unwrap();
    path
}

/// Where the end of the arm is that is bent by an angle to −x.
fn end(angle: f64) -> DVec3 {
    DVec3::new(-2.0 * angle.sin(), 2.0 + 2.0 * angle.cos(), 0.0)
}

/// The arm at rest, and after one and two seconds.
fn moments() -> [(Option<Moment>, f64); 3] {
    let at = |time_s| Some(Moment { clip: "bend".into(), time_s });
    [(None, -0.4), (at(1.0), FRAC_PI_2 / 2.0), (at(2.0), FRAC_PI_2)]
}

#[test]
fn joints_move_a_mesh_for_every_client() {
    let folder = tempfile::tempdir().unwrap();
    let scene = of_files(&[write_arm(folder.path())]).unwrap();
    let test_scene = TestScene::open(&scene, prepare_all(&scene, &folder.path().join("cache")));
    let server = Server::start(test_scene.source(), SessionSettings::default());
    for transport in Transport::BOTH {
        let mut viewer = Viewer::start(&server.address(transport), config());
        viewer.settle();
        let part = ScenePart { instance: 0, part: 0 };
        for (moment, angle) in moments() {
            viewer.animate(moment.clone());
            let (tip, until) = (end(angle), Instant::now() + LIMIT);
            loop {
                let found = viewer.ask(move |core| core.part_bounds(part)).unwrap();
                let [low, high] = found.extent;
                // The rim is 0.3 from the end; the other end of the arm stays.
                let low_x = (tip.x - 0.3 * angle.cos()).min(-0.3);
                let high_y = tip.y + 0.3 * angle.sin().abs();
                if (low.x - low_x).abs() < 0.1 && (high.y - high_y).abs() < 0.1 {
                    break;
                }
                assert!(Instant::now() < until, "{transport:?}: {found:?} with {moment:?}, not to {tip}");
                std::thread::sleep(Duration::from_millis(10));
            }
        }
        let stats = viewer.settle().stats;
        assert_eq!((stats.decode_failures, stats.refused), (0, 0));
    }
    server.assert_healthy();
}

#[test]
fn the_viewer_draws_and_picks_a_mesh_where_its_joints_are() {
    if skipped() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let (arm, cache) = (write_arm(folder.path()), folder.path().join("cache"));
    // Looks at the end of the arm after two seconds.
    let tip = end(FRAC_PI_2) + DVec3::X * 0.2;
    let camera = format!("eye={0},{1},{2};target={0},{1},0", tip.x, tip.y, 4.0);
    let run = |picture: &str, more: &[&str]| {
        let picture = folder.path().join(picture);
        let usual = ["--camera", &camera, "--cache", cache.to_str().unwrap(), "--pick", "160,90"];
        let output = Program::headless(arm.to_str().unwrap(), &picture, &[&usual[..], more].concat()).end();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        (String::from_utf8(output.stdout).unwrap(), std::fs::read(picture).unwrap())
    };
    let (picked, bent) = run("bent.png", &["--animation-time", "2"]);
    assert!(picked.contains(":0 at "), "{picked}");
    let (picked, rest) = run("rest.png", &[]);
    assert!(picked.contains("nothing"), "{picked}");
    let (picked, half) = run("half.png", &["--animation", "bend", "--animation-time", "1"]);
    assert!(picked.contains("nothing"), "{picked}");
    assert!(bent != rest && half != rest && bent != half);
}
