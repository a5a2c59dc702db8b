//! Meshes compressed with Draco, against Google's decoder and against the uncompressed file.

use std::io::Read as _;

use draco_core::{
    DataType, EncoderBuffer, EncoderOptions, FaceIndex, GeometryAttributeType, Mesh, MeshEncoder,
    PointAttribute, PointIndex,
};
use lodestream_geometry::mesh::SourceMesh;
use serde_json::json;
use tempfile::TempDir;

use super::{BYTE, FLOAT, Model, Random, SHORT, UBYTE, UINT, USHORT, refused, write};
use crate::{ImportError, import};

/// A torus with seams of texture coordinates in both directions, written by Draco 1.5.5 (`draco_encoder -cl LEVEL -qp
/// 12 -qt 11 -qn 9`; `raw`: `-cl 0 -qp 0 -qt 0 -qn 0`), and the OBJ file that its `draco_decoder` writes for it.
///
/// Level 0 stores triangles one by one and values as differences; level 4 uses Edgebreaker and parallelogram
/// prediction; from level 7 on connectivity is coded by valence, and normals and texture coordinates are predicted from
/// positions; level 10 predicts from several parallelograms.
const REFERENCE: [(&str, &[u8], &[u8]); 5] = [
    ("level 0", include_bytes!("draco/level-0.drc"), include_bytes!("draco/level-0.obj.gz")),
    ("level 4", include_bytes!("draco/level-4.drc"), include_bytes!("draco/level-4.obj.gz")),
    ("level 7", include_bytes!("draco/level-7.drc"), include_bytes!("draco/level-7.obj.gz")),
    ("level 10", include_bytes!("draco/level-10.drc"), include_bytes!("draco/level-10.obj.gz")),
    ("raw", include_bytes!("draco/raw.drc"), include_bytes!("draco/raw.obj.gz")),
];
/// Points and triangles of the torus.
const COUNTS: [usize; 2] = [117, 192];

/// An attribute's name, its number in the stream, its accessor's type and shape, and whether it is normalised.
type Listed = (&'static str, u32, u32, &'static str, bool);

const OBJ: [Listed; 3] = [
    ("POSITION", 0, FLOAT, "VEC3", false),
    ("TEXCOORD_0", 1, FLOAT, "VEC2", false),
    ("NORMAL", 2, FLOAT, "VEC3", false),
];

/// A file with one stream.
fn compressed(stream: &[u8], listed: &[Listed], [points, triangles]: [usize; 2]) -> Model {
    let mut model = Model::new();
    let view = model.view(stream);
    let mut numbers = json!({});
    for &(name, number, kind, shape, normalised) in listed {
        let accessor =
            json!({"componentType": kind, "type": shape, "count": points, "normalized": normalised});
        let accessor = model.push("accessors", accessor);
        model.attribute(name, accessor);
        numbers[name] = json!(number);
    }
    let indices = json!({"componentType": UINT, "type": "SCALAR", "count": 3 * triangles});
    let indices = model.push("accessors", indices);
    model.primitive()["indices"] = json!(indices);
    model.primitive()["extensions"] =
        json!({"KHR_draco_mesh_compression": {"bufferView": view, "attributes": numbers}});
    model.json["extensionsUsed"] = json!(["KHR_draco_mesh_compression"]);
    model.json["extensionsRequired"] = json!(["KHR_draco_mesh_compression"]);
    model
}

/// Each corner's position, normal, texture coordinates (running up) and colour, by face.
type Values = ([f64; 3], [f32; 3], [f32; 2], [u8; 4]);

fn corners(mesh: &SourceMesh) -> Vec<[Values; 3]> {
    let value = |corner: lodestream_geometry::mesh::Corner| {
        (
            mesh.positions[corner.position as usize],
            mesh.normals.get(corner.normal as usize).copied().unwrap_or_default(),
            mesh.uvs.get(corner.uv as usize).copied().unwrap_or_default(),
            mesh.colors.get(corner.color as usize).copied().unwrap_or_default(),
        )
    };
    mesh.faces.iter().map(|face| face.map(value)).collect()
}

/// The triangles in order, each beginning with its least corner.
fn sorted(mut faces: Vec<[Values; 3]>) -> Vec<[Values; 3]> {
    for face in &mut faces {
        let least = (0..3).min_by(|&a, &b| face[a].partial_cmp(&face[b]).unwrap()).unwrap();
        face.rotate_left(least);
    }
    faces.sort_by(|a, b| a.partial_cmp(b).unwrap());
    faces
}

#[test]
fn streams_of_the_reference_encoder_decode_as_by_its_decoder() {
    let dir = TempDir::new().unwrap();
    for (name, stream, decoded) in REFERENCE {
        let imported = compressed(stream, &OBJ, COUNTS).read().unwrap();
        assert!(imported.warnings.is_empty(), "{name}: {:?}", imported.warnings);
        let mut text = String::new();
        flate2::read::GzDecoder::new(decoded).read_to_string(&mut text).unwrap();
        let truth = import(&write(&dir, "truth.obj", text)).unwrap();
        let (ours, truth) = (corners(&imported.mesh), corners(&truth.mesh));
        assert_eq!((ours.len(), truth.len()), (COUNTS[1], COUNTS[1]), "{name}");
        for (ours, truth) in ours.into_iter().flatten().zip(truth.into_iter().flatten()) {
            // The text has six digits.
            let near = |a: f64, b: f64| (a - b).abs() < 2e-6;
            assert!((0..3).all(|i| near(ours.0[i], truth.0[i])), "{name}: {ours:?} {truth:?}");
            assert!((0..3).all(|i| near(ours.1[i].into(), truth.1[i].into())), "{name}: {ours:?} {truth:?}");
            // Texture coordinates of glTF run down, those of the OBJ file up.
            let down = [ours.2[0], 1.0 - ours.2[1]];
            assert!((0..2).all(|i| near(down[i].into(), truth.2[i].into())), "{name}: {ours:?} {truth:?}");
        }
    }
}

/// An open grid with every attribute that is read, each of another integer type.
struct Whole {
    faces: Vec<[u32; 3]>,
    attributes: Vec<(Listed, GeometryAttributeType, DataType, Vec<u8>)>,
    points: usize,
}

fn whole_numbers() -> Whole {
    const N: u32 = 7;
    let points = ((N + 1) * (N + 1)) as usize;
    let cell = |at: u32| {
        let (a, row) = (at / N * (N + 1) + at % N, N + 1);
        [[a, a + 1, a + row], [a + row, a + 1, a + row + 1]]
    };
    let faces = (0..N * N).flat_map(cell).collect();
    let place = |point: usize| (point as u32 % (N + 1), point as u32 / (N + 1));
    let each = |value: &dyn Fn(u32, u32) -> Vec<u8>| {
        (0..points).map(place).flat_map(|(x, y)| value(x, y)).collect::<Vec<u8>>()
    };
    let short = |v: u32| (v as u16).to_le_bytes();
    let attributes = vec![
        (
            ("POSITION", 0, SHORT, "VEC3", true),
            GeometryAttributeType::Position,
            DataType::Int16,
            each(&|x, y| [short(x * 4000), short(y * 4000), short((x * y * 77).wrapping_neg())].concat()),
        ),
        (
            ("NORMAL", 1, BYTE, "VEC3", true),
            GeometryAttributeType::Generic,
            DataType::Int8,
            each(&|x, y| vec![(x * 9) as u8, (y * 9).wrapping_neg() as u8, 100]),
        ),
        (
            ("TEXCOORD_0", 2, USHORT, "VEC2", true),
            GeometryAttributeType::TexCoord,
            DataType::Uint16,
            each(&|x, y| [short(x * 9362), short(y * 9362)].concat()),
        ),
        (
            ("COLOR_0", 3, UBYTE, "VEC4", true),
            GeometryAttributeType::Color,
            DataType::Uint8,
            each(&|x, y| vec![(x * 36) as u8, (y * 36) as u8, 9, 255 - (x * y) as u8]),
        ),
    ];
    Whole { faces, attributes, points }
}

impl Whole {
    fn uncompressed(&self) -> Model {
        let mut model = Model::new();
        for ((name, _, kind, shape, normalised), _, _, bytes) in &self.attributes {
            let accessor = model.accessor(*kind, shape, self.points, bytes);
            model.json["accessors"][accessor]["normalized"] = json!(normalised);
            model.attribute(name, accessor);
        }
        let bytes: Vec<u8> = self.faces.as_flattened().iter().flat_map(|i| i.to_le_bytes()).collect();
        let indices = model.accessor(UINT, "SCALAR", 3 * self.faces.len(), &bytes);
        model.primitive()["indices"] = json!(indices);
        model
    }

    /// The stream at one of the encoder's levels; 0 keeps the order of points and faces.
    fn stream(&self, level: i32) -> Vec<u8> {
        let mut mesh = Mesh::new();
        mesh.set_num_points(self.points);
        mesh.set_num_faces(self.faces.len());
        for (number, face) in self.faces.iter().enumerate() {
            mesh.set_face(FaceIndex(number as u32), face.map(PointIndex));
        }
        for ((_, number, _, shape, normalised), kind, data, bytes) in &self.attributes {
            let components = shape.as_bytes()[3] - b'0';
            let mut attribute = PointAttribute::new();
            attribute.init(*kind, components, *data, *normalised, self.points);
            attribute.buffer_mut().write(0, bytes);
            attribute.set_unique_id(*number);
            mesh.add_attribute_preserve_unique_id(attribute);
        }
        let mut options = EncoderOptions::new();
        options.set_compression_level(level);
        let mut encoder = MeshEncoder::new();
        encoder.set_mesh(mesh);
        let mut out = EncoderBuffer::new();
        encoder.encode(&options, &mut out).unwrap();
        out.data().to_vec()
    }

    fn compressed(&self, level: i32) -> Model {
        let listed: Vec<Listed> = self.attributes.iter().map(|attribute| attribute.0).collect();
        compressed(&self.stream(level), &listed, [self.points, self.faces.len()])
    }
}

#[test]
fn integers_of_every_type_decode_as_in_the_uncompressed_file() {
    let whole = whole_numbers();
    let uncompressed = whole.uncompressed();
    // Attributes need a stride, since their elements have three bytes here.
    let uncompressed = corners(&uncompressed.read().unwrap().mesh);
    assert!(uncompressed.iter().flatten().any(|corner| corner.3 != uncompressed[0][0].3), "colours differ");
    for level in [0, 3, 5, 7, 10] {
        let ours = whole.compressed(level).read().unwrap();
        assert!(ours.warnings.is_empty(), "{:?}", ours.warnings);
        let ours = corners(&ours.mesh);
        if level == 0 {
            assert_eq!(ours, uncompressed, "nothing is put in another order");
        }
        assert_eq!(sorted(ours), sorted(uncompressed.clone()), "level {level}");
    }
}

#[test]
fn a_stream_placed_twice_gives_its_faces_twice() {
    let mut model = compressed(REFERENCE[2].1, &OBJ, COUNTS);
    model.json["nodes"] = json!([{"mesh": 0, "children": [1]}, {"mesh": 0, "translation": [9, 0, 0]}]);
    let mesh = model.read().unwrap().mesh;
    assert_eq!((mesh.faces.len(), mesh.positions.len()), (2 * COUNTS[1], 2 * COUNTS[0]));
}

#[test]
fn attributes_that_are_uncompressed_too_are_read_from_there() {
    let mut model = Model::quad();
    let garbage = model.view(b"DRACO and so on");
    model.primitive()["extensions"] =
        json!({"KHR_draco_mesh_compression": {"bufferView": garbage, "attributes": {"POSITION": 0}}});
    model.json["extensionsUsed"] = json!(["KHR_draco_mesh_compression"]);
    let imported = model.read().unwrap();
    assert!(imported.warnings.is_empty(), "{:?}", imported.warnings);
    assert_eq!(imported.mesh, Model::quad().read().unwrap().mesh);
    // A primitive without uncompressed attributes is decoded, whether the extension is required or not.
    let mut model = compressed(REFERENCE[0].1, &OBJ, COUNTS);
    model.json.as_object_mut().unwrap().remove("extensionsRequired");
    assert_eq!(model.read().unwrap().mesh.faces.len(), COUNTS[1]);
    // An attribute that the stream lacks is read from its accessor.
    let mut model = compressed(REFERENCE[0].1, &OBJ[..1], COUNTS);
    let uvs = model.floats("VEC2", 2, &[0.25; 2 * COUNTS[0]]);
    model.attribute("TEXCOORD_0", uvs);
    assert_eq!(model.read().unwrap().mesh.uvs[3], [0.25, 0.75]);
}

#[test]
fn streams_that_contradict_their_file_are_refused_with_their_place() {
    let with = |change: &dyn Fn(&mut Model)| {
        let mut model = compressed(REFERENCE[2].1, &OBJ, COUNTS);
        change(&mut model);
        model
    };
    let extension = "/meshes/0/primitives/0/extensions/KHR_draco_mesh_compression";
    let set = |path: String, value: serde_json::Value| {
        with(&|model: &mut Model| *model.json.pointer_mut(&path).unwrap() = value.clone())
    };
    let place = "meshes[0].primitives[0]";
    set("/accessors/3/count".into(), json!(300)).refused(&[
        place,
        "bufferViews[0]",
        "100 triangles",
        "again",
    ]);
    set("/accessors/0/count".into(), json!(12)).refused(&[place, "bufferViews[0]", "12 points", "again"]);
    set("/accessors/0/type".into(), json!("VEC2")).refused(&["POSITION", "accessors[0]", "3 components"]);
    set("/accessors/1/type".into(), json!("VEC3")).refused(&["TEXCOORD_0", "2 components"]);
    set(format!("{extension}/attributes/NORMAL"), json!(9)).refused(&["NORMAL", "attribute 9"]);
    set(format!("{extension}/bufferView"), json!(4)).refused(&["bufferViews[4] does not exist"]);
    set(extension.into(), json!({"bufferView": 0})).refused(&[place, "not understood", "attributes"]);
    with(&|model| model.bin[7] = 9).refused(&[place, "does not decode as Draco"]);
    // Otherwise the same bytes would be decoded twice.
    with(&|model| {
        let view = model.json["bufferViews"][0].clone();
        model.push("bufferViews", view);
        let mut second = model.primitive().clone();
        second["extensions"]["KHR_draco_mesh_compression"]["bufferView"] = json!(1);
        model.push("meshes", json!({"primitives": [second]}));
        model.json["nodes"] = json!([{"mesh": 0, "children": [1]}, {"mesh": 1}]);
    })
    .refused(&["bufferViews[1]", "overlap"]);
    refused(compressed(b"DRACO", &OBJ, COUNTS).glb(), &["does not decode"]);
}

#[test]
fn every_truncation_of_a_stream_is_an_error() {
    for (name, stream, _) in REFERENCE {
        for length in 0..stream.len() {
            let cut = compressed(&stream[..length], &OBJ, COUNTS).read();
            assert!(matches!(cut, Err(ImportError::Gltf { .. })), "{name} cut to {length}");
        }
    }
}

#[test]
fn no_damaged_stream_is_a_panic() {
    let whole = whole_numbers();
    let listed: Vec<Listed> = whole.attributes.iter().map(|attribute| attribute.0).collect();
    let mut streams: Vec<(Vec<u8>, &[Listed])> =
        REFERENCE.iter().map(|(_, stream, _)| (stream.to_vec(), &OBJ[..])).collect();
    streams.extend([0, 7].map(|level| (whole.stream(level), &listed[..])));
    let mut random = Random(23);
    let (mut accepted, mut refused) = (0, 0);
    for (stream, listed) in streams {
        for round in 0..1000 {
            let mut damaged = stream.clone();
            for _ in 0..=random.below(3) {
                // The head determines how the rest is read, so half of the rounds damage it.
                let end = if round % 2 == 0 { damaged.len() } else { damaged.len().min(64) };
                let at = random.below(end);
                damaged[at] = random.next() as u8;
            }
            // Counts so large that only the decoder's own limits apply.
            match compressed(&damaged, listed, [1 << 20, 1 << 20]).read() {
                Ok(_) => accepted += 1,
                Err(_) => refused += 1,
            }
        }
    }
    assert!(accepted > 500 && refused > 500, "{accepted} {refused}");
}
