//! glTF files of many small meshes: what becomes a batch, what an asset with instances, and what is prepared again when the
//! file changes.

use std::collections::BTreeSet;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};

use glam::{DMat4, DQuat, DVec3};
use lodestream_import::Part;
use serde_json::{Value, json};
use tempfile::TempDir;

use super::{Scene, of_files_with, parse};
use crate::preparation_settings::{Batching, PreparationSettings};
use crate::prepare::{Options, keys_of, prepare_all};
use crate::sources::Sources;

/// A GLB under construction.
#[derive(Default)]
pub(crate) struct Glb {
    bin: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
    meshes: Vec<Value>,
    nodes: Vec<Value>,
    images: Vec<Value>,
}

impl Glb {
    /// Adds a mesh without indices.
    pub(crate) fn mesh(&mut self, corners: &[DVec3]) -> usize {
        let (low, high) = corners
            .iter()
            .fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), &p| (low.min(p), high.max(p)));
        let start = self.bin.len();
        let numbers = corners.iter().flat_map(|p| p.as_vec3().to_array());
        self.bin.extend(numbers.flat_map(f32::to_le_bytes));
        self.views.push(json!({"buffer": 0, "byteOffset": start, "byteLength": self.bin.len() - start}));
        self.accessors.push(json!({
            "bufferView": self.views.len() - 1, "componentType": 5126, "type": "VEC3", "count": corners.len(),
            "min": low.to_array(), "max": high.to_array(),
        }));
        self.meshes.push(json!({"primitives": [{"attributes": {"POSITION": self.accessors.len() - 1}}]}));
        self.meshes.len() - 1
    }

    /// Adds a view of the bytes, and returns its number.
    fn view(&mut self, bytes: &[u8]) -> usize {
        self.bin.resize(self.bin.len().next_multiple_of(4), 0);
        self.views.push(json!({"buffer": 0, "byteOffset": self.bin.len(), "byteLength": bytes.len()}));
        self.bin.extend(bytes);
        self.bin.resize(self.bin.len().next_multiple_of(4), 0);
        self.views.len() - 1
    }

    /// Adds a material with a generated texture, and returns its number.
    pub(super) fn textured(&mut self, seed: u32) -> usize {
        let texel = |x: u32, y: u32| {
            let weave = ((x * (seed + 3)) ^ (y * (seed + 5))) as u8;
            image::Rgb([weave, weave / 2 + 60, (40 * seed) as u8])
        };
        let mut file = std::io::Cursor::new(Vec::new());
        image::RgbImage::from_fn(64, 64, texel).write_to(&mut file, image::ImageFormat::Png).unwrap();
        let view = self.view(file.get_ref());
        self.images.push(json!({"bufferView": view, "mimeType": "image/png"}));
        self.images.len() - 1
    }

    /// Gives a mesh of [`Self::mesh`] texture coordinates and a material of [`Self::textured`].
    pub(super) fn dress(&mut self, mesh: usize, material: usize, uvs: impl Iterator<Item = [f32; 2]>) {
        let uvs: Vec<[f32; 2]> = uvs.collect();
        let bytes: Vec<u8> = uvs.as_flattened().iter().flat_map(|x| x.to_le_bytes()).collect();
        let view = self.view(&bytes);
        self.accessors
            .push(json!({"bufferView": view, "componentType": 5126, "type": "VEC2", "count": uvs.len()}));
        let primitive = &mut self.meshes[mesh]["primitives"][0];
        primitive["attributes"]["TEXCOORD_0"] = json!(self.accessors.len() - 1);
        primitive["material"] = json!(material);
    }

    pub(crate) fn node(&mut self, mesh: usize, translation: [f64; 3]) {
        self.nodes.push(json!({"mesh": mesh, "translation": translation}));
    }

    pub(crate) fn write(&self, path: &Path) -> PathBuf {
        let roots: Vec<usize> = (0..self.nodes.len()).collect();
        self.write_with(path, &roots)
    }

    fn write_with(&self, path: &Path, roots: &[usize]) -> PathBuf {
        let textures: Vec<Value> = (0..self.images.len()).map(|source| json!({"source": source})).collect();
        let material =
            |texture: usize| json!({"pbrMetallicRoughness": {"baseColorTexture": {"index": texture}}});
        let materials: Vec<Value> = (0..self.images.len()).map(material).collect();
        let json = json!({
            "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": roots}], "nodes": self.nodes,
            "images": self.images, "textures": textures, "materials": materials,
            "meshes": self.meshes, "accessors": self.accessors, "bufferViews": self.views,
            "buffers": [{"byteLength": self.bin.len()}],
        });
        let mut text = json.to_string().into_bytes();
        text.resize(text.len().next_multiple_of(4), b' ');
        let mut bytes = b"glTF".to_vec();
        for number in [2, 28 + text.len() + self.bin.len()] {
            bytes.extend((number as u32).to_le_bytes());
        }
        for (kind, chunk) in [(b"JSON", &text), (b"BIN\0", &self.bin)] {
            bytes.extend((chunk.len() as u32).to_le_bytes());
            bytes.extend(kind);
            bytes.extend(chunk);
        }
        std::fs::write(path, bytes).unwrap();
        path.to_owned()
    }
}

/// The corners of a tetrahedron that is no copy of one of another height.
fn tetrahedron(height: f64) -> Vec<DVec3> {
    let points = [DVec3::ZERO, DVec3::X, DVec3::Y * height, DVec3::new(0.2, 0.3, 1.5)];
    [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]].as_flattened().iter().map(|&i| points[i]).collect()
}

/// The corners of a grid of quads that is bent, so that it is no copy of one that is bent otherwise.
pub(crate) fn sheet(side: usize, bend: f64) -> Vec<DVec3> {
    let at = |x: usize, y: usize| {
        let (x, y) = (x as f64 / side as f64, y as f64 / side as f64);
        DVec3::new(x, y, bend * x * x + y * y * y)
    };
    let quad = |x, y| [at(x, y), at(x + 1, y), at(x + 1, y + 1), at(x, y), at(x + 1, y + 1), at(x, y + 1)];
    (0..side).flat_map(|y| (0..side).flat_map(move |x| quad(x, y))).collect()
}

fn scene(path: &Path, batching: Batching) -> Scene {
    let flags = PreparationSettings { batching: Some(batching), ..PreparationSettings::default() };
    of_files_with(&[path.to_owned()], &flags).unwrap()
}

fn members(scene: &Scene) -> Vec<usize> {
    let count = |part: &Part| match part {
        Part::Batch(members) => members.len(),
        _ => 0,
    };
    scene.assets.iter().map(|asset| count(&asset.part)).filter(|&count| count > 0).collect()
}

#[test]
fn small_copies_are_batched_and_large_ones_become_instances() {
    let dir = TempDir::new().unwrap();
    let mut glb = Glb::default();
    let mut expected = 0;
    for i in 0..60 {
        let turn =
            DMat4::from_rotation_translation(DQuat::from_rotation_y(f64::from(i)), DVec3::ONE * f64::from(i));
        let placed = |corners: Vec<DVec3>| -> Vec<DVec3> {
            corners.into_iter().map(|p| turn.transform_point3(p)).collect()
        };
        // One box-like mesh often, as an exporter writes it, and one large mesh five times.
        let mesh = glb.mesh(&placed(tetrahedron(1.0)));
        glb.node(mesh, [0.0; 3]);
        expected += 1;
        if i % 12 == 0 {
            let mesh = glb.mesh(&placed(sheet(32, 0.5)));
            glb.node(mesh, [100.0, 0.0, 0.0]);
        }
    }
    let path = glb.write(&dir.path().join("a.glb"));
    let found = scene(&path, Batching::Auto);
    assert_eq!(members(&found), [expected]);
    assert_eq!(found.assets.len(), 2, "{:?}", found.assets);
    let instances = &found.models[0].parts;
    assert_eq!(instances.iter().map(|instance| instance.asset).collect::<Vec<_>>(), [0, 0, 0, 0, 0, 1]);
    // Where the file has the first corner.
    for (instance, i) in instances.iter().zip((0..60).step_by(12)) {
        let place = DVec3::ONE * f64::from(i) + DVec3::new(100.0, 0.0, 0.0);
        assert!(instance.placement.to_world(DVec3::ZERO).distance(place) < 1e-5, "{i} {instance:?}");
    }
    // Copies stay instances without batches.
    let off = scene(&path, Batching::Off);
    assert_eq!((off.assets.len(), off.models[0].parts.len()), (2, 65));
}

#[test]
fn batch_says_whether_and_how_large() {
    let dir = TempDir::new().unwrap();
    let mut glb = Glb::default();
    for i in 0..100 {
        let mesh = glb.mesh(&sheet(5, f64::from(i) / 10.0));
        glb.node(mesh, [3.0 * f64::from(i), 0.0, 0.0]);
    }
    let path = glb.write(&dir.path().join("a.glb"));
    assert_eq!(members(&scene(&path, Batching::Auto)), [100]);
    assert_eq!(scene(&path, Batching::Off).assets.len(), 100);
    let some = members(&scene(&path, Batching::try_from(1_000).unwrap()));
    assert!(some.len() > 4 && some.iter().all(|&count| count * 50 <= 1_000), "{some:?}");
    assert_eq!(some.iter().sum::<usize>(), 100);
    // In a scene file, where flags take precedence.
    let file = dir.path().join("scene.toml");
    let text = |line: &str| format!("[[asset]]\nname = 'a'\nfile = 'a.glb'\n{line}");
    let assets = |line: &str| parse(&file, &text(line)).map(|scene| scene.assets.len());
    assert_eq!(assets("").unwrap(), 1);
    assert_eq!(assets("batch = 'auto'").unwrap(), 1);
    assert_eq!(assets("batch = 'off'").unwrap(), 100);
    assert_eq!(assets("batch = 1000").unwrap(), some.len());
    assert_eq!(assets("merge = true").unwrap(), 1);
    std::fs::write(&file, text("batch = 'off'")).unwrap();
    assert_eq!(scene(&file, Batching::Auto).assets.len(), 1);
    for (line, fragment) in [
        ("batch = 'on'", "batch: auto, off or 1000 to 10000000 faces of a batch are possible; \"on\" is not"),
        ("batch = 999", "999 is not"),
        ("batch = true", "expected \"auto\", \"off\" or a number of faces"),
        ("batch = 'off'\nmerge = true", "leave it out, or leave out mesh and merge"),
    ] {
        let why = assets(line).unwrap_err().to_string();
        assert!(why.contains(fragment), "{why}");
    }
}

/// A street of different meshes in several batches.
pub(super) fn street(change: impl Fn(usize) -> f64, count: usize) -> Glb {
    let mut glb = Glb::default();
    for i in 0..count {
        let mesh = glb.mesh(&sheet(4, change(i)));
        glb.node(mesh, [3.0 * i as f64, 0.0, 0.0]);
    }
    glb
}

#[test]
fn only_batches_that_changed_are_prepared_again() {
    let dir = TempDir::new().unwrap();
    let path = dir.path().join("street.glb");
    let bend = |i: usize| 0.1 + i as f64 / 100.0;
    let options = Options { quiet: true, ..Options::default() };
    let prepared = |glb: &Glb| {
        let scene = scene(&glb.write(&path), Batching::try_from(1_000).unwrap());
        let cached = prepare_all(&scene.assets, &dir.path().join("cache"), &options, |_, _| {}).unwrap();
        (cached.len(), cached.iter().filter(|cached| cached.report.is_some()).count())
    };
    let (all, first) = prepared(&street(bend, 200));
    assert!(all >= 8 && first == all, "{all} {first}");
    assert_eq!(prepared(&street(bend, 200)), (all, 0));
    // One mesh of another shape; one more mesh that is read before all others and stands at the end; metadata.
    assert_eq!(prepared(&street(|i| if i == 77 { 9.0 } else { bend(i) }, 200)), (all, 1));
    assert_eq!(prepared(&street(bend, 200)), (all, 0), "the first packs are still there");
    let mut longer = Glb::default();
    let mesh = longer.mesh(&sheet(4, 7.0));
    longer.node(mesh, [600.5, 0.0, 0.0]);
    for i in 0..200 {
        let mesh = longer.mesh(&sheet(4, bend(i)));
        longer.node(mesh, [3.0 * i as f64, 0.0, 0.0]);
    }
    let (more, again) = prepared(&longer);
    assert!(more.abs_diff(all) <= 1 && again <= 2, "{more} {again} of {all}");
    let mut named = street(bend, 200);
    named.meshes[5]["name"] = json!("door");
    assert_eq!(prepared(&named), (all, 0));
    // A moved node is another batch.
    let mut moved = street(bend, 200);
    moved.nodes[11]["translation"] = json!([33.0, 0.125, 0.0]);
    assert_eq!(prepared(&moved), (all, 1));
}

#[test]
fn packs_of_batches_do_not_depend_on_threads_or_on_an_end_between_them() {
    let dir = TempDir::new().unwrap();
    let path = street(|i| 0.1 + i as f64 / 100.0, 200).write(&dir.path().join("street.glb"));
    let scene = scene(&path, Batching::try_from(1_000).unwrap());
    let prepared = |folder: &str, threads| {
        let options = Options { threads: NonZeroUsize::new(threads), quiet: true, ..Options::default() };
        let cached = prepare_all(&scene.assets, &dir.path().join(folder), &options, |_, _| {}).unwrap();
        let bytes: Vec<_> = cached.iter().map(|of| std::fs::read(of.pack.path()).unwrap()).collect();
        (bytes, cached.iter().filter(|cached| cached.report.is_some()).count())
    };
    let (expected, all) = prepared("one", 1);
    assert_eq!(prepared("three", 3), (expected.clone(), all));
    // What was prepared when a process ended is kept: those of the first packs, whole or in part.
    let kept: Vec<PathBuf> = std::fs::read_dir(dir.path().join("three"))
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .filter(|path| path.extension().is_some_and(|extension| extension == "lsp"))
        .collect();
    assert_eq!(kept.len(), all);
    kept[..all / 2].iter().for_each(|pack| std::fs::remove_file(pack).unwrap());
    let short = std::fs::read(&kept[all / 2]).unwrap();
    std::fs::write(&kept[all / 2], &short[..short.len() / 2]).unwrap();
    assert_eq!(prepared("three", 2), (expected, all / 2 + 1));
}

#[test]
fn only_batches_whose_textures_changed_are_prepared_again() {
    let dir = TempDir::new().unwrap();
    let path = dir.path().join("street.glb");
    let options = Options { quiet: true, ..Options::default() };
    // The first half of the street has one texture, the second half another.
    let dressed = |bend: &dyn Fn(usize) -> f64, seeds: [u32; 2]| {
        let mut glb = Glb::default();
        for (half, seed) in seeds.into_iter().enumerate() {
            let material = glb.textured(seed);
            for i in 100 * half..100 * (half + 1) {
                let corners = sheet(4, bend(i));
                let mesh = glb.mesh(&corners);
                glb.dress(mesh, material, corners.iter().map(|p| [p.x as f32, p.y as f32]));
                glb.node(mesh, [3.0 * i as f64, 0.0, 0.0]);
            }
        }
        glb
    };
    let prepared = |glb: &Glb| {
        let scene = scene(&glb.write(&path), Batching::try_from(1_000).unwrap());
        let batches = scene.assets.iter().filter(|asset| matches!(asset.part, Part::Batch(_))).count();
        let cached = prepare_all(&scene.assets, &dir.path().join("cache"), &options, |_, _| {}).unwrap();
        (batches, cached.len(), cached.iter().filter(|cached| cached.report.is_some()).count())
    };
    let bend = |i: usize| 0.1 + i as f64 / 100.0;
    let (batches, all, first) = prepared(&dressed(&bend, [1, 2]));
    assert!(batches == all && all >= 8 && first == all, "{batches} {all} {first}");
    let other_shape = |i: usize| if i == 77 { 9.0 } else { bend(i) };
    assert_eq!(prepared(&dressed(&other_shape, [1, 2])), (all, all, 1));
    let (_, _, again) = prepared(&dressed(&bend, [1, 3]));
    assert!((all / 2..=all / 2 + 1).contains(&again), "{again} of {all}");
    assert_eq!(prepared(&dressed(&bend, [1, 2])), (all, all, 0), "the first packs are still there");
}

#[test]
fn keys_of_batches_depend_on_settings_and_content() {
    let dir = TempDir::new().unwrap();
    let path = dir.path().join("street.glb");
    let key = |glb: &Glb, uv_bits: Option<&str>| {
        let scene = scene(&glb.write(&path), Batching::Auto);
        let preparation_settings = PreparationSettings {
            uv_bits: uv_bits.and_then(|bits| bits.parse().ok()),
            ..PreparationSettings::default()
        };
        let options = Options { preparation_settings, quiet: true, ..Options::default() };
        let keys = keys_of(&scene.assets, &options, &Sources::default()).unwrap();
        assert_eq!(keys.len(), 1);
        keys[0].hex()
    };
    let street = || street(|i| i as f64 / 7.0, 40);
    let mut colored = street();
    let colors = colored.accessors.len();
    colored.accessors.push(json!({"componentType": 5121, "normalized": true, "type": "VEC3", "count": 96}));
    colored.meshes[3]["primitives"][0]["attributes"]["COLOR_0"] = json!(colors);
    let mut sheared = street();
    sheared.nodes[4] = json!({"mesh": 4, "matrix": [1, 0, 0, 0, 0.5, 1, 0, 0, 0, 0, 1, 0, 12, 0, 0, 1]});
    let keys: BTreeSet<String> =
        [key(&street(), None), key(&street(), Some("9")), key(&colored, None), key(&sheared, None)].into();
    assert_eq!(keys.len(), 4);
    assert!(keys.contains(&key(&street(), None)));
}

#[test]
fn mirrored_sheared_and_flat_meshes_and_single_triangles_are_prepared_in_batches() {
    let dir = TempDir::new().unwrap();
    let mut glb = Glb::default();
    let mut shapes = Vec::new();
    for i in 0..40 {
        let height = 1.0 + f64::from(i) / 10.0;
        let corners = match i % 4 {
            0 => vec![DVec3::ZERO, DVec3::X, DVec3::Y * height],
            // Without area.
            1 => vec![DVec3::ZERO, DVec3::X, DVec3::X * height],
            2 => [tetrahedron(height), vec![DVec3::ONE * height; 3]].concat(),
            _ => tetrahedron(height),
        };
        let mesh = glb.mesh(&corners);
        shapes.push(corners);
        let x = 3.0 * f64::from(i);
        glb.nodes.push(match i % 3 {
            0 => json!({"mesh": mesh, "translation": [x, 0, 0], "scale": [-1, 1, 1]}),
            1 => json!({"mesh": mesh, "matrix": [1, 0, 0, 0, 0.5, 1, 0, 0, 0, 0, 1, 0, x, 0, 0, 1]}),
            _ => json!({"mesh": mesh, "translation": [x, 0, 0]}),
        });
    }
    let path = glb.write(&dir.path().join("odd.glb"));
    let scene = scene(&path, Batching::Auto);
    assert_eq!(members(&scene), [40]);
    let Part::Batch(placed) = &scene.assets[0].part else { panic!("no batch") };
    let options = Options { quiet: true, ..Options::default() };
    let cached = prepare_all(&scene.assets, &dir.path().join("cache"), &options, |_, _| {}).unwrap();
    let pack = cached[0].pack.load().unwrap();
    let mesh = pack.refined(&pack.everything()).unwrap();
    // All but the ten faces whose corners coincide: twenty meshes of one triangle, and twenty of four.
    assert_eq!(mesh.face_count(), 20 + 80);
    // Every face in its place, with the side in front that the file shows: glTF turns faces of mirrored nodes around
    // (specification 2.0, section 3.7.4).
    let origin = DVec3::from(mesh.grid().origin);
    for (part, member) in (0..).zip(&placed[..]) {
        let to_scene = DMat4::from_cols_array_2d(&member.to_scene);
        let mirrors = to_scene.determinant() < 0.0;
        let expected = shapes[member.mesh].as_chunks::<3>().0.iter().map(|face| {
            let [a, b, c] = face.map(|corner| to_scene.transform_point3(corner));
            if mirrors { [a, c, b] } else { [a, b, c] }
        });
        let corners: Vec<DVec3> =
            mesh.part_corners(part, |_, place| place).map(|at| origin + DVec3::from(at)).collect();
        let faces = corners.as_chunks::<3>().0;
        for face in expected.filter(|[a, b, c]| a != b && b != c) {
            let turned = |turn: usize| [0, 1, 2].map(|corner| face[(corner + turn) % 3]);
            let is = |other: &[DVec3; 3]| {
                (0..3).any(|turn| turned(turn).iter().zip(other).all(|(a, b)| a.distance(*b) < 1e-3))
            };
            assert!(faces.iter().any(is), "part {part}: {face:?} is not among {faces:?}");
        }
    }
}

#[test]
fn a_hundred_thousand_nodes_and_a_chain_three_thousand_deep_are_gathered() {
    let dir = TempDir::new().unwrap();
    let mut glb = Glb::default();
    let meshes: Vec<usize> = (0..50).map(|i| glb.mesh(&tetrahedron(1.0 + f64::from(i) / 10.0))).collect();
    for i in 0..100_000_u32 {
        glb.node(meshes[(i % 50) as usize], [f64::from(i % 300) * 3.0, f64::from(i / 300) * 3.0, 0.0]);
    }
    let many = scene(&glb.write(&dir.path().join("many.glb")), Batching::Auto);
    assert_eq!(members(&many).iter().sum::<usize>(), 100_000);
    assert!((2..=4).contains(&many.assets.len()), "{}", many.assets.len());
    // A chain, each node with a mesh and the next node.
    glb.nodes.truncate(3_000);
    for i in 0..2_999 {
        glb.nodes[i]["children"] = json!([i + 1]);
        glb.nodes[i]["translation"] = json!([1, 0, 0]);
    }
    let chain = scene(&glb.write_with(&dir.path().join("chain.glb"), &[0]), Batching::Auto);
    assert_eq!(members(&chain), [3_000]);
    let Part::Batch(parts) = &chain.assets[0].part else { panic!("no batch") };
    assert_eq!(parts[2_998].to_scene[3], [2_999.0, 0.0, 0.0, 1.0]);
    let options = Options { quiet: true, ..Options::default() };
    let cached = prepare_all(&chain.assets, &dir.path().join("cache"), &options, |_, _| {}).unwrap();
    let pack = cached[0].pack.load().unwrap();
    assert_eq!(pack.refined(&pack.everything()).unwrap().part_count(), 3_000);
}

#[test]
fn stated_numbers_beyond_the_file_are_errors_of_preparation() {
    let dir = TempDir::new().unwrap();
    let mut glb = street(|i| i as f64 / 7.0, 40);
    glb.accessors[7]["count"] = json!(u32::MAX);
    glb.accessors[8]["count"] = json!(12_000);
    let scene = scene(&glb.write(&dir.path().join("bad.glb")), Batching::Auto);
    assert_eq!(members(&scene), [39], "one states more faces than a member has");
    let options = Options { quiet: true, ..Options::default() };
    let why = prepare_all(&scene.assets, &dir.path().join("cache"), &options, |_, _| {}).unwrap_err();
    assert!(why.to_string().contains("reaches beyond"), "{why}");
}
