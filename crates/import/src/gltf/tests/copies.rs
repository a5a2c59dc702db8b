//! Copies of meshes whose transformations were applied to their vertices.

use std::collections::BTreeSet;
use std::io;
use std::ops::Range;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use bytes::Bytes;
use glam::{DMat4, DQuat, DVec3, EulerRot};
use serde_json::json;
use tempfile::TempDir;

use super::{Model, USHORT, contents, places, write};
use crate::gltf::{Contents, CopyTolerance, Document};
use crate::meshopt::tests::Random;
use crate::{Content, CreaseAngle, Part, import, import_part};

const TOLERANCE: CopyTolerance = CopyTolerance::Share(1.0 / 65_536.0);

/// A file without meshes.
fn empty() -> Model {
    let mut model = Model::new();
    (model.json["meshes"], model.json["nodes"]) = (json!([]), json!([]));
    model.json["scenes"][0]["nodes"] = json!([]);
    model
}

/// Adds a mesh with a node.
fn push(model: &mut Model, positions: &[DVec3], faces: &[[u16; 3]], translation: [f64; 3]) -> usize {
    let numbers: Vec<f32> = positions.iter().flat_map(|p| p.as_vec3().to_array()).collect();
    let positions = model.floats("VEC3", 3, &numbers);
    let bytes: Vec<u8> = faces.as_flattened().iter().flat_map(|i| i.to_le_bytes()).collect();
    let indices = model.accessor(USHORT, "SCALAR", 3 * faces.len(), &bytes);
    push_mesh(model, json!({"attributes": {"POSITION": positions}, "indices": indices}), translation)
}

fn push_mesh(model: &mut Model, primitive: serde_json::Value, translation: [f64; 3]) -> usize {
    let mesh = model.push("meshes", json!({"primitives": [primitive]}));
    let node = model.push("nodes", json!({"mesh": mesh, "translation": translation}));
    model.json["scenes"][0]["nodes"].as_array_mut().unwrap().push(json!(node));
    mesh
}

/// An irregular strip of triangles.
fn shape(random: &mut Random, vertices: usize) -> (Vec<DVec3>, Vec<[u16; 3]>) {
    let mut number = || random.below(1 << 16) as f64 / f64::from(1 << 14);
    let points = (0..vertices).map(|_| DVec3::new(number(), number(), number())).collect();
    let faces = (2..vertices as u16).map(|i| [i - 2, i - 1, i]).collect();
    (points, faces)
}

fn read(model: &Model, copies: Option<CopyTolerance>) -> Contents {
    let dir = TempDir::new().unwrap();
    contents(&write(&dir, "a.glb", model.glb()), copies).unwrap()
}

/// The mesh that each mesh is placed as.
fn originals(contents: &Contents) -> Vec<usize> {
    let original = |part: &Part| match part {
        Part::Mesh { mesh, .. } => *mesh,
        _ => panic!("{part:?}"),
    };
    contents.placed.iter().map(|placed| original(&placed.part)).collect()
}

#[test]
fn turned_enlarged_and_mirrored_copies_become_instances_where_they_were() {
    let mut random = Random(5);
    let mut model = empty();
    let (points, faces) = shape(&mut random, 40);
    for i in 0..24 {
        let turn = f64::from(i) * 0.7;
        let mirror = if i % 3 == 2 { -1.0 } else { 1.0 };
        let map = DMat4::from_scale_rotation_translation(
            DVec3::new(1.0, mirror, 1.0) * (1.0 + turn),
            DQuat::from_euler(EulerRot::XYZ, turn, 2.0 * turn, -turn),
            DVec3::new(turn, -turn, 3.0),
        );
        let points: Vec<DVec3> = points.iter().map(|&p| map.transform_point3(p)).collect();
        // A mirror image whose faces go around the other way, each from another corner.
        let around = |&[a, b, c]: &[u16; 3]| if mirror < 0.0 { [c, b, a] } else { [b, c, a] };
        let faces: Vec<[u16; 3]> = faces.iter().map(around).collect();
        push(&mut model, &points, &faces, [5e5 + 10.0 * f64::from(i), 0.0, -4e6]);
    }
    let dir = TempDir::new().unwrap();
    let path = write(&dir, "a.glb", model.glb());
    let found = contents(&path, Some(TOLERANCE)).unwrap();
    assert_eq!(originals(&found), vec![0; 24]);
    let parts: Vec<&Part> = found.placed.iter().map(|placed| &placed.part).collect();
    let mirrored: BTreeSet<usize> = (0..24).filter(|&i| parts[i] != parts[0]).collect();
    assert_eq!(mirrored, (2..24).step_by(3).collect(), "one more asset for all that are mirrored");
    assert!(mirrored.iter().all(|&i| parts[i] == parts[2]));
    // Where the file has it, face by face, and the right way round.
    let expected = places(&import(&path).unwrap());
    for (i, placed) in found.placed.iter().enumerate() {
        assert_eq!(placed.mesh, i);
        let part = places(&import_part(&path, &placed.part, CreaseAngle::default()).unwrap());
        // The tolerance, of bounds that are 4 wide before they are enlarged and turned.
        let limit = 4.0 * (1.0 + 0.7 * i as f64) * 3.0_f64.sqrt() / 65_536.0;
        for (face, expected) in part.iter().zip(&expected[i * 38..]) {
            let face = face.map(|p| placed.placement.to_world(DVec3::from_array(p)));
            let turned = (0..3).any(|start| {
                (0..3).all(|i| face[(start + i) % 3].distance(DVec3::from_array(expected[i])) < limit)
            });
            assert!(turned, "mesh {i}: {face:?} {expected:?}");
        }
    }
    // Without a tolerance each mesh is itself.
    assert_eq!(originals(&read(&model, None)), (0..24).collect::<Vec<_>>());
}

#[test]
fn meshes_that_differ_by_more_than_the_tolerance_are_no_copies() {
    let mut random = Random(6);
    let (points, faces) = shape(&mut random, 30);
    type Change<'a> = &'a dyn Fn(&mut Vec<DVec3>, &mut Vec<[u16; 3]>);
    let with = |change: Change<'_>| {
        let mut model = empty();
        push(&mut model, &points, &faces, [0.0; 3]);
        let (mut points, mut faces) = (points.clone(), faces.clone());
        change(&mut points, &mut faces);
        push(&mut model, &points, &faces, [9.0, 0.0, 0.0]);
        originals(&read(&model, Some(TOLERANCE)))
    };
    assert_eq!(with(&|_, _| {}), [0, 0]);
    // The extent is about 4, the tolerance 6e-5.
    assert_eq!(with(&|points, _| points[7].x += 3e-5), [0, 0]);
    assert_eq!(with(&|points, _| points[7].x += 3e-4), [0, 1]);
    assert_eq!(with(&|points, _| points.iter_mut().for_each(|p| p.y *= 1.01)), [0, 1], "uneven");
    assert_eq!(with(&|points, _| points.iter_mut().for_each(|p| p.y = -p.y)), [0, 1], "inside out");
    assert_eq!(with(&|_, faces| faces.swap(2, 3)), [0, 1]);
    assert_eq!(with(&|points, _| points.swap(1, 28)), [0, 1]);
    assert_eq!(with(&|points, _| points.fill(DVec3::ONE)), [0, 1], "no extent");
    assert_eq!(with(&|points, _| points[3].z = f64::NAN), [0, 1]);
}

#[test]
fn copies_have_equal_materials_normals_and_colours() {
    let quad = |model: &mut Model, turn: f32, color: u8, material: usize| {
        let (sin, cos) = turn.sin_cos();
        let corners = [[0., 0.], [1., 0.], [1., 2.], [0., 2.]];
        let turned: Vec<f32> =
            corners.iter().flat_map(|[x, y]| [cos * x - sin * y, sin * x + cos * y, 0.]).collect();
        let positions = model.floats("VEC3", 3, &turned);
        let normals = [sin * -0.6, cos * 0.6, 0.8].repeat(4);
        let normals = model.floats("VEC3", 3, &normals);
        let colors = model.accessor(super::UBYTE, "VEC4", 4, &[color; 16]);
        model.json["accessors"][colors]["normalized"] = json!(true);
        let bytes: Vec<u8> = [0u16, 1, 2, 0, 2, 3].iter().flat_map(|i| i.to_le_bytes()).collect();
        let indices = model.accessor(USHORT, "SCALAR", 6, &bytes);
        let attributes = json!({"POSITION": positions, "NORMAL": normals, "COLOR_0": colors});
        let primitive = json!({"attributes": attributes, "indices": indices, "material": material});
        push_mesh(model, primitive, [0.0; 3]);
        normals
    };
    let mut model = empty();
    model.json["materials"] = json!([{"name": "a"}, {"name": "b"}]);
    quad(&mut model, 0.0, 200, 0);
    quad(&mut model, 1.0, 200, 0);
    quad(&mut model, 2.0, 200, 1);
    quad(&mut model, 3.0, 100, 0);
    let other = quad(&mut model, 0.0, 200, 0);
    assert_eq!(originals(&read(&model, Some(TOLERANCE))), [0, 0, 2, 3, 0]);
    // The same positions turned differ in their normals if these did not turn.
    let view = model.json["accessors"][other]["bufferView"].as_u64().unwrap() as usize;
    let offset = model.json["bufferViews"][view]["byteOffset"].as_u64().unwrap() as usize;
    model.bin[offset..offset + 12]
        .copy_from_slice(&[0.0f32, -0.6, 0.8].iter().flat_map(|x| x.to_le_bytes()).collect::<Vec<_>>());
    assert_eq!(originals(&read(&model, Some(TOLERANCE))), [0, 0, 2, 3, 4]);
}

#[test]
fn meshes_of_the_same_accessors_are_copies_whatever_they_are() {
    let mut model = Model::quad();
    // Of one triangle without area, which no fit tells apart.
    let flat = model.floats("VEC3", 3, &[1., 1., 1., 2., 2., 2., 3., 3., 3.]);
    let point = model.floats("VEC3", 3, &[1.; 9]);
    for accessor in [flat, flat, point, point] {
        push_mesh(&mut model, json!({"attributes": {"POSITION": accessor}}), [1.0; 3]);
    }
    let found = read(&model, Some(TOLERANCE));
    assert_eq!(originals(&found), [0, 1, 1, 3, 3]);
    assert_eq!(found.placed[4].placement.translation, [1.0; 3]);
}

#[test]
fn meshes_that_share_one_range_of_bytes_are_read_within_a_limit() {
    let mut random = Random(8);
    let mut model = empty();
    let (points, faces) = shape(&mut random, 3_000);
    let first = push(&mut model, &points, &faces, [0.0; 3]);
    // Meshes of a few bytes of JSON, each with all the vertices.
    for _ in 0..300 {
        let mut primitive = model.json["meshes"][first]["primitives"][0].clone();
        let again = model.json["accessors"][0].clone();
        primitive["attributes"]["POSITION"] = json!(model.push("accessors", again));
        push_mesh(&mut model, primitive, [0.0; 3]);
    }
    let found = originals(&read(&model, Some(TOLERANCE)));
    assert_eq!(found.len(), 301);
    // The first ones are compared; then the limit is reached.
    assert!(found[..5].iter().all(|&original| original == 0), "{found:?}");
    assert_eq!(found[300], 300);
}

#[test]
fn ten_thousand_shapes_of_the_same_faces_are_told_apart() {
    let mut random = Random(9);
    let mut model = empty();
    for i in 0..5_000 {
        let (points, faces) = shape(&mut random, 5);
        // Pairs of equal shapes.
        push(&mut model, &points, &faces, [f64::from(i), 0.0, 0.0]);
        push(&mut model, &points, &faces, [f64::from(i), 9.0, 0.0]);
    }
    let found = originals(&read(&model, Some(TOLERANCE)));
    assert!(found.iter().enumerate().all(|(i, &original)| original == i & !1));
}

/// Counts the bytes that are read.
#[derive(Debug)]
struct Counting(Bytes, AtomicU64);

impl Content for Counting {
    fn length(&self) -> u64 {
        self.0.length()
    }

    fn read(&self, range: Range<u64>) -> io::Result<Bytes> {
        self.1.fetch_add(range.end - range.start, Ordering::Relaxed);
        self.0.read(range)
    }
}

#[test]
fn each_mesh_is_read_once_however_many_copies_there_are() {
    let mut random = Random(11);
    let mut model = empty();
    let (points, faces) = shape(&mut random, 30);
    for i in 0..50 {
        let turn = DQuat::from_rotation_y(f64::from(i));
        let points: Vec<DVec3> = points.iter().map(|&p| turn * p).collect();
        push(&mut model, &points, &faces, [0.0; 3]);
    }
    let counting = Arc::new(Counting(model.glb().into(), AtomicU64::new(0)));
    let document = Document::parse(Path::new("a.glb"), Arc::<Counting>::clone(&counting)).unwrap();
    let stored = document.root.buffers[0].byte_length.0;
    counting.1.store(0, Ordering::Relaxed);
    assert_eq!(originals(&document.contents(None).unwrap()), (0..50).collect::<Vec<_>>());
    assert_eq!(counting.1.load(Ordering::Relaxed), 0, "no mesh is read without a search for copies");
    assert_eq!(originals(&document.contents(Some(TOLERANCE)).unwrap()), [0; 50]);
    let read = counting.1.load(Ordering::Relaxed);
    assert!(read <= stored, "{read} bytes of {stored}");
}
