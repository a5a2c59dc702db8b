//! A compressed model gives the same pack as the uncompressed one, except for the key of its inputs.

use std::process::Command;

use draco_core::{
    DataType, DecoderBuffer, EncoderBuffer, EncoderOptions, FaceIndex, GeometryAttributeType, MeshDecoder,
    MeshEncoder, PointAttribute, PointIndex,
};
use lodestream_geometry::pack::HEAD_BYTES;
use serde_json::{Value, json};
use tempfile::TempDir;

/// Offset of the key of the inputs in a pack's head; the head's own hash follows it.
const KEY: usize = 16;

/// A mesh with the types of a file: floats and 32-bit indices.
struct Mesh {
    positions: Vec<[f32; 3]>,
    normals: Vec<[f32; 3]>,
    uvs: Vec<[f32; 2]>,
    faces: Vec<[u32; 3]>,
}

/// An open, wavy sheet.
fn sheet() -> Mesh {
    const N: u32 = 40;
    let each = || {
        (0..(N + 1) * (N + 1)).map(|at| ((at % (N + 1)) as f32 / N as f32, (at / (N + 1)) as f32 / N as f32))
    };
    let cell = |at: u32| {
        let (a, row) = (at / N * (N + 1) + at % N, N + 1);
        [[a, a + 1, a + row], [a + row, a + 1, a + row + 1]]
    };
    let normal = |x: f32, y: f32| {
        let n = [-0.7 * (7.0 * x).cos(), 0.5 * (5.0 * y).sin(), 1.0];
        let length = n.iter().map(|v| v * v).sum::<f32>().sqrt();
        n.map(|v| v / length)
    };
    Mesh {
        positions: each().map(|(x, y)| [x, y, 0.1 * ((7.0 * x).sin() + (5.0 * y).cos())]).collect(),
        normals: each().map(|(x, y)| normal(x, y)).collect(),
        uvs: each().map(|(x, y)| [x, y * y]).collect(),
        faces: (0..N * N).flat_map(cell).collect(),
    }
}

fn bytes(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|v| v.to_le_bytes()).collect()
}

impl Mesh {
    /// Name, shape, components and bytes of each attribute.
    fn attributes(&self) -> [(&'static str, &'static str, usize, Vec<u8>); 3] {
        [
            ("POSITION", "VEC3", 3, bytes(self.positions.as_flattened())),
            ("NORMAL", "VEC3", 3, bytes(self.normals.as_flattened())),
            ("TEXCOORD_0", "VEC2", 2, bytes(self.uvs.as_flattened())),
        ]
    }

    fn indices(&self) -> Vec<u8> {
        self.faces.as_flattened().iter().flat_map(|i| i.to_le_bytes()).collect()
    }

    /// A glTF file; `view` adds a buffer view with the bytes of an attribute or of the indices.
    fn file(&self, mut view: impl FnMut(&mut File, &[u8], Option<usize>) -> Option<usize>) -> File {
        let mut file = File::new();
        let mut primitive = json!({"attributes": {}});
        for (name, shape, components, bytes) in self.attributes() {
            let view = view(&mut file, &bytes, Some(4 * components));
            primitive["attributes"][name] = file.accessor(view, 5126, shape, self.positions.len());
        }
        let view = view(&mut file, &self.indices(), None);
        primitive["indices"] = file.accessor(view, 5125, "SCALAR", 3 * self.faces.len());
        file.json["meshes"] = json!([{"primitives": [primitive]}]);
        file
    }

    fn plain(&self) -> File {
        self.file(|file, bytes, _| Some(file.view(bytes)))
    }

    /// Compressed by meshoptimizer's codecs.
    fn meshopt(&self, extension: &str, version: i32) -> File {
        let mut file = self.file(|file, bytes, stride| {
            let lanes = |at: usize| bytes[at..at + 4].try_into().unwrap();
            let (data, mode) = match stride {
                None => {
                    let indices: Vec<u32> =
                        (0..bytes.len()).step_by(4).map(|at| u32::from_le_bytes(lanes(at))).collect();
                    (meshopt::encode_index_sequence(&indices, self.positions.len()), "INDICES")
                }
                Some(8) => {
                    let (elements, []) = bytes.as_chunks::<8>() else { panic!("whole elements") };
                    (meshopt::encode_vertex_buffer_level(elements, 3, Some(version)), "ATTRIBUTES")
                }
                Some(_) => {
                    let (elements, []) = bytes.as_chunks::<12>() else { panic!("whole elements") };
                    (meshopt::encode_vertex_buffer_level(elements, 3, Some(version)), "ATTRIBUTES")
                }
            };
            let view = file.view(&data.unwrap());
            let mut said = file.json["bufferViews"][view].take();
            let stride = stride.unwrap_or(4);
            said["mode"] = json!(mode);
            said["byteStride"] = json!(stride);
            said["count"] = json!(bytes.len() / stride);
            let mut compressed = json!({"buffer": 1, "byteLength": bytes.len()});
            compressed["extensions"][extension] = said;
            file.json["bufferViews"][view] = compressed;
            Some(view)
        });
        file.json["buffers"].as_array_mut().unwrap().push(json!({"byteLength": 1 << 20}));
        file.requires(extension)
    }

    /// The mesh compressed with Draco, and the same decoded to an uncompressed file.
    fn draco(&self, level: i32, bits: Option<i32>) -> (File, File) {
        let mut mesh = draco_core::Mesh::new();
        mesh.set_num_points(self.positions.len());
        mesh.set_num_faces(self.faces.len());
        for (number, face) in self.faces.iter().enumerate() {
            mesh.set_face(FaceIndex(number as u32), face.map(PointIndex));
        }
        let kinds =
            [GeometryAttributeType::Position, GeometryAttributeType::Normal, GeometryAttributeType::TexCoord];
        let mut options = EncoderOptions::new();
        options.set_compression_level(level);
        for ((_, _, components, bytes), kind) in self.attributes().into_iter().zip(kinds) {
            let mut attribute = PointAttribute::new();
            attribute.init(kind, components as u8, DataType::Float32, false, self.positions.len());
            attribute.buffer_mut().write(0, &bytes);
            let number = mesh.add_attribute(attribute);
            if let Some(bits) = bits {
                options.set_attribute_quantization(number, bits);
            }
        }
        let mut encoder = MeshEncoder::new();
        encoder.set_mesh(mesh);
        let mut out = EncoderBuffer::new();
        encoder.encode(&options, &mut out).unwrap();

        let mut decoded = draco_core::Mesh::new();
        MeshDecoder::new().decode(&mut DecoderBuffer::new(out.data()), &mut decoded).unwrap();
        let values =
            |number: i32, components| decoded.attribute(number).read_f32s(decoded.num_points(), components);
        let decoded_mesh = Mesh {
            positions: values(0, 3).as_chunks().0.to_vec(),
            normals: values(1, 3).as_chunks().0.to_vec(),
            uvs: values(2, 2).as_chunks().0.to_vec(),
            faces: decoded.faces().iter().map(|face| face.map(|point| point.0)).collect(),
        };
        let mut file = decoded_mesh.file(|_, _, _| None);
        let view = file.view(out.data());
        let numbers = json!({"POSITION": 0, "NORMAL": 1, "TEXCOORD_0": 2});
        file.json["meshes"][0]["primitives"][0]["extensions"] =
            json!({"KHR_draco_mesh_compression": {"bufferView": view, "attributes": numbers}});
        (file.requires("KHR_draco_mesh_compression"), decoded_mesh.plain())
    }
}

/// A GLB file that is being built.
struct File {
    json: Value,
    bin: Vec<u8>,
}

impl File {
    fn new() -> Self {
        let json = json!({
            "asset": {"version": "2.0"}, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
            "accessors": [], "bufferViews": [], "buffers": [{"byteLength": 0}],
        });
        Self { json, bin: Vec::new() }
    }

    fn push(&mut self, list: &str, value: Value) -> usize {
        let list = self.json[list].as_array_mut().unwrap();
        list.push(value);
        list.len() - 1
    }

    fn view(&mut self, bytes: &[u8]) -> usize {
        self.bin.resize(self.bin.len().next_multiple_of(4), 0);
        let offset = self.bin.len();
        self.bin.extend(bytes);
        self.json["buffers"][0]["byteLength"] = json!(self.bin.len());
        self.push("bufferViews", json!({"buffer": 0, "byteOffset": offset, "byteLength": bytes.len()}))
    }

    fn accessor(&mut self, view: Option<usize>, kind: u32, shape: &str, count: usize) -> Value {
        let mut accessor = json!({"componentType": kind, "type": shape, "count": count});
        if let Some(view) = view {
            accessor["bufferView"] = json!(view);
        }
        json!(self.push("accessors", accessor))
    }

    fn requires(mut self, extension: &str) -> Self {
        self.json["extensionsUsed"] = json!([extension]);
        self.json["extensionsRequired"] = json!([extension]);
        self
    }

    /// The pack that the program makes from it.
    fn prepared(&self) -> Vec<u8> {
        let chunk = |kind: &[u8; 4], bytes: &[u8], pad: u8| {
            let length = bytes.len().next_multiple_of(4);
            let mut chunk = [&(length as u32).to_le_bytes(), &kind[..], bytes].concat();
            chunk.resize(8 + length, pad);
            chunk
        };
        let body =
            [chunk(b"JSON", self.json.to_string().as_bytes(), b' '), chunk(b"BIN\0", &self.bin, 0)].concat();
        let length = (body.len() as u32 + 12).to_le_bytes();
        let dir = TempDir::new().unwrap();
        let [model, pack] = ["sheet.glb", "sheet.lsp"].map(|name| dir.path().join(name));
        std::fs::write(&model, [b"glTF", &2_u32.to_le_bytes()[..], &length, &body].concat()).unwrap();
        let mut command = Command::new(env!("CARGO_BIN_EXE_lodestream-server"));
        let output = command.arg("prepare").arg(&model).arg("-o").arg(&pack).output().unwrap();
        let said = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success() && !said.contains("ignored"), "{said}");
        std::fs::read(&pack).unwrap()
    }
}

/// Checks that two packs differ only in the key of their inputs and the hash of the head.
fn assert_same(ours: &[u8], plain: &[u8], name: &str) {
    assert!(plain.len() > 5000, "{} bytes", plain.len());
    assert_eq!(ours[..KEY], plain[..KEY], "{name}");
    assert_ne!(ours[KEY..HEAD_BYTES], plain[KEY..HEAD_BYTES], "{name}: the input files must differ");
    assert!(ours[HEAD_BYTES..] == plain[HEAD_BYTES..], "{name}");
}

#[test]
fn meshopt_compressed_models_give_the_same_pack() {
    let plain = sheet().plain().prepared();
    for (extension, version) in [("EXT_meshopt_compression", 0), ("KHR_meshopt_compression", 1)] {
        assert_same(&sheet().meshopt(extension, version).prepared(), &plain, extension);
    }
}

#[test]
fn draco_compressed_models_give_the_pack_of_their_decoded_form() {
    let exact = sheet().draco(0, None).0.prepared();
    assert_same(&exact, &sheet().plain().prepared(), "every bit kept, in order");
    for level in [4, 7, 10] {
        let (compressed, decoded) = sheet().draco(level, Some(12));
        assert_same(&compressed.prepared(), &decoded.prepared(), &format!("level {level}, 12 bits"));
    }
}
