//! glTF files: what they are read to, and the errors of invalid ones. Files are written here, byte by byte.

mod animations;
mod buffers;
mod compressed;
mod copies;
#[cfg(feature = "draco")]
mod draco;
mod found;
mod instancing;
mod lights;
mod material_extensions;
mod materials;
mod parts;
mod poses;
mod skeletons;

use std::path::{Path, PathBuf};

use glam::DVec3;
use lodestream_geometry::mesh::NONE;
use serde_json::{Value, json};
use tempfile::TempDir;

use super::{MeshSize, contents};
use crate::meshopt::tests::Random;
use crate::{CreaseAngle, ImportError, Imported, Part, dependencies, import, import_part};

const BYTE: u32 = 5120;
const UBYTE: u32 = 5121;
const SHORT: u32 = 5122;
const USHORT: u32 = 5123;
const UINT: u32 = 5125;
const FLOAT: u32 = 5126;

/// A file under construction: its JSON, and the bytes of its one buffer.
struct Model {
    json: Value,
    bin: Vec<u8>,
}

impl Model {
    fn new() -> Self {
        let json = json!({
            "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
            "meshes": [{"primitives": [{"attributes": {}}]}],
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

    fn accessor(&mut self, kind: u32, shape: &str, count: usize, bytes: &[u8]) -> usize {
        let view = self.view(bytes);
        let accessor = json!({"bufferView": view, "componentType": kind, "type": shape, "count": count});
        self.push("accessors", accessor)
    }

    fn floats(&mut self, shape: &str, per_element: usize, values: &[f32]) -> usize {
        let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        self.accessor(FLOAT, shape, values.len() / per_element, &bytes)
    }

    fn primitive(&mut self) -> &mut Value {
        &mut self.json["meshes"][0]["primitives"][0]
    }

    fn attribute(&mut self, name: &str, accessor: usize) {
        self.primitive()["attributes"][name] = json!(accessor);
    }

    /// One quad in the plane z = 0, as four vertices and six indices of 16 bits.
    fn quad() -> Self {
        let mut model = Self::new();
        let positions = model.floats("VEC3", 3, &[0., 0., 0., 1., 0., 0., 1., 1., 0., 0., 1., 0.]);
        model.attribute("POSITION", positions);
        let bytes: Vec<u8> = [0u16, 1, 2, 0, 2, 3].iter().flat_map(|i| i.to_le_bytes()).collect();
        let indices = model.accessor(USHORT, "SCALAR", 6, &bytes);
        model.primitive()["indices"] = json!(indices);
        model
    }

    /// Gives the mesh a material of its own.
    fn push_material(&mut self, material: Value) {
        self.json["materials"] = json!([material]);
        self.primitive()["material"] = json!(0);
    }

    fn glb(&self) -> Vec<u8> {
        let mut text = self.json.to_string().into_bytes();
        text.resize(text.len().next_multiple_of(4), b' ');
        let mut bin = self.bin.clone();
        bin.resize(bin.len().next_multiple_of(4), 0);
        let mut out = b"glTF".to_vec();
        out.extend(2u32.to_le_bytes());
        out.extend((28 + text.len() as u32 + bin.len() as u32).to_le_bytes());
        for (kind, bytes) in [(b"JSON", text), (b"BIN\0", bin)] {
            out.extend((bytes.len() as u32).to_le_bytes());
            out.extend(kind);
            out.extend(bytes);
        }
        out
    }

    fn read(&self) -> Result<Imported, ImportError> {
        let dir = TempDir::new().unwrap();
        import(&write(&dir, "a.glb", self.glb()))
    }

    /// Asserts that the file is refused with one line that has every fragment.
    fn refused(&self, fragments: &[&str]) {
        refused(self.glb(), fragments);
    }
}

fn refused(bytes: impl AsRef<[u8]>, fragments: &[&str]) {
    let dir = TempDir::new().unwrap();
    let message = import(&write(&dir, "bad.glb", bytes)).unwrap_err().to_string();
    assert!(message.contains("bad.glb") && !message.contains('\n'), "{message}");
    for fragment in fragments {
        assert!(message.contains(fragment), "{message:?} lacks {fragment:?}");
    }
}

fn write(dir: &TempDir, name: &str, bytes: impl AsRef<[u8]>) -> PathBuf {
    let path = dir.path().join(name);
    std::fs::write(&path, bytes).unwrap();
    path
}

/// The positions of each face's corners.
fn places(imported: &Imported) -> Vec<[[f64; 3]; 3]> {
    let mesh = &imported.mesh;
    mesh.faces.iter().map(|f| f.map(|c| mesh.positions[c.position as usize])).collect()
}

/// Twice the area times normal of a face.
fn normal([a, b, c]: [[f64; 3]; 3]) -> DVec3 {
    let [a, b, c] = [a, b, c].map(DVec3::from_array);
    (b - a).cross(c - a)
}

#[test]
fn a_quad_comes_from_glb_from_files_beside_and_from_data_uris() {
    let model = Model::quad();
    let expected = places(&model.read().unwrap());
    assert_eq!(expected.len(), 2);
    assert_eq!(expected[1], [[0.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]]);
    let dir = TempDir::new().unwrap();
    let mut text = model.json.clone();
    write(&dir, "the quad.bin", &model.bin);
    text["buffers"][0]["uri"] = json!("the%20quad.bin");
    let path = write(&dir, "a.gltf", text.to_string());
    assert_eq!(places(&import(&path).unwrap()), expected);
    assert_eq!(dependencies(&path, text.to_string().as_bytes()), [dir.path().join("the quad.bin")]);
    let encoded = data_encoding::BASE64.encode(&model.bin);
    text["buffers"][0]["uri"] = json!(format!("data:application/octet-stream;base64,{encoded}"));
    let path = write(&dir, "b.gltf", text.to_string());
    assert_eq!(places(&import(&path).unwrap()), expected);
    assert!(dependencies(&path, text.to_string().as_bytes()).is_empty());
}

#[test]
fn strips_and_fans_are_wound_like_lists() {
    for (mode, order) in [(5, [0u8, 1, 3, 2]), (6, [0, 1, 2, 3])] {
        let mut model = Model::quad();
        let indices = model.accessor(UBYTE, "SCALAR", 4, &order);
        model.primitive()["indices"] = json!(indices);
        model.primitive()["mode"] = json!(mode);
        let places = places(&model.read().unwrap());
        assert_eq!(places.len(), 2, "mode {mode}");
        assert!(places.iter().all(|&face| normal(face) == DVec3::Z), "mode {mode}: {places:?}");
    }
    let mut unindexed = Model::new();
    let positions = unindexed.floats("VEC3", 3, &[0., 0., 0., 1., 0., 0., 0., 1., 0., 9., 9., 9.]);
    unindexed.attribute("POSITION", positions);
    let imported = unindexed.read().unwrap();
    assert_eq!(imported.mesh.faces.len(), 1, "the vertex left over makes no triangle");
    assert_eq!(imported.mesh.positions.len(), 4);
}

#[test]
fn attributes_come_in_every_type_that_they_may_have() {
    let mut model = Model::quad();
    let uvs = model.accessor(UBYTE, "VEC2", 4, &[0, 0, 255, 0, 255, 255, 0, 51]);
    model.json["accessors"][uvs]["normalized"] = json!(true);
    model.attribute("TEXCOORD_0", uvs);
    let normals: Vec<u8> = [[0u8, 0, 127, 9], [0, 129, 0, 9], [0, 0, 127, 9], [0, 0, 0, 9]].concat();
    let normals = model.accessor(BYTE, "VEC3", 4, &normals);
    model.json["accessors"][normals]["normalized"] = json!(true);
    let view = model.json["accessors"][normals]["bufferView"].as_u64().unwrap() as usize;
    model.json["bufferViews"][view]["byteStride"] = json!(4);
    model.attribute("NORMAL", normals);
    let half = 0x8000u16.to_le_bytes();
    let colors: Vec<u8> = [0xffff, 0, 0, 0x8000].iter().flat_map(|v: &u16| v.to_le_bytes()).collect();
    let colors = [colors.as_slice(), &[half[0], half[1]].repeat(12)].concat();
    let colors = model.accessor(USHORT, "VEC4", 4, &colors);
    model.json["accessors"][colors]["normalized"] = json!(true);
    model.attribute("COLOR_0", colors);
    let mesh = model.read().unwrap().mesh;
    let corner = |vertex: usize| {
        let find = mesh.faces.iter().flatten().find(|c| c.position as usize == vertex);
        *find.unwrap()
    };
    // Texture coordinates run down in glTF, up here.
    assert_eq!(mesh.uvs[corner(3).uv as usize], [0.0, 0.8]);
    assert_eq!(mesh.uvs[corner(1).uv as usize], [1.0, 1.0]);
    assert_eq!(mesh.normals[corner(1).normal as usize], [0.0, -1.0, 0.0]);
    assert_eq!(corner(3).normal, NONE, "a normal without a direction is none");
    assert_eq!(mesh.colors[corner(0).color as usize], [255, 0, 0, 128]);
    // Half of the light is 188 in sRGB.
    assert_eq!(mesh.colors[corner(1).color as usize], [188, 188, 188, 128]);
}

#[test]
fn quantised_positions_are_scaled_by_their_node() {
    let mut model = Model::quad();
    let values: Vec<u8> = [0i16, 0, 0, 0, 32767, 0, 0, 0, 32767, 32767, 0, 0, 0, -32768, 0, 0]
        .iter()
        .flat_map(|v| v.to_le_bytes())
        .collect();
    let positions = model.accessor(SHORT, "VEC3", 4, &values);
    let view = model.json["accessors"][positions]["bufferView"].as_u64().unwrap() as usize;
    model.json["bufferViews"][view]["byteStride"] = json!(8);
    model.json["accessors"][positions]["normalized"] = json!(true);
    model.attribute("POSITION", positions);
    model.json["extensionsUsed"] = json!(["KHR_mesh_quantization"]);
    model.json["extensionsRequired"] = json!(["KHR_mesh_quantization"]);
    model.json["nodes"][0] = json!({"mesh": 0, "scale": [4, 4, 4], "translation": [10, 0, 0]});
    let imported = model.read().unwrap();
    assert!(imported.warnings.is_empty(), "{:?}", imported.warnings);
    assert_eq!(imported.mesh.positions[2], [14.0, 4.0, 0.0]);
    assert_eq!(imported.mesh.positions[3], [10.0, -4.0, 0.0]);
}

#[test]
fn sparse_elements_replace_those_that_are_there_and_zeros() {
    let mut model = Model::quad();
    let indices = model.view(&[1, 3]);
    let values: Vec<u8> = [5f32, 0., 0., 0., 7., 0.].iter().flat_map(|v| v.to_le_bytes()).collect();
    let values = model.view(&values);
    let sparse = json!({
        "count": 2,
        "indices": {"bufferView": indices, "componentType": UBYTE},
        "values": {"bufferView": values},
    });
    model.json["accessors"][0]["sparse"] = sparse.clone();
    let mesh = model.read().unwrap().mesh;
    assert_eq!(mesh.positions, [[0., 0., 0.], [5., 0., 0.], [1., 1., 0.], [0., 7., 0.]]);
    let zeros = json!({"componentType": FLOAT, "type": "VEC3", "count": 4, "sparse": sparse});
    model.json["accessors"][0] = zeros;
    let mesh = model.read().unwrap().mesh;
    assert_eq!(mesh.positions[2..], [[0.; 3], [0., 7., 0.]]);
    model.json["accessors"][0]["sparse"]["count"] = json!(5);
    model.refused(&["accessors[0]", "more sparse elements"]);
    let mut falling = Model::quad();
    let indices = falling.view(&[3, 1]);
    falling.json["accessors"][0]["sparse"] = json!({
        "count": 2, "indices": {"bufferView": indices, "componentType": UBYTE}, "values": {"bufferView": 0},
    });
    falling.refused(&["do not increase"]);
}

#[test]
fn nodes_place_their_meshes_and_mirrors_stay_the_right_way_round() {
    let mut model = Model::quad();
    let normals = model.floats("VEC3", 3, &[0., 0., 1., 0., 0., 1., 0., 0., 1., 0., 0., 1.]);
    model.attribute("NORMAL", normals);
    model.json["nodes"] = json!([
        {"children": [1, 2], "translation": [100, 0, 0]},
        {"mesh": 0, "scale": [-2, 2, 2]},
        {"mesh": 0, "rotation": [0, 0.6, 0, 0.8], "scale": [3, 3, 3]},
    ]);
    let imported = model.read().unwrap();
    let faces = places(&imported);
    assert_eq!(faces.len(), 4);
    assert_eq!(faces[0].map(|p| p[0]), [100.0, 98.0, 98.0], "the mirrored quad, the other way round");
    for (face, corners) in faces.iter().zip(&imported.mesh.faces) {
        let outwards = normal(*face).normalize();
        let stated = imported.mesh.normals[corners[0].normal as usize].map(f64::from);
        assert!(outwards.dot(DVec3::from_array(stated)) > 0.999, "{outwards} {stated:?}");
    }
    // As a scene: the turned instance uses the mesh as it is, the mirrored one a mesh of its own.
    let dir = TempDir::new().unwrap();
    let path = write(&dir, "a.glb", model.glb());
    let contents = contents(&path, None).unwrap();
    assert_eq!(contents.names, ["mesh-0"]);
    let [mirrored, turned] = &contents.placed[..] else { panic!("{:?}", contents.placed) };
    assert!((turned.placement.scale - 3.0).abs() < 1e-6 && (mirrored.placement.scale - 2.0).abs() < 1e-6);
    for (placed, expected) in [(mirrored, &faces[..2]), (turned, &faces[2..])] {
        let part = import_part(&path, &placed.part, CreaseAngle::default()).unwrap();
        for (face, expected) in places(&part).into_iter().zip(expected) {
            for (p, q) in face.into_iter().zip(expected) {
                let p = placed.placement.to_world(DVec3::from_array(p));
                assert!(p.distance(DVec3::from_array(*q)) < 1e-5, "{p} {q:?}");
            }
        }
    }
    let named = super::part_named(&path, "mesh-0").unwrap();
    assert_eq!(turned.part, named);
    assert!(matches!(named, Part::Mesh { mesh: 0, .. }));
    let message = super::part_named(&path, "hull").unwrap_err().to_string();
    assert!(message.contains("no mesh named \"hull\"") && message.contains("mesh-0"), "{message}");
}

#[test]
fn materials_bring_colour_texture_and_its_transformation() {
    let mut model = Model::quad();
    let uvs = model.floats("VEC2", 2, &[0., 0., 1., 0., 1., 1., 0., 1.]);
    model.attribute("TEXCOORD_1", uvs);
    let mut png = std::io::Cursor::new(Vec::new());
    image::RgbImage::from_pixel(8, 8, image::Rgb([200, 10, 10]))
        .write_to(&mut png, image::ImageFormat::Png)
        .unwrap();
    let view = model.view(png.get_ref());
    model.json["images"] = json!([{"bufferView": view, "mimeType": "image/png"}, {"uri": "../secret.png"}]);
    model.json["textures"] = json!([{"source": 0}, {"source": 1}]);
    model.json["extensionsUsed"] = json!(["KHR_texture_transform"]);
    let texture = json!({
        "index": 0, "texCoord": 1, "extensions": {"KHR_texture_transform": {"offset": [0.25, 0.5], "scale": [2, 1]}},
    });
    model.json["materials"] = json!([{
        "name": "brick",
        "pbrMetallicRoughness":
            {"baseColorFactor": [0.5, 1, 0.25, 0.5], "roughnessFactor": 0.5, "baseColorTexture": texture},
    }]);
    model.primitive()["material"] = json!(0);
    let imported = model.read().unwrap();
    let crate::ImportedMaterial { material, maps, .. } = &imported.materials[0];
    assert_eq!((material.name.as_str(), material.roughness), ("brick", 0.5));
    assert_eq!(material.base_color, [0.5, 1.0, 0.25, 1.0], "an opaque material's alpha says nothing");
    let image = maps.color.clone().unwrap();
    assert_eq!(image.bytes.as_deref(), Some(png.get_ref().as_slice()));
    assert!(image.path.ends_with("a.glb#images[0]"), "{}", image.path.display());
    assert_eq!(imported.mesh.uvs[2], [2.25, -0.5]);
    assert!(imported.warnings.is_empty(), "{:?}", imported.warnings);
    model.json["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"]["index"] = json!(1);
    let outside = model.read().unwrap();
    assert_eq!(outside.materials[0].maps.color, None);
    assert!(outside.warnings[0].contains("is not a file beside the model"), "{:?}", outside.warnings);
}

#[test]
fn a_webp_texture_takes_the_place_of_its_fallback() {
    let mut model = Model::quad();
    let uvs = model.floats("VEC2", 2, &[0., 0., 1., 0., 1., 1., 0., 1.]);
    model.attribute("TEXCOORD_0", uvs);
    let mut file = std::io::Cursor::new(Vec::new());
    let image = image::RgbImage::from_fn(64, 64, |x, y| image::Rgb([x as u8 * 4, y as u8 * 4, 90]));
    image.write_to(&mut file, image::ImageFormat::WebP).unwrap();
    let view = model.view(file.get_ref());
    model.json["images"] = json!([{"uri": "fallback.png"}, {"bufferView": view, "mimeType": "image/webp"}]);
    model.json["textures"] = json!([{"source": 0, "extensions": {"EXT_texture_webp": {"source": 1}}}]);
    model.json["materials"] = json!([{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}]);
    model.json["extensionsUsed"] = json!(["EXT_texture_webp"]);
    model.json["extensionsRequired"] = json!(["EXT_texture_webp"]);
    model.primitive()["material"] = json!(0);
    let color = |model: &Model| {
        let imported = model.read().unwrap();
        assert!(imported.warnings.is_empty(), "{:?}", imported.warnings);
        imported.materials[0].maps.color.clone().unwrap()
    };
    let with_fallback = color(&model);
    assert_eq!(with_fallback.bytes.as_deref(), Some(file.get_ref().as_slice()));
    model.json["textures"][0].as_object_mut().unwrap().remove("source");
    assert_eq!(color(&model).bytes, with_fallback.bytes);
    let source = crate::texture::TextureSource::opaque(with_fallback);
    let texture =
        crate::texture::load(&source, Default::default(), &lodestream_geometry::pool::Serial).unwrap();
    assert_eq!((texture.width_px, texture.levels.len()), (64, 4));
    model.json["textures"] = json!([{"extensions": {"EXT_texture_webp": {"source": 9}}}]);
    let missing = model.read().unwrap();
    assert!(missing.warnings[0].contains("no PNG, JPEG, WebP, AVIF or KTX2 image"), "{:?}", missing.warnings);
}

#[test]
fn a_basis_universal_texture_takes_the_place_of_its_fallback() {
    let mut model = Model::quad();
    let uvs = model.floats("VEC2", 2, &[0., 0., 1., 0., 1., 1., 0., 1.]);
    model.attribute("TEXCOORD_0", uvs);
    let file = include_bytes!("../texture/tests/etc1s.ktx2");
    let view = model.view(file);
    model.json["images"] = json!([{"uri": "fallback.png"}, {"bufferView": view, "mimeType": "image/ktx2"}]);
    model.json["textures"] = json!([{"source": 0, "extensions": {"KHR_texture_basisu": {"source": 1}}}]);
    model.json["materials"] = json!([{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}]);
    model.json["extensionsRequired"] = json!(["KHR_texture_basisu"]);
    model.primitive()["material"] = json!(0);
    let imported = model.read().unwrap();
    assert!(imported.warnings.is_empty(), "{:?}", imported.warnings);
    let source = crate::texture::TextureSource::opaque(imported.materials[0].maps.color.clone().unwrap());
    let texture =
        crate::texture::load(&source, Default::default(), &lodestream_geometry::pool::Serial).unwrap();
    assert_eq!((texture.width_px, texture.height_px), (14, 10));
    // Files beside the model, too, whatever extension names them.
    model.json["images"][1] = json!({"uri": "beside.ktx2"});
    let beside = model.read().unwrap().materials[0].maps.color.clone().unwrap();
    assert!(beside.path.ends_with("beside.ktx2") && beside.bytes.is_none(), "{beside:?}");
}

#[test]
fn an_avif_texture_takes_the_place_of_its_fallback() {
    let mut model = Model::quad();
    let uvs = model.floats("VEC2", 2, &[0., 0., 1., 0., 1., 1., 0., 1.]);
    model.attribute("TEXCOORD_0", uvs);
    let view = model.view(include_bytes!("../texture/avif/ramp.avif"));
    model.json["images"] = json!([{"uri": "fallback.png"}, {"bufferView": view, "mimeType": "image/avif"}]);
    model.json["textures"] = json!([{"source": 0, "extensions": {"EXT_texture_avif": {"source": 1}}}]);
    model.json["materials"] = json!([{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}]);
    model.json["extensionsUsed"] = json!(["EXT_texture_avif"]);
    model.json["extensionsRequired"] = json!(["EXT_texture_avif"]);
    model.primitive()["material"] = json!(0);
    let imported = model.read().unwrap();
    assert!(imported.warnings.is_empty(), "{:?}", imported.warnings);
    let source = crate::texture::TextureSource::opaque(imported.materials[0].maps.color.clone().unwrap());
    let texture =
        crate::texture::load(&source, Default::default(), &lodestream_geometry::pool::Serial).unwrap();
    assert_eq!((texture.width_px, texture.height_px), (37, 22));
}

#[test]
fn what_is_not_drawn_is_named() {
    let mut model = Model::quad();
    let tangents = model.floats("VEC4", 4, &[0.; 16]);
    model.attribute("TANGENT", tangents);
    model.primitive()["targets"] = json!([{"POSITION": 0}]);
    model.primitive()["material"] = json!(0);
    model.json["materials"] = json!([{"extensions": {"KHR_materials_sheen": {}}}]);
    model.json["cameras"] =
        json!([{"type": "orthographic", "orthographic": {"xmag": 1, "ymag": 1, "zfar": 1, "znear": 0}}]);
    model.json["extensionsUsed"] =
        json!(["KHR_lights_punctual", "KHR_materials_sheen", "EXT_lights_image_based"]);
    model.json["extensions"] = json!({"KHR_lights_punctual": {"lights": [{"type": "directional"}]}});
    let imported = model.read().unwrap();
    let [warning] = &imported.warnings[..] else { panic!("{:?}", imported.warnings) };
    for what in [
        "attribute TANGENT",
        "morph targets",
        "cameras",
        "extension KHR_materials_sheen",
        "extension EXT_lights_image_based",
        "directional lights (set [light] in the scene file instead)",
    ] {
        assert!(warning.contains(what), "{warning:?} lacks {what:?}");
    }
    assert!(!warning.contains("KHR_lights_punctual"), "{warning:?}");
}

#[test]
fn required_extensions_that_are_not_supported_are_named() {
    let mut model = Model::quad();
    model.json["extensionsRequired"] = json!(["KHR_texture_video", "KHR_texture_transform"]);
    model.refused(&["requires", "KHR_texture_video", "export it without"]);
}

#[test]
fn bad_files_are_refused_with_their_place() {
    let with = |change: &dyn Fn(&mut Model)| {
        let mut model = Model::quad();
        change(&mut model);
        model
    };
    let json = |path: &'static str, value: Value| {
        with(&move |m: &mut Model| *m.json.pointer_mut(path).unwrap() = value.clone())
    };
    json("/asset/version", json!("1.0")).refused(&["1.0", "only glTF 2.0"]);
    json("/accessors/0/count", json!(5)).refused(&["POSITION", "accessors[0]", "reaches beyond"]);
    json("/accessors/0/count", json!(u64::MAX)).refused(&["too many"]);
    json("/accessors/0/type", json!("VEC2")).refused(&["POSITION", "Vec2"]);
    json("/accessors/1/componentType", json!(FLOAT)).refused(&["indices", "reaches beyond"]);
    json("/accessors/1/bufferView", json!(9)).refused(&["bufferViews[9] does not exist"]);
    json("/meshes/0/primitives/0/indices", json!(7)).refused(&["indices", "accessors[7] does not exist"]);
    json("/meshes/0/primitives/0/attributes/POSITION", json!(7)).refused(&["accessors[7] does not exist"]);
    json("/bufferViews/0/byteLength", json!(1u64 << 40)).refused(&["bufferViews[0] reaches beyond"]);
    json("/bufferViews/0/buffer", json!(3)).refused(&["buffers[3] does not exist"]);
    json("/buffers/0/byteLength", json!(1u64 << 40)).refused(&["buffers[0]", "truncated"]);
    json("/nodes/0", json!({"children": [0]})).refused(&["nodes[0]", "its own ancestor"]);
    json("/nodes/0", json!({"children": [4]})).refused(&["nodes[4] does not exist"]);
    json("/nodes/0/mesh", json!(2)).refused(&["meshes[2] does not exist"]);
    json("/scene", json!(2)).refused(&["scenes[2] does not exist"]);
    json("/meshes/0/primitives/0", json!({"attributes": {"POSITION": 0}, "mode": 0})).refused(&["no faces"]);
    json("/buffers/0", json!({"byteLength": 96, "uri": "/etc/hosts"}))
        .refused(&["buffers[0]", "beside the model"]);
    json("/buffers/0", json!({"byteLength": 96, "uri": "a/../../b"})).refused(&["beside the model"]);
    json("/buffers/0", json!({"byteLength": 96, "uri": "http://x/y"})).refused(&["beside the model"]);
    json("/buffers/0", json!({"byteLength": 96, "uri": "data:;base64,?"})).refused(&["does not decode"]);
    with(&|m| {
        let bytes: Vec<u8> = [0u16, 1, 4].iter().flat_map(|i| i.to_le_bytes()).collect();
        let indices = m.accessor(USHORT, "SCALAR", 3, &bytes);
        m.primitive()["indices"] = json!(indices);
    })
    .refused(&["index 4 is beyond the 4 vertices"]);
    with(&|m| {
        m.json["accessors"][0].as_object_mut().unwrap().remove("bufferView");
        m.json["accessors"][0]["count"] = json!(1u32 << 31);
    })
    .refused(&["no bufferView"]);
    with(&|m| {
        let positions = m.floats("VEC3", 3, &[0., 0., 0., 1., f32::NAN, 0., 0., 1., 0., 1., 1., 0.]);
        m.attribute("POSITION", positions);
    })
    .refused(&["primitives[0].attributes.POSITION", "element 1 is not finite"]);
    with(&|m| {
        let indices = m.accessor(UINT, "SCALAR", 3, &[0xff; 12]);
        m.primitive()["indices"] = json!(indices);
    })
    .refused(&["index 4294967295"]);
}

#[test]
fn every_truncation_is_an_error_and_no_flipped_byte_a_panic() {
    let dir = TempDir::new().unwrap();
    let good = Model::quad().glb();
    for length in 0..good.len() {
        let path = write(&dir, "cut.glb", &good[..length]);
        assert!(import(&path).is_err(), "length {length}");
    }
    let path = dir.path().join("flipped.glb");
    for i in 0..good.len() {
        for value in [0, 0xff, good[i] ^ 1, b'9'] {
            let mut bad = good.clone();
            bad[i] = value;
            std::fs::write(&path, bad).unwrap();
            let _ = import(&path);
            let _ = contents(&path, None);
        }
    }
    assert!(import(Path::new("/no/such.glb")).is_err());
}

#[test]
fn sizes_are_those_that_the_file_states_and_none_for_meshes_that_blend() {
    let sizes = |change: &dyn Fn(&mut Model)| {
        let mut model = Model::quad();
        model.json["accessors"][0]["min"] = json!([0.0, 0.0, 0.0]);
        model.json["accessors"][0]["max"] = json!([1.0, 1.0, 0.0]);
        change(&mut model);
        let dir = TempDir::new().unwrap();
        contents(&write(&dir, "a.glb", model.glb()), None).unwrap().sizes
    };
    let size = MeshSize { faces: 2, low: [0.0; 3], high: [1.0, 1.0, 0.0], uvs: None };
    assert_eq!(sizes(&|_| {}), [Some(size)]);
    let material = |material: Value| {
        sizes(&|model| {
            model.push_material(material.clone());
        })
    };
    assert_eq!(material(json!({"pbrMetallicRoughness": {"baseColorFactor": [1, 0, 0, 1]}})), [Some(size)]);
    assert_eq!(material(json!({"alphaMode": "BLEND"})), [None]);
    // Textures without coordinates.
    assert_eq!(material(json!({"normalTexture": {"index": 0}})), [None]);
    // Without bounds, with bounds that are none, and for strips, nothing is known.
    assert_eq!(sizes(&|model| model.json["accessors"][0]["max"] = Value::Null), [None]);
    assert_eq!(sizes(&|model| model.json["accessors"][0]["max"] = json!([1.0, "a", 0.0])), [None]);
    assert_eq!(sizes(&|model| model.primitive()["mode"] = json!(5)), [None]);
}

#[test]
fn sizes_have_the_range_of_texture_coordinates_if_a_shared_grid_can_hold_them() {
    let uvs = |uvs: &[f32], material: Value| {
        let mut model = Model::quad();
        model.json["accessors"][0]["min"] = json!([0.0, 0.0, 0.0]);
        model.json["accessors"][0]["max"] = json!([1.0, 1.0, 0.0]);
        model.push_material(material);
        let uvs = model.floats("VEC2", 2, uvs);
        model.attribute("TEXCOORD_0", uvs);
        let dir = TempDir::new().unwrap();
        let [size] = contents(&write(&dir, "a.glb", model.glb()), None).unwrap().sizes[..] else {
            panic!("one mesh")
        };
        size.map(|size| size.uvs)
    };
    let textured = json!({"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}});
    let square = [0.0, 0.0, 2.0, 0.0, 2.0, 3.0, 0.0, 3.0];
    assert_eq!(uvs(&square, textured.clone()), Some(Some([[0.0, -2.0], [2.0, 1.0]])), "v is up");
    // Without a texture, coordinates do not matter.
    assert_eq!(uvs(&square.map(|x| 100.0 * x), json!({})), Some(None));
    for far in [8.5, -8.5, f32::NAN] {
        let mut square = square;
        square[2] = far;
        assert_eq!(uvs(&square, textured.clone()), None, "{far}");
    }
    let transform = json!({"index": 0, "extensions": {"KHR_texture_transform": {"scale": [2, 2]}}});
    for other in [
        json!({"pbrMetallicRoughness": {"baseColorTexture": transform}}),
        json!({"pbrMetallicRoughness": {"baseColorTexture": {"index": 0, "texCoord": 1}}}),
        json!({"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}, "emissiveTexture": {"index": 0, "texCoord": 1}}),
        json!({"normalTexture": {"index": 0}, "alphaMode": "BLEND"}),
        json!({"normalTexture": {"index": 0}, "extensions": {"KHR_materials_transmission": {"transmissionFactor": 1}}}),
    ] {
        assert_eq!(uvs(&square, other.clone()), None, "{other}");
    }
}
