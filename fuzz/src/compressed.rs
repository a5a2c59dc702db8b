//! Inputs of the target `gltf_compressed`: compressed streams, and glTF files around them.
//!
//! The first byte of an input selects the codec: 0 for Draco, followed by a byte with a bit for each of the attributes
//! 1 to 3 that the file uses; else a codec of meshoptimizer, followed by the filter, a quarter of the element length,
//! and the number of elements in four bytes. The rest is the stream.

use draco_core::{
    DataType, EncoderBuffer, EncoderOptions, FaceIndex, GeometryAttributeType, Mesh, MeshEncoder,
    PointAttribute, PointIndex,
};
use lodestream_geometry::mesh::SourceMesh;
use serde_json::{Value, json};

use crate::common::shapes;
use crate::glb::glb;

const DRACO: u8 = 0;
const ATTRIBUTES: u8 = 1;
const TRIANGLES: u8 = 2;
const INDICES: u8 = 3;
const FILTERS: [&str; 5] = ["NONE", "OCTAHEDRAL", "QUATERNION", "EXPONENTIAL", "COLOR"];
/// Number of vertices that the indices of a codec refer to; they are not compressed.
const VERTICES: usize = 64;
/// Points and corners that a file states for a Draco stream: no limit for the decoder.
const STATED: u32 = 1 << 30;

/// A GLB file that contains an input's stream; `None` for an unknown codec.
pub(crate) fn file(data: &[u8]) -> Option<Vec<u8>> {
    match data {
        [DRACO, listed, stream @ ..] => Some(draco(*listed, stream)),
        [mode @ ATTRIBUTES..=INDICES, filter, quarter, c0, c1, c2, c3, stream @ ..] => {
            let filter = FILTERS.get(usize::from(*filter))?;
            let count = u32::from_le_bytes([*c0, *c1, *c2, *c3]);
            Some(meshopt(*mode, filter, 4 * usize::from(*quarter), count, stream))
        }
        _ => None,
    }
}

fn document(attributes: &Value, indices: Option<usize>, accessors: &Value, views: &Value) -> Value {
    json!({
        "asset": {"version": "2.0"}, "nodes": [{"mesh": 0}], "scenes": [{"nodes": [0]}],
        "meshes": [{"primitives": [match indices {
            Some(indices) => json!({"attributes": attributes, "indices": indices}),
            None => json!({"attributes": attributes}),
        }]}],
        "accessors": accessors, "bufferViews": views,
    })
}

fn draco(listed: u8, stream: &[u8]) -> Vec<u8> {
    let (mut attributes, mut numbers, mut accessors) = (json!({}), json!({}), Vec::new());
    let all = [("POSITION", "VEC3"), ("NORMAL", "VEC3"), ("TEXCOORD_0", "VEC2"), ("COLOR_0", "VEC4")];
    for (number, (name, shape)) in all.into_iter().enumerate() {
        if number == 0 || listed >> number & 1 == 1 {
            attributes[name] = json!(accessors.len());
            numbers[name] = json!(number);
            accessors.push(json!({"componentType": 5126, "type": shape, "count": STATED}));
        }
    }
    let indices = accessors.len();
    accessors.push(json!({"componentType": 5125, "type": "SCALAR", "count": STATED}));
    let views = json!([{"buffer": 0, "byteLength": stream.len()}]);
    let mut json = document(&attributes, Some(indices), &json!(accessors), &views);
    json["meshes"][0]["primitives"][0]["extensions"]["KHR_draco_mesh_compression"] =
        json!({"bufferView": 0, "attributes": numbers});
    json["extensionsRequired"] = json!(["KHR_draco_mesh_compression"]);
    json["buffers"] = json!([{"byteLength": stream.len()}]);
    glb(&json.to_string(), stream)
}

fn meshopt(mode: u8, filter: &str, stride: usize, count: u32, stream: &[u8]) -> Vec<u8> {
    let mut bin = stream.to_vec();
    let mut said = json!({
        "buffer": 0, "byteLength": stream.len(), "byteStride": stride, "count": count, "filter": filter,
    });
    let mut view = json!({"buffer": 1, "byteLength": 0});
    let mut json = if mode == ATTRIBUTES {
        said["mode"] = json!("ATTRIBUTES");
        view["byteStride"] = json!(stride);
        // As many components as an element of this length has.
        let kind = if stride >= 12 { 5126 } else { 5120 };
        let accessors = json!([{"bufferView": 0, "componentType": kind, "type": "VEC3", "count": count, "normalized": kind == 5120}]);
        document(&json!({"POSITION": 0}), None, &accessors, &json!([view]))
    } else {
        said["mode"] = json!(if mode == TRIANGLES { "TRIANGLES" } else { "INDICES" });
        let offset = bin.len().next_multiple_of(4);
        bin.resize(offset, 0);
        for vertex in 0..VERTICES {
            let place = [vertex % 8, vertex / 8, vertex % 3].map(|v| v as f32);
            bin.extend(place.iter().flat_map(|v| v.to_le_bytes()));
        }
        let accessors = json!([
            {"bufferView": 1, "componentType": 5126, "type": "VEC3", "count": VERTICES},
            {"bufferView": 0, "componentType": 5125, "type": "SCALAR", "count": count},
        ]);
        let vertices = json!({"buffer": 0, "byteOffset": offset, "byteLength": bin.len() - offset});
        document(&json!({"POSITION": 0}), Some(1), &accessors, &json!([view, vertices]))
    };
    json["bufferViews"][0]["extensions"]["KHR_meshopt_compression"] = said;
    json["extensionsRequired"] = json!(["KHR_meshopt_compression"]);
    json["buffers"] = json!([{"byteLength": bin.len()}, {"byteLength": 0}]);
    glb(&json.to_string(), &bin)
}

/// Encodes a mesh with Draco, optionally with normals, texture coordinates and colours derived from positions.
fn draco_stream(mesh: &SourceMesh, level: i32, all: bool) -> Vec<u8> {
    let mut source = Mesh::new();
    let count = mesh.positions.len();
    source.set_num_points(count);
    source.set_num_faces(mesh.faces.len());
    for (number, face) in mesh.faces.iter().enumerate() {
        source.set_face(FaceIndex(number as u32), face.map(|corner| PointIndex(corner.position)));
    }
    let mut options = EncoderOptions::new();
    options.set_compression_level(level);
    let mut add = |kind, components: u8, data: DataType, bytes: &[u8]| {
        let mut attribute = PointAttribute::new();
        attribute.init(kind, components, data, data == DataType::Uint8, count);
        attribute.buffer_mut().write(0, bytes);
        let number = source.add_attribute(attribute);
        if data == DataType::Float32 {
            options.set_attribute_quantization(number, 10);
        }
    };
    let floats = |of: &dyn Fn([f64; 3]) -> Vec<f64>| -> Vec<u8> {
        mesh.positions.iter().flat_map(|&p| of(p)).flat_map(|v| (v as f32).to_le_bytes()).collect()
    };
    add(GeometryAttributeType::Position, 3, DataType::Float32, &floats(&|p| p.to_vec()));
    if all {
        let unit = |p: [f64; 3]| {
            let length = p.iter().map(|v| v * v).sum::<f64>().sqrt().max(1e-9);
            p.map(|v| v / length).to_vec()
        };
        add(GeometryAttributeType::Normal, 3, DataType::Float32, &floats(&unit));
        add(GeometryAttributeType::TexCoord, 2, DataType::Float32, &floats(&|p| vec![p[0] * 0.5, p[1]]));
        let colors: Vec<u8> = (0..4 * count).map(|i| (i * 7) as u8).collect();
        add(GeometryAttributeType::Color, 4, DataType::Uint8, &colors);
    }
    let mut encoder = MeshEncoder::new();
    encoder.set_mesh(source);
    let mut out = EncoderBuffer::new();
    encoder.encode(&options, &mut out).expect("a mesh is encoded");
    [&[DRACO, if all { 14 } else { 0 }], out.data()].concat()
}

/// An input for a codec of meshoptimizer.
fn coded(mode: u8, filter: u8, stride: usize, count: usize, stream: &[u8]) -> Vec<u8> {
    [&[mode, filter, (stride / 4) as u8], &(count as u32).to_le_bytes()[..], stream].concat()
}

/// Seeds for every codec and filter.
pub(crate) fn seeds() -> Vec<(String, Vec<u8>)> {
    let seed = |name: &str, bytes| (name.to_owned(), bytes);
    let mesh = shapes::torus(5, 7);
    let mut seeds = vec![
        seed("draco-sequential", draco_stream(&mesh, 0, false)),
        seed("draco-edgebreaker", draco_stream(&mesh, 4, false)),
        seed("draco-valence", draco_stream(&mesh, 7, false)),
        seed("draco-all-sequential", draco_stream(&mesh, 0, true)),
        seed("draco-all-edgebreaker", draco_stream(&mesh, 4, true)),
        seed("draco-all-valence", draco_stream(&mesh, 10, true)),
    ];
    let positions: Vec<[f32; 3]> = mesh.positions.iter().map(|p| p.map(|v| v as f32)).collect();
    let count = positions.len() / 3 * 3;
    let positions = &positions[..count];
    for version in [0, 1] {
        let stream =
            meshopt::encode_vertex_buffer_level(positions, 3, Some(version)).expect("elements are encoded");
        seeds.push(seed(&format!("attributes-{version}"), coded(ATTRIBUTES, 0, 12, count, &stream)));
    }
    let filtered = meshopt::encode_filter_exp(positions, 12, meshopt::EncodeExpMode::SharedVector);
    let stream = meshopt::encode_vertex_buffer(&filtered).expect("elements are encoded");
    seeds.push(seed("exponential", coded(ATTRIBUTES, 3, 12, count, &stream)));
    let vectors: Vec<[f32; 4]> =
        positions.iter().map(|&[x, y, z]| [x * 0.4, y * 0.4, z * 0.4, 0.5]).collect();
    let filtered = meshopt::encode_filter_oct::<i8>(&vectors, 8);
    let stream = meshopt::encode_vertex_buffer(&filtered).expect("elements are encoded");
    seeds.push(seed("octahedral", coded(ATTRIBUTES, 1, 4, count, &stream)));
    let filtered = meshopt::encode_filter_quat(&vectors, 12);
    let stream = meshopt::encode_vertex_buffer(&filtered).expect("elements are encoded");
    seeds.push(seed("quaternion", coded(ATTRIBUTES, 2, 8, count, &stream)));
    let filtered = meshopt::encode_filter_color::<u8>(&vectors, 8);
    let stream = meshopt::encode_vertex_buffer(&filtered).expect("elements are encoded");
    seeds.push(seed("color", coded(ATTRIBUTES, 4, 4, count, &stream)));
    let indices: Vec<u32> = mesh.faces.as_flattened().iter().map(|corner| corner.position).collect();
    let stream = meshopt::encode_index_buffer(&indices, VERTICES).expect("indices are encoded");
    seeds.push(seed("triangles", coded(TRIANGLES, 0, 4, indices.len(), &stream)));
    let stream = meshopt::encode_index_sequence(&indices, VERTICES).expect("indices are encoded");
    seeds.push(seed("indices", coded(INDICES, 0, 4, indices.len(), &stream)));
    seeds
}
