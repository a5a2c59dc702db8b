//! Buffer views compressed by meshoptimizer's codecs, against the uncompressed file.

use serde_json::{Value, json};

use super::{BYTE, FLOAT, Model, Random, UBYTE, UINT, USHORT};

/// An uneven grid with all vertex attributes that are read: floats, and normalised integers of one and two bytes.
struct Sheet {
    positions: Vec<[f32; 3]>,
    normals: Vec<[i8; 4]>,
    uvs: Vec<[u16; 2]>,
    colors: Vec<[u8; 4]>,
    indices: Vec<u32>,
}

const N: u32 = 9;

fn sheet() -> Sheet {
    let each = || (0..(N + 1) * (N + 1)).map(|at| (at % (N + 1), at / (N + 1)));
    let cell = |at: u32| {
        let (a, row) = (at / N * (N + 1) + at % N, N + 1);
        [a, a + 1, a + row, a + row, a + 1, a + row + 1]
    };
    Sheet {
        positions: each().map(|(x, y)| [x as f32 * 0.7, y as f32, (x * y) as f32 * 0.013]).collect(),
        normals: each().map(|(x, y)| [x as i8, -(y as i8), 120, 0]).collect(),
        uvs: each().map(|(x, y)| [(x * 7281) as u16, (y * 7281) as u16]).collect(),
        colors: each().map(|(x, y)| [(x * 28) as u8, (y * 28) as u8, 77, 255 - x as u8]).collect(),
        indices: (0..N * N).flat_map(cell).collect(),
    }
}

/// Adds a view with the given elements to a model and returns its number.
type Views<'a> = &'a mut dyn FnMut(&mut Model, Elements<'_>) -> usize;

/// The elements of a view.
enum Elements<'a> {
    Positions(&'a [[f32; 3]]),
    Normals(&'a [[i8; 4]]),
    Uvs(&'a [[u16; 2]]),
    Colors(&'a [[u8; 4]]),
    Indices(&'a [u32]),
}

impl Elements<'_> {
    fn bytes(&self) -> Vec<u8> {
        match self {
            Self::Positions(all) => all.as_flattened().iter().flat_map(|v| v.to_le_bytes()).collect(),
            Self::Normals(all) => all.as_flattened().iter().map(|&v| v as u8).collect(),
            Self::Uvs(all) => all.as_flattened().iter().flat_map(|v| v.to_le_bytes()).collect(),
            Self::Colors(all) => all.as_flattened().to_vec(),
            Self::Indices(all) => all.iter().flat_map(|v| v.to_le_bytes()).collect(),
        }
    }

    /// Bytes of one element.
    fn stride(&self) -> usize {
        if matches!(self, Self::Positions(_)) { 12 } else { 4 }
    }

    fn encoded(&self, version: i32, triangles: bool) -> Vec<u8> {
        let version = Some(version);
        match self {
            Self::Positions(all) => meshopt::encode_vertex_buffer_level(all, 2, version).unwrap(),
            Self::Normals(all) => meshopt::encode_vertex_buffer_level(all, 2, version).unwrap(),
            Self::Uvs(all) => meshopt::encode_vertex_buffer_level(all, 2, version).unwrap(),
            Self::Colors(all) => meshopt::encode_vertex_buffer_level(all, 2, version).unwrap(),
            Self::Indices(all) if triangles => meshopt::encode_index_buffer(all, 1 << 16).unwrap(),
            Self::Indices(all) => meshopt::encode_index_sequence(all, 1 << 16).unwrap(),
        }
    }
}

impl Sheet {
    fn model(&self, views: Views<'_>) -> Model {
        let mut model = Model::new();
        let count = self.positions.len();
        for (name, kind, shape, elements) in [
            ("POSITION", FLOAT, "VEC3", Elements::Positions(&self.positions)),
            ("NORMAL", BYTE, "VEC3", Elements::Normals(&self.normals)),
            ("TEXCOORD_0", USHORT, "VEC2", Elements::Uvs(&self.uvs)),
            ("COLOR_0", UBYTE, "VEC4", Elements::Colors(&self.colors)),
        ] {
            let stride = elements.stride();
            let view = views(&mut model, elements);
            model.json["bufferViews"][view]["byteStride"] = json!(stride);
            let accessor = json!({
                "bufferView": view, "componentType": kind, "type": shape, "count": count, "normalized": kind != FLOAT,
            });
            let accessor = model.push("accessors", accessor);
            model.attribute(name, accessor);
        }
        let view = views(&mut model, Elements::Indices(&self.indices));
        let indices = json!({
            "bufferView": view, "componentType": UINT, "type": "SCALAR", "count": self.indices.len(),
        });
        let indices = model.push("accessors", indices);
        model.primitive()["indices"] = json!(indices);
        model
    }

    fn plain(&self) -> Model {
        self.model(&mut |model, elements| model.view(&elements.bytes()))
    }

    fn compressed(&self, extension: &str, version: i32, triangles: bool) -> Model {
        let mut model = self.model(&mut |model, elements| {
            let mode = match elements {
                Elements::Indices(_) if triangles => "TRIANGLES",
                Elements::Indices(_) => "INDICES",
                _ => "ATTRIBUTES",
            };
            let (stride, length) = (elements.stride(), elements.bytes().len());
            compressed_view(
                model,
                extension,
                &elements.encoded(version, triangles),
                mode,
                length / stride,
                stride,
            )
        });
        fallback(&mut model, extension);
        model.json["extensionsUsed"] = json!([extension]);
        model.json["extensionsRequired"] = json!([extension]);
        model
    }
}

/// A view of the fallback buffer, which has no file, with its compressed bytes in the first buffer.
fn compressed_view(
    model: &mut Model,
    extension: &str,
    data: &[u8],
    mode: &str,
    count: usize,
    stride: usize,
) -> usize {
    let view = model.view(data);
    let mut said = model.json["bufferViews"][view].take();
    said["count"] = json!(count);
    said["byteStride"] = json!(stride);
    said["mode"] = json!(mode);
    let mut compressed = json!({"buffer": 1, "byteLength": count * stride});
    compressed["extensions"][extension] = said;
    model.json["bufferViews"][view] = compressed;
    view
}

/// The second buffer.
fn fallback(model: &mut Model, extension: &str) {
    let mut buffer = json!({"byteLength": 1 << 20});
    buffer["extensions"][extension] = json!({"fallback": true});
    model.push("buffers", buffer);
}

#[test]
fn a_compressed_file_is_the_mesh_that_the_uncompressed_one_is() {
    let sheet = sheet();
    let plain = sheet.plain().read().unwrap();
    for (extension, version) in
        [("EXT_meshopt_compression", 0), ("KHR_meshopt_compression", 0), ("KHR_meshopt_compression", 1)]
    {
        let model = sheet.compressed(extension, version, false);
        let imported = model.read().unwrap();
        assert!(imported.warnings.is_empty(), "{:?}", imported.warnings);
        assert_eq!(imported.mesh, plain.mesh, "{extension}, version {version}");
        // The encoder of triangles rotates them; the library tells how.
        let mut turned = self::sheet();
        let data = meshopt::encode_index_buffer(&turned.indices, 1 << 16).unwrap();
        turned.indices = meshopt::decode_index_buffer(&data, turned.indices.len()).unwrap();
        let imported = sheet.compressed(extension, version, true).read().unwrap();
        assert_eq!(imported.mesh, turned.plain().read().unwrap().mesh, "{extension}, version {version}");
    }
}

#[test]
fn extensions_that_are_used_but_not_required_are_read_with_a_fallback_or_without() {
    let sheet = sheet();
    let plain = sheet.plain().read().unwrap();
    let mut model = sheet.compressed("EXT_meshopt_compression", 0, false);
    model.json.as_object_mut().unwrap().remove("extensionsRequired");
    let imported = model.read().unwrap();
    assert!(imported.warnings.is_empty(), "{:?}", imported.warnings);
    assert_eq!(imported.mesh, plain.mesh);
    // The fallback's file may be missing.
    model.json["buffers"][1]["uri"] = json!("fallback.bin");
    assert_eq!(model.read().unwrap().mesh, plain.mesh);
}

#[test]
fn filtered_normals_are_those_that_were_filtered() {
    let mut sheet = sheet();
    let normals: Vec<[f32; 4]> = sheet
        .normals
        .iter()
        .map(|n| {
            let n = n.map(f32::from);
            let length = n.iter().map(|x| x * x).sum::<f32>().sqrt();
            n.map(|x| x / length)
        })
        .collect();
    sheet.normals = meshopt::encode_filter_oct::<i8>(&normals, 8);
    let mut model = sheet.compressed("EXT_meshopt_compression", 0, false);
    model.json["bufferViews"][1]["extensions"]["EXT_meshopt_compression"]["filter"] = json!("OCTAHEDRAL");
    let mesh = model.read().unwrap().mesh;
    for corner in mesh.faces.iter().flatten() {
        let (given, source) = (mesh.normals[corner.normal as usize], normals[corner.position as usize]);
        let dot: f32 = given.iter().zip(source).map(|(a, b)| a * b).sum();
        // Octahedral coordinates of eight bits: within 0.9°.
        assert!(dot > 0.9998, "{given:?} {source:?}");
    }
}

#[test]
fn views_that_do_not_decode_are_refused_with_their_place() {
    let sheet = sheet();
    let with = |at: usize, name: &str, value: Value| {
        let mut model = sheet.compressed("EXT_meshopt_compression", 0, false);
        model.json["bufferViews"][at]["extensions"]["EXT_meshopt_compression"][name] = value;
        model
    };
    with(0, "mode", json!("POINTS")).refused(&["bufferViews[0]", "\"POINTS\"", "not known"]);
    with(0, "filter", json!("WAVELET")).refused(&["bufferViews[0]", "\"WAVELET\"", "not known"]);
    with(4, "filter", json!("OCTAHEDRAL")).refused(&["bufferViews[4]", "indices with a filter"]);
    with(0, "filter", json!("OCTAHEDRAL"))
        .refused(&["bufferViews[0]", "elements of 12 bytes are not supported"]);
    with(0, "count", json!("x")).refused(&["bufferViews[0]", "not understood"]);
    with(0, "count", json!(40)).refused(&["bufferViews[0]", "does not decode", "export the file again"]);
    with(0, "count", json!(1u64 << 50)).refused(&["bufferViews[0]", "too many bytes"]);
    with(0, "count", json!(1 << 24)).refused(&["bufferViews[0]", "end before the elements do"]);
    with(0, "byteStride", json!(6)).refused(&["bufferViews[0]", "elements of 6 bytes are not supported"]);
    with(0, "buffer", json!(7)).refused(&["buffers[7] does not exist"]);
    with(0, "byteLength", json!(1 << 30)).refused(&["bufferViews[0] reaches beyond"]);
    with(1, "mode", json!("TRIANGLES")).refused(&["bufferViews[1]"]);
    // If overlapping views were decoded, a small file could take any amount of memory.
    let mut model = sheet.compressed("EXT_meshopt_compression", 0, false);
    let mut whole = model.json["bufferViews"][0].clone();
    whole["extensions"]["EXT_meshopt_compression"]["byteOffset"] = json!(0);
    whole["extensions"]["EXT_meshopt_compression"]["byteLength"] =
        model.json["buffers"][0]["byteLength"].clone();
    for at in 0..4 {
        model.json["bufferViews"][at] = whole.clone();
        whole["extensions"]["EXT_meshopt_compression"]["count"] = json!(0);
    }
    assert!(model.read().is_err());
    let mut model = sheet.compressed("EXT_meshopt_compression", 0, false);
    let view = model.json["bufferViews"][4].clone();
    for _ in 0..30 {
        let view = model.push("bufferViews", view.clone());
        let indices = json!({"bufferView": view, "componentType": UINT, "type": "SCALAR", "count": 3});
        let indices = model.push("accessors", indices);
        let mut primitive = model.primitive().clone();
        primitive["indices"] = json!(indices);
        model.json["meshes"][0]["primitives"].as_array_mut().unwrap().push(primitive);
    }
    model.refused(&["compressed views of buffers[0] overlap"]);
}

#[test]
fn no_damaged_view_is_a_panic() {
    let sheet = sheet();
    let mut random = Random(29);
    let (mut accepted, mut refused) = (0, 0);
    for version in [0, 1] {
        let good = sheet.compressed("KHR_meshopt_compression", version, true);
        for _ in 0..1500 {
            let mut model = Model { json: good.json.clone(), bin: good.bin.clone() };
            for _ in 0..=random.below(3) {
                let at = random.below(model.bin.len());
                model.bin[at] = random.next() as u8;
            }
            match model.read() {
                Ok(_) => accepted += 1,
                Err(_) => refused += 1,
            }
        }
    }
    assert!(accepted > 100 && refused > 100, "{accepted} {refused}");
}
