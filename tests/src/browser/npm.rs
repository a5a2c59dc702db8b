//! The npm package's `connect`: a scene as typed arrays.

use std::collections::{BTreeMap, BTreeSet};

use glam::{DVec3, Vec3};
use lodestream_bake::scene::of_files;
use lodestream_client::core::Change;
use lodestream_daemon::{Origin, SessionSettings};
use lodestream_scene::placement::Placement;
use serde_json::Value;

use super::devtools::WEBGL;
use super::files::Files;
use super::{built_package, tab_with};
use crate::parts::{PARTS, write_house};
use crate::static_host::host::Host;
use crate::static_host::published;
use crate::support::daemon::{Server, Transport};
use crate::support::scene::{TestScene, prepare_all};
use crate::support::viewer::{Viewer, config};

/// A daemon that lets the pages of a web server in.
pub(super) fn serve_for(scene: &TestScene, files: &Files) -> Server {
    let origin: Origin = files.origin().parse().unwrap();
    Server::start_with(scene.source(), SessionSettings::default(), |options| {
        options.admission.origins = [origin].into_iter().collect();
    })
}

/// The address for WebSocket.
pub(super) fn websocket(server: &Server) -> String {
    server.url_of("ws")
}

/// A page that connects with the package of another origin, counts the events and checks the arrays.
const PAGE: &str = r#"<!doctype html>
<script type="module">
  const asked = new URLSearchParams(location.search);
  const { connect } = await import(`${asked.get('package')}/connect.js`);
  const connection = connect(asked.get('src'), { width: 640, height: 360 });
  window.connection = connection;
  window.counts = {};
  window.faults = [];
  const on = (type, check = () => true) =>
    connection.addEventListener(type, ({ detail }) => {
      counts[type] = (counts[type] ?? 0) + 1;
      if (!check(detail)) faults.push(`${type}: ${JSON.stringify(detail).slice(0, 200)}`);
    });
  for (const type of ['scene', 'asset', 'instances', 'firstframe', 'progress', 'settled']) on(type);
  on('error', () => false);
  on('mesh', ({ mesh, vertices, faces }) =>
    vertices.every(({ first, positions, parts }) =>
      positions.every((x, at) => mesh.positions[3 * first + at] === x) && parts.every((x, at) => mesh.parts[first + at] === x)) &&
    faces.every(({ indices }) => indices.every((index) => index < mesh.vertexCount)));
  on('texture', ({ format, texels, width, height }) => texels.length === width * height * (format === 'rgba8' ? 4 : 1));
  const bits = (array) => new Uint32Array(array.buffer);
  /** Faces of each asset, and a sum of their corners' positions, texture coordinates and parts that no order changes. */
  window.sums = () =>
    Object.fromEntries([...connection.model.assets].map(([asset, { mesh }]) => {
      const [words, uvs] = [bits(mesh.positions), bits(mesh.uvs)];
      const corner = (slot) =>
        Math.imul(words[3 * slot], 73856093) ^ Math.imul(words[3 * slot + 1], 19349663) ^ Math.imul(words[3 * slot + 2], 83492791) ^
        Math.imul(uvs[2 * slot], 49979687) ^ Math.imul(uvs[2 * slot + 1], 67867967) ^
        Math.imul(mesh.parts[slot], 86028121);
      let [faces, sum] = [0, 0];
      mesh.indices.forEach((list, material) => {
        for (let at = 0; at < mesh.indexCounts[material]; at += 3) {
          if (list[at] === list[at + 1]) continue;
          const [a, b, c] = [0, 1, 2].map((side) => corner(list[at + side]));
          faces += 1;
          sum = (sum + (Math.imul((a + b + c) | 0, 0x9e3779b1) ^ a ^ b ^ c)) | 0;
        }
      });
      return [asset, [faces, sum >>> 0]];
    }));
  window.matrices = () => connection.model.instances.map(({ index, asset, matrix }) => ({ index, asset, matrix: [...matrix] }));
</script>"#;

/// Bits of positions and texture coordinates and the part of each vertex, and the faces of each material.
type Mesh = (Vec<[u32; 6]>, BTreeMap<u16, Vec<[u32; 3]>>);

/// The same sums of a native client's meshes.
fn sums(changes: &[Change]) -> BTreeMap<String, [u32; 2]> {
    let mut meshes: BTreeMap<u32, Mesh> = BTreeMap::new();
    for change in changes {
        let Change::Mesh(change) = change else { continue };
        let (vertices, lists) = meshes.entry(change.asset).or_default();
        for (first, run) in &change.vertices {
            let first = *first as usize;
            vertices.resize(vertices.len().max(first + run.len()), [0; 6]);
            for (place, vertex) in vertices[first..].iter_mut().zip(run) {
                let ([x, y, z], [u, v]) = (vertex.data.position, vertex.data.uv);
                let [x, y, z, u, v] = [x, y, z, u, v].map(f32::to_bits);
                *place = [x, y, z, u, v, vertex.data.part];
            }
        }
        vertices.truncate(change.vertex_slots as usize);
        for (material, &count) in (0..).zip(&change.index_slots) {
            lists.entry(material).or_default().truncate(count as usize);
        }
        for run in &change.indices {
            let list = lists.entry(run.material).or_default();
            let first = run.first as usize;
            list.resize(list.len().max(first + run.faces.len()), [0; 3]);
            list[first..first + run.faces.len()].copy_from_slice(&run.faces);
        }
    }
    let factors = [73_856_093, 19_349_663, 83_492_791, 49_979_687, 67_867_967, 86_028_121];
    let sum = |(vertices, lists): &Mesh| {
        let corner = |slot: u32| {
            let words = vertices[slot as usize].iter().zip(factors);
            words.fold(0_u32, |sum, (number, factor)| sum ^ number.wrapping_mul(factor))
        };
        let used = lists.values().flatten().filter(|face| face[0] != face[1]);
        used.fold([0_u32; 2], |[faces, sum], face| {
            let [a, b, c] = face.map(corner);
            let mixed = a.wrapping_add(b).wrapping_add(c).wrapping_mul(0x9e37_79b1) ^ a ^ b ^ c;
            [faces + 1, sum.wrapping_add(mixed)]
        })
    };
    meshes.iter().map(|(asset, mesh)| (asset.to_string(), sum(mesh))).collect()
}

/// Checks that matrices take an asset's points to where its placements put them.
fn check_matrices(matrices: &Value, changes: &[Change]) {
    let mut placements: Vec<Placement> = Vec::new();
    let mut assets = BTreeMap::new();
    for change in changes {
        match change {
            Change::Instances(list) => placements.extend(list.iter().map(|instance| instance.placement)),
            Change::Asset(new) => {
                assets.insert(u64::from(new.asset), (DVec3::from(new.origin), Vec3::from(new.center)));
            }
            _ => {}
        }
    }
    let matrices = matrices.as_array().unwrap();
    assert_eq!(matrices.len(), placements.len());
    for instance in matrices {
        let (origin, center) = assets[&instance["asset"].as_u64().unwrap()];
        let numbers: Vec<f64> = serde_json::from_value(instance["matrix"].clone()).unwrap();
        let matrix = glam::DMat4::from_cols_slice(&numbers);
        let placement = placements[usize::try_from(instance["index"].as_u64().unwrap()).unwrap()];
        let [shown, expected] =
            [matrix.transform_point3(center.as_dvec3()), placement.to_world(origin + center.as_dvec3())];
        assert!((shown - expected).length() < 1e-6 * (1.0 + expected.length()), "{instance}: {expected}");
    }
}

#[test]
fn connect_gives_the_faces_of_the_native_client() {
    let Some(mut tab) = tab_with([640, 360], WEBGL) else { return };
    let scene = TestScene::small();
    // Workers must start although the package lies on another origin than the page.
    let package = Files::start(built_package(), String::new());
    let site = Files::start(built_package(), PAGE.to_owned());
    let server = serve_for(scene, &site);
    let address = websocket(&server);
    tab.navigate(&format!("{}/page.html?package={}&src={address}", site.origin(), package.origin()));
    tab.wait("the page", "typeof connection", |kind| kind == "object");
    let settled = |count: u64| move |counts: &Value| counts["settled"].as_u64() >= Some(count);
    let counts = tab.wait("it settles", "counts", settled(1));
    println!("{counts}");
    assert_eq!(tab.evaluate("faults"), serde_json::json!([]));
    for once in ["scene", "firstframe", "settled"] {
        assert_eq!(counts[once], 1, "{once}: {counts}");
    }
    assert_eq!(counts["asset"].as_u64(), Some(scene.assets.len() as u64), "{counts}");
    assert!(counts["mesh"].as_u64() > counts["asset"].as_u64(), "meshes are refined: {counts}");
    assert!(counts["texture"].as_u64() > Some(0), "{counts}");

    let mut native = Viewer::start(&server.address(Transport::WebSocket), config());
    native.settle();
    let expected = sums(&native.changes);
    assert!(!expected.is_empty());
    assert_eq!(tab.evaluate("sums()"), serde_json::to_value(&expected).unwrap());
    check_matrices(&tab.evaluate("matrices()"), &native.changes);

    // What parts are called, and why that is not known.
    for instance in 0..3 {
        let info = native.part(instance, 0).unwrap();
        assert!(!info.name.is_empty(), "instance {instance}");
        let extras: Value = info.extras.map_or(Value::Null, |text| serde_json::from_str(&text).unwrap());
        let expected = serde_json::json!({"name": info.name, "path": info.path, "extras": extras});
        assert_eq!(tab.evaluate(&format!("connection.part({instance})")), expected);
    }
    for (part, why) in [("0, 1", "there is no such part"), ("-1", "whole numbers")] {
        let message = tab.evaluate(&format!("connection.part({part}).catch((why) => why.message)"));
        assert!(message.as_str().is_some_and(|message| message.contains(why)), "{message}");
    }

    // Nearer, more is wanted.
    let faces = |tab: &mut super::Tab| {
        let sums: BTreeMap<String, [u64; 2]> = serde_json::from_value(tab.evaluate("sums()")).unwrap();
        sums.values().map(|[faces, _]| faces).sum::<u64>()
    };
    let before = faces(&mut tab);
    tab.evaluate(
        "(() => { const { eye, target, up, fov } = connection.model.scene.camera;
            const nearer = eye.map((x, axis) => target[axis] + (x - target[axis]) / 4);
            connection.setView({ eye: nearer, target, up, fov, width: 1280, height: 720, targetPx: 0.5 }); })()",
    );
    tab.wait("it settles nearer", "counts", settled(2));
    let after = faces(&mut tab);
    println!("{before} faces, {after} nearer");
    assert!(after > before, "{before} faces, {after} nearer");
    assert_eq!(tab.evaluate("faults"), serde_json::json!([]));
    server.wait_for_sessions(2);
    tab.evaluate("connection.close()");
    let message = tab.evaluate("connection.part(0).catch((why) => why.message)");
    assert_eq!(message, "the session has ended");
    server.wait_for_sessions(1);
    assert_eq!(tab.console, Vec::<String>::new());
    server.assert_healthy();
}

#[test]
fn connect_gives_the_parts_of_the_native_client() {
    let Some(mut tab) = tab_with([640, 360], WEBGL) else { return };
    let folder = tempfile::tempdir().unwrap();
    let scene = of_files(&[write_house(folder.path())]).unwrap();
    let scene = TestScene::open(&scene, prepare_all(&scene, &folder.path().join("cache")));
    let site = Files::start(built_package(), PAGE.to_owned());
    let server = serve_for(&scene, &site);
    tab.navigate(&format!("{0}/page.html?package={0}&src={1}", site.origin(), websocket(&server)));
    tab.wait("the page", "typeof connection", |kind| kind == "object");
    tab.wait("it settles", "counts", |counts| counts["settled"].as_u64() >= Some(1));
    let mut native = Viewer::start(&server.address(Transport::WebSocket), config());
    native.settle();
    assert_eq!(tab.evaluate("sums()"), serde_json::to_value(sums(&native.changes)).unwrap());
    let batch = scene.asset("house/parts");
    let mesh = format!("connection.model.assets.get({batch}).mesh");
    // Unused slots have part 0, which is in use.
    let found = tab.evaluate(&format!("new Set({mesh}.parts.subarray(0, {mesh}.vertexCount)).size"));
    assert_eq!(found, PARTS);
    let mixed = tab.evaluate(&format!(
        "{mesh}.indices[0].subarray(0, {mesh}.indexCounts[0]).some((slot, at, all) =>
            {mesh}.parts[slot] !== {mesh}.parts[all[at - (at % 3)]])"
    ));
    assert_eq!(mixed, false, "a face has one part");
    assert_eq!(tab.evaluate("faults"), serde_json::json!([]));
    assert_eq!(tab.console, Vec::<String>::new());
    server.assert_healthy();
}

/// What undone chunks leave at the end of a mesh is neither drawn nor kept.
#[test]
fn arrays_become_shorter_as_meshes_do() {
    let Some(mut tab) = tab_with([64, 64], WEBGL) else { return };
    let site = Files::start(built_package(), PAGE_OF_A_MESH.to_owned());
    tab.navigate(&format!("{}/page.html", site.origin()));
    let steps = tab.wait("the page", "window.steps ?? null", |steps| !steps.is_null());
    // Vertices, numbers of indices, whether arrays were replaced, capacity in vertices, the last index.
    assert_eq!(
        steps,
        serde_json::json!([
            [1000, 3000, true, [0], 1000, 1],
            [900, 2700, false, [], 1000, 1],
            [20, 30, true, [0], 256, 1],
            [20, 30, false, [], 256, 7],
        ])
    );
    assert_eq!(tab.console, Vec::<String>::new());
}

const PAGE_OF_A_MESH: &str = r#"<!doctype html>
<script type="module">
  const { Mesh } = await import('./mesh.js');
  const mesh = new Mesh(1);
  const run = (first, count) => ({
    first, positions: new Float32Array(3 * count), normals: new Float32Array(3 * count), uvs: new Float32Array(2 * count),
    colors: new Uint16Array(4 * count), parts: new Uint32Array(count),
  });
  const faces = (first, count, index) => ({ material: 0, first, indices: new Uint32Array(3 * count).fill(index) });
  const changes = [
    { vertices: [run(0, 1000)], faces: [faces(0, 1000, 1)], vertexCount: 1000, faceCounts: [1000] },
    { vertices: [], faces: [], vertexCount: 900, faceCounts: [900] },
    { vertices: [], faces: [], vertexCount: 20, faceCounts: [10] },
    { vertices: [run(3, 2)], faces: [faces(9, 1, 7)], vertexCount: 20, faceCounts: [10] },
  ];
  window.steps = changes.map((change) => {
    const { verticesReplaced, indicesReplaced } = mesh.apply(change);
    const { vertexCount, indexCounts: [count], indices: [list], positions } = mesh;
    return [vertexCount, count, verticesReplaced, indicesReplaced, positions.length / 3, list[count - 1]];
  });
</script>"#;

#[test]
fn a_page_that_the_server_does_not_allow_is_told_that_the_connection_is_lost() {
    let Some(mut tab) = tab_with([64, 64], WEBGL) else { return };
    let site = Files::start(built_package(), PAGE.to_owned());
    let server = Server::start(TestScene::small().source(), SessionSettings::default());
    let address = websocket(&server);
    tab.navigate(&format!("{0}/page.html?package={0}&src={address}", site.origin()));
    tab.wait("the page", "typeof connection", |kind| kind == "object");
    let message = tab.wait("the loss is told", "connection.stats().message", |message| {
        message.as_str().is_some_and(|text| text.contains("lost"))
    });
    assert_eq!(
        tab.evaluate("[counts.scene, counts.settled].filter(Boolean)"),
        serde_json::json!([]),
        "{message}"
    );
    server.assert_healthy();
}

/// A page that imports the package and nothing else.
const MODULES: &str = r#"<!doctype html>
<script type="module">
  window.modules = Object.assign({}, ...await Promise.all(
    ['index', 'connect', 'element'].map(async (name) => ({ [name]: await import(`./${name}.js`) })),
  ));
</script>"#;

/// Names that the package's types state: exported values, and the members of a class.
fn typed(text: &str, class: Option<&str>) -> BTreeSet<String> {
    let name = |rest: &str| rest.chars().take_while(|c| c.is_alphanumeric()).collect::<String>();
    let Some(class) = class else {
        let starts = ["export class ", "export function ", "export const "];
        let lines = text.lines().filter_map(|line| starts.iter().find_map(|start| line.strip_prefix(start)));
        return lines.map(name).collect();
    };
    let begins = format!("export class {class} ");
    let lines = text.lines().skip_while(|line| !line.starts_with(&begins)).skip(1);
    let lines = lines.take_while(|line| *line != "}").filter_map(|line| line.strip_prefix("  "));
    let members = lines.filter(|line| line.starts_with(char::is_alphabetic) && !line.starts_with("private "));
    let prefixes = ["readonly ", "get ", "set "];
    members.map(|line| name(prefixes.iter().find_map(|p| line.strip_prefix(p)).unwrap_or(line))).collect()
}

#[test]
fn the_types_name_what_the_modules_export() {
    let Some(mut tab) = tab_with([64, 64], WEBGL) else { return };
    let folder = built_package();
    let types = std::fs::read_to_string(folder.join("index.d.ts")).unwrap();
    let site = Files::start(folder, MODULES.to_owned());
    tab.navigate(&format!("{}/page.html", site.origin()));
    tab.wait("the modules", "typeof modules", |kind| kind == "object");
    let names = |tab: &mut super::Tab, expression: &str| -> BTreeSet<String> {
        serde_json::from_value(tab.evaluate(expression)).unwrap()
    };
    assert_eq!(names(&mut tab, "Object.keys(modules.index)"), typed(&types, None));
    for file in ["connect", "element"] {
        assert!(
            names(&mut tab, &format!("Object.keys(modules.{file})")).is_subset(&typed(&types, None)),
            "{file}"
        );
    }
    // Members of the class and fields of an instance, without what the browser calls and what it inherits.
    let connection = "new modules.index.Connection('ws://localhost:1/', {})";
    for (class, instance, inherited) in [
        ("LodestreamViewer", "document.createElement('lodestream-viewer')", &[][..]),
        ("Connection", connection, &["addEventListener"][..]),
    ] {
        let own = names(
            &mut tab,
            &format!(
                "[...Object.getOwnPropertyNames(modules.index.{class}.prototype), ...Object.keys({instance})]
                    .filter((name) => !/^(constructor|.*Callback)$/.test(name))"
            ),
        );
        let stated = typed(&types, Some(class));
        let stated: BTreeSet<_> =
            stated.into_iter().filter(|name| !inherited.contains(&name.as_str())).collect();
        assert_eq!(own, stated, "{class}");
    }
}

#[test]
fn connect_reads_a_published_scene_and_says_what_is_wrong_with_one() {
    let Some(mut tab) = tab_with([640, 360], WEBGL) else { return };
    let site = Files::start(built_package(), PAGE.to_owned());
    let host = Host::start(published());
    let open = |tab: &mut super::Tab, src: &str| {
        tab.navigate("about:blank");
        tab.navigate(&format!("{0}/page.html?package={0}&src={src}", site.origin()));
        tab.wait("the page", "typeof connection", |kind| kind == "object");
    };
    open(&mut tab, &host.url("small.lss"));
    tab.wait("it settles", "counts", |counts| counts["settled"].as_u64() >= Some(1));
    assert_eq!(tab.evaluate("[faults, connection.stats().transport]"), serde_json::json!([[], "http"]));

    let server = serve_for(TestScene::small(), &site);
    let mut native = Viewer::start(&server.address(Transport::WebSocket), config());
    native.settle();
    assert_eq!(tab.evaluate("sums()"), serde_json::to_value(sums(&native.changes)).unwrap());

    open(&mut tab, &host.url("missing.lss"));
    let fault = tab.wait("the error", "faults[0] ?? null", Value::is_string);
    assert!(fault.as_str().unwrap().contains("the published scene: it is not there (status 404)"), "{fault}");
}
