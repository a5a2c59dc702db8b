//! What parts are called is found by any client of a scene: over both transports, and in a published scene. The viewer
//! names the part at a pixel.

use std::path::{Path, PathBuf};

use data_encoding::BASE64;
use lodestream_bake::scene::of_files;
use lodestream_client::core::PartAbsence;
use lodestream_daemon::SessionSettings;
use lodestream_protocol::source::SceneSource as _;
use lodestream_server::catalogue::publish::publish;
use lodestream_store::Objects;
use serde_json::{Value, json};

use crate::support::daemon::{Server, Transport};
use crate::support::picture::skipped;
use crate::support::program::Program;
use crate::support::scene::{TestScene, options, prepare_all};
use crate::support::viewer::{Viewer, config};

/// Parts that are placed once.
pub(crate) const PARTS: usize = 40;

/// A house: 40 different parts on a floor, which become a batch, and two copies of a column.
pub(crate) fn write_house(folder: &Path) -> PathBuf {
    let (mut bytes, mut accessors, mut views, mut meshes) = (Vec::new(), vec![], vec![], vec![]);
    for mesh in 0..=PARTS {
        let high = 1.0 + mesh as f32 / 64.0;
        let corners = [[0.0, 0.0, 0.0], [high, 0.0, 0.0], [0.0, high, 0.0], [0.0, 0.0, high]];
        let faces = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];
        let offset = bytes.len();
        for number in faces.iter().flatten().flat_map(|&corner: &usize| corners[corner]) {
            bytes.extend(f32::to_le_bytes(number));
        }
        views.push(json!({"buffer": 0, "byteOffset": offset, "byteLength": bytes.len() - offset}));
        accessors.push(json!({
            "bufferView": mesh, "componentType": 5126, "type": "VEC3", "count": 12,
            "min": [0.0, 0.0, 0.0], "max": [high, high, high],
        }));
        // Columns blend, so they are in no batch.
        let material = usize::from(mesh == PARTS);
        meshes.push(json!({"primitives": [{"attributes": {"POSITION": mesh}, "material": material}]}));
    }
    let part = |mesh: usize, name: String, x: f64, z: f64| json!({"mesh": mesh, "name": name, "translation": [x, 0.0, z], "extras": {"id": name}});
    let mut nodes: Vec<Value> =
        (0..PARTS).map(|mesh| part(mesh, format!("part {mesh}"), 3.0 * mesh as f64, 0.0)).collect();
    nodes.extend((0..2).map(|copy| part(PARTS, format!("column {copy}"), 0.0, 9.0 + 4.0 * f64::from(copy))));
    let children: Vec<usize> = (0..nodes.len()).collect();
    nodes.push(json!({"name": "floor 3", "children": children}));
    nodes.push(json!({"name": "building 2", "children": [PARTS + 2]}));
    let uri = format!("data:application/octet-stream;base64,{}", BASE64.encode(&bytes));
    let file = json!({
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [PARTS + 3]}], "nodes": nodes, "meshes": meshes,
        "materials": [{}, {"alphaMode": "BLEND"}],
        "accessors": accessors, "bufferViews": views, "buffers": [{"byteLength": bytes.len(), "uri": uri}],
    });
    let path = folder.join("house.gltf");
    std::fs::write(&path, file.to_string()).unwrap();
    path
}

/// Looks up all parts of the house and checks what came for that.
fn check(viewer: &mut Viewer, scene: &TestScene, name: &str) {
    let before = viewer.settle().stats;
    let page = scene.store.page(0).unwrap();
    let mut found = Vec::new();
    for (number, instance) in (0..).zip(&page.instances) {
        let count = if page.assets[instance.asset as usize].name == "house/parts" { PARTS as u32 } else { 1 };
        for part in 0..count {
            let info = viewer.part(number, part).unwrap();
            assert_eq!(info.path, "building 2/floor 3", "{name}");
            assert_eq!(info.extras, Some(json!({"id": info.name}).to_string()), "{name}");
            found.push(info.name);
        }
        assert_eq!(viewer.part(number, count), Err(PartAbsence::NoSuchPart), "{name}");
    }
    assert_eq!(viewer.part(3, 0), Err(PartAbsence::NoSuchPart), "{name}");
    let (columns, parts): (Vec<_>, Vec<_>) =
        found.iter().cloned().partition(|name| name.starts_with("column"));
    assert_eq!(
        parts,
        (0..PARTS).map(|n| format!("part {n}")).collect::<Vec<_>>(),
        "{name}: in the file's order"
    );
    assert!(
        columns.contains(&"column 0".into()) && columns.contains(&"column 1".into()),
        "{name}: {columns:?}"
    );
    // A page of the directory and one of records, once; all other answers took no byte of a blob.
    let stats =
        viewer.wait("the count of blobs", |status| status.stats.session.blobs >= before.session.blobs + 2);
    assert_eq!(stats.stats.session.blobs, before.session.blobs + 2, "{name}");
    let bytes = stats.stats.session.blob_bytes - before.session.blob_bytes;
    println!("{name}: {bytes} bytes for what {} parts are called", PARTS + 2);
    assert!(bytes <= 24 * (PARTS as u64 + 2) + 100, "{name}: {bytes} bytes");
    assert_eq!((stats.stats.decode_failures, stats.stats.refused), (0, 0), "{name}");
}

#[test]
fn a_client_finds_what_every_part_is_called() {
    let folder = tempfile::tempdir().unwrap();
    let scene = of_files(&[write_house(folder.path())]).unwrap();
    let cache = folder.path().join("cache");
    let test_scene = TestScene::open(&scene, prepare_all(&scene, &cache));
    let server = Server::start(test_scene.source(), SessionSettings::default());
    for transport in Transport::BOTH {
        let mut viewer = Viewer::start(&server.address(transport), config());
        check(&mut viewer, &test_scene, &format!("{transport:?}"));
    }
    server.assert_healthy();
    let host = folder.path().join("host");
    std::fs::create_dir(&host).unwrap();
    let objects = Objects::of_folder(&host).unwrap();
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
    let done = runtime.block_on(publish(&scene, &objects, &cache, &options())).unwrap();
    let file = format!("file:{}/{}", host.display(), done.name).parse().unwrap();
    check(&mut Viewer::start(&file, config()), &test_scene, "published");
}

#[test]
fn the_viewer_names_the_part_at_a_pixel() {
    if skipped() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let scene = of_files(&[write_house(folder.path())]).unwrap();
    let test_scene = TestScene::open(&scene, prepare_all(&scene, &folder.path().join("cache")));
    let batch = test_scene.asset("house/parts");
    let page = test_scene.store.page(0).unwrap();
    let instance = page.instances.iter().position(|instance| instance.asset == batch).unwrap();
    let server = Server::start(test_scene.source(), SessionSettings::default());
    // The slope of part 7, whose corners are 1 + 7/64 from its own zero, meets the ray at 0.2, 0.2.
    let camera = "eye=21.2,0.2,10;target=21.2,0.2,0";
    let part = format!("{instance}:7");
    for hidden in [false, true] {
        let mut arguments = vec!["--camera", camera, "--pick", "160,90", "--pick", "160,2"];
        if hidden {
            arguments.extend(["--hide", &part]);
        }
        let picture = folder.path().join("picture.png");
        let output = Program::headless(&server.url(Transport::Quic), &picture, &arguments).end();
        let errors = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{errors}");
        let text = String::from_utf8(output.stdout).unwrap();
        let [first, second]: [&str; 2] = text.lines().collect::<Vec<_>>().try_into().unwrap();
        assert_eq!(second, "160,2: nothing");
        if hidden {
            assert_eq!(first, "160,90: nothing", "nothing is behind it");
            continue;
        }
        let at = first.strip_prefix(&format!("160,90: {part} at ")).unwrap_or_else(|| panic!("{text}"));
        let (place, distance) = at.split_once(", distance ").unwrap();
        let place: Vec<f64> = place.split(',').map(|x| x.parse().unwrap()).collect();
        let expected = [21.2, 0.2, 1.0 + 7.0 / 64.0 - 0.4];
        assert!(place.iter().zip(expected).all(|(a, b)| (a - b).abs() < 0.06), "{text}");
        assert!((distance.parse::<f64>().unwrap() - (10.0 - expected[2])).abs() < 0.06, "{text}");
    }
    server.assert_healthy();
}
