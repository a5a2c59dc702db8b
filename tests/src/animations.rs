//! Animations of rigid nodes play on any client of a scene: over both transports, and in a published scene. The viewer
//! shows a clip at a time.

use std::collections::BTreeMap;
use std::f64::consts::PI;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use data_encoding::BASE64;
use glam::{DQuat, DVec3};
use lodestream_bake::scene::of_files;
use lodestream_client::core::Change;
use lodestream_daemon::SessionSettings;
use lodestream_protocol::source::SceneSource as _;
use lodestream_scene::animation::{AnimationTable, Animations, Moment};
use lodestream_scene::description::Instance;
use lodestream_scene::parts::ScenePart;
use lodestream_scene::placement::Placement;
use lodestream_server::catalogue::publish::publish;
use lodestream_store::Objects;
use serde_json::{Value, json};

use crate::support::LIMIT;
use crate::support::daemon::{Server, Transport};
use crate::support::picture::skipped;
use crate::support::program::Program;
use crate::support::scene::{TestScene, options, prepare_all};
use crate::support::shapes::ball;
use crate::support::viewer::{Viewer, config};

/// A crane of two equal pyramids: in two seconds the tower turns by 90° about y, and the hook on it rises by 4.
pub(crate) fn write_crane(folder: &Path) -> PathBuf {
    let corners = [[0.0_f32, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    let faces = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];
    let half = std::f32::consts::FRAC_1_SQRT_2;
    let (mut bytes, mut views) = (Vec::new(), Vec::new());
    let positions: Vec<f32> = faces.iter().flatten().flat_map(|&corner: &usize| corners[corner]).collect();
    let turns = vec![0.0, 0.0, 0.0, 1.0, 0.0, half, 0.0, half];
    for list in [positions, vec![0.0, 2.0], turns, vec![3.0, 0.0, 0.0, 3.0, 4.0, 0.0]] {
        views.push(json!({"buffer": 0, "byteOffset": bytes.len(), "byteLength": 4 * list.len()}));
        bytes.extend(list.iter().flat_map(|number| number.to_le_bytes()));
    }
    let accessor = |view: usize, shape: &str, count: usize| {
        json!({"bufferView": view, "componentType": 5126, "type": shape, "count": count,
            "min": [0.0, 0.0, 0.0], "max": [1.0, 1.0, 1.0]})
    };
    let accessors =
        [accessor(0, "VEC3", 12), accessor(1, "SCALAR", 2), accessor(2, "VEC4", 2), accessor(3, "VEC3", 2)];
    let channel = |sampler: usize, node: usize, path: &str| json!({"sampler": sampler, "target": {"node": node, "path": path}});
    let uri = format!("data:application/octet-stream;base64,{}", BASE64.encode(&bytes));
    let file: Value = json!({
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}],
        "nodes": [
            {"name": "tower", "mesh": 0, "children": [1]},
            {"name": "hook", "mesh": 0, "translation": [3.0, 0.0, 0.0], "scale": [0.5, 0.5, 0.5]},
        ],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "animations": [{
            "name": "lift", "channels": [channel(0, 0, "rotation"), channel(1, 1, "translation")],
            "samplers": [{"input": 1, "output": 2}, {"input": 1, "output": 3}],
        }],
        "accessors": accessors, "bufferViews": views, "buffers": [{"byteLength": bytes.len(), "uri": uri}],
    });
    let path = folder.join("crane.gltf");
    std::fs::write(&path, file.to_string()).unwrap();
    path
}

/// Where tower and hook are after a second.
fn expected() -> [Placement; 2] {
    let turn = DQuat::from_rotation_y(PI / 4.0);
    [Placement::new(DVec3::ZERO, turn, 1.0), Placement::new(turn * DVec3::new(3.0, 2.0, 0.0), turn, 0.5)]
}

fn lift() -> Moment {
    Moment { clip: "lift".into(), time_s: 1.0 }
}

fn is_near(a: &Placement, b: &Placement) -> bool {
    [DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z]
        .iter()
        .all(|at| a.to_world(*at).distance(b.to_world(*at)) < 1e-5)
}

/// Receives the crane and checks where it is after a second: for a renderer, and for picking.
fn check(viewer: &mut Viewer, name: &str) {
    viewer.settle();
    let (mut animations, mut instances) = (Animations::default(), Vec::<Instance>::new());
    for change in &viewer.changes {
        match change {
            Change::Animation { number, model } => animations.insert(*number, model.clone()),
            Change::Instances(some) => instances.extend(some),
            _ => {}
        }
    }
    let clips: Vec<(String, f64)> =
        animations.clips().into_iter().map(|clip| (clip.name, clip.duration_s)).collect();
    assert_eq!(clips, [("lift".to_owned(), 2.0)], "{name}");
    let moved: BTreeMap<u32, Placement> = animations
        .moved(Some(&lift()))
        .instances
        .into_iter()
        .map(|(number, transform)| (number, transform.within(&instances[number as usize].placement)))
        .collect();
    assert_eq!(moved.len(), 2, "{name}");
    for expected in expected() {
        let (number, _) = moved.iter().find(|(_, moved)| is_near(moved, &expected)).expect(name);
        let part = ScenePart { instance: *number, part: 0 };
        let bounds = move |viewer: &Viewer| viewer.ask(move |core| core.part_bounds(part)).unwrap();
        let (middle, until) = (expected.to_world(DVec3::splat(0.25)), Instant::now() + LIMIT);
        // The streaming thread follows within some milliseconds: there, and back.
        for moment in [Some(lift()), None] {
            viewer.animate(moment.clone());
            loop {
                let found = bounds(viewer);
                if (found.centre.distance(middle) < 0.5 * found.radius) == moment.is_some() {
                    break;
                }
                assert!(Instant::now() < until, "{name}: {found:?} with {moment:?}, not at {middle}");
                std::thread::sleep(Duration::from_millis(10));
            }
        }
    }
    let stats = viewer.settle().stats;
    assert_eq!((stats.decode_failures, stats.refused), (0, 0), "{name}");
}

#[test]
fn a_clip_moves_instances_for_every_client() {
    let folder = tempfile::tempdir().unwrap();
    let scene = of_files(&[write_crane(folder.path())]).unwrap();
    let cache = folder.path().join("cache");
    let test_scene = TestScene::open(&scene, prepare_all(&scene, &cache));
    assert_eq!(test_scene.store.animations(), Some(AnimationTable { models: 1 }));
    let server = Server::start(test_scene.source(), SessionSettings::default());
    for transport in Transport::BOTH {
        check(&mut Viewer::start(&server.address(transport), config()), &format!("{transport:?}"));
    }
    server.assert_healthy();
    let host = folder.path().join("host");
    std::fs::create_dir(&host).unwrap();
    let objects = Objects::of_folder(&host).unwrap();
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
    let done = runtime.block_on(publish(&scene, &objects, &cache, &options())).unwrap();
    let file = format!("file:{}/{}", host.display(), done.name).parse().unwrap();
    check(&mut Viewer::start(&file, config()), "published");
}

#[test]
fn the_viewer_shows_a_clip_at_a_time() {
    if skipped() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let (crane, cache) = (write_crane(folder.path()), at("cache"));
    std::fs::write(at("ball.obj"), ball(20, 30)).unwrap();
    let run = |file: &Path, picture: &str, more: &[&str]| {
        let usual = ["--camera", "eye=2,3,12;target=2,2,0", "--cache", cache.to_str().unwrap()];
        Program::headless(file.to_str().unwrap(), &at(picture), &[&usual[..], more].concat()).end()
    };
    // Where the hook is after a second, in the middle of the picture.
    let hook = expected()[1].to_world(DVec3::splat(0.25));
    let camera = format!("eye={0},{1},{2};target={0},{1},{3}", hook.x, hook.y, hook.z + 6.0, hook.z);
    let pick = |time: &[&str]| {
        let usual = ["--camera", &camera, "--cache", cache.to_str().unwrap(), "--pick", "160,90"];
        let output =
            Program::headless(crane.to_str().unwrap(), &at("hook.png"), &[&usual[..], time].concat()).end();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        String::from_utf8(output.stdout).unwrap()
    };
    assert!(pick(&["--animation-time", "1"]).contains(":0 at "), "the hook is there");
    assert!(pick(&[]).contains("nothing"), "without a clip it stands where the file has it");
    let pictures = [("rest.png", &[][..]), ("one.png", &["--animation-time", "1"])].map(|(name, more)| {
        assert!(run(&crane, name, more).status.success(), "{name}");
        std::fs::read(at(name)).unwrap()
    });
    assert!(pictures[0] != pictures[1]);
    for (file, message) in [(&crane, "it has 1: lift"), (&at("ball.obj"), "has no animation")] {
        let output = run(file, "none.png", &["--animation", "drop"]);
        let text = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(!output.status.success() && text.contains(message), "{text}");
    }
}
