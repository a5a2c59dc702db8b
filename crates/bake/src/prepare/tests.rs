//! Settings from flags, scene files and defaults, and the cache of packs.

use std::num::NonZeroUsize;
use std::path::Path;

use crate::preparation_settings::{Effort, Precision, PreparationSettings};
use lodestream_geometry::Codec;
use lodestream_geometry::pool::Serial;
use tempfile::TempDir;

use super::{Cached, Options, prefer_least_effort, prepare_all, prepare_all_of, prepare_cached};
use crate::scene::{self, Asset};
use crate::sources::Sources;

const TRIANGLE: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";

/// The settings that the packs of a scene file record.
fn settings(folder: &Path, scene: &str, flags: PreparationSettings) -> Vec<String> {
    let scene = scene::parse(&folder.join("scene.toml"), scene).unwrap();
    let options = Options { preparation_settings: flags, quiet: true, ..Options::default() };
    let pack = |asset| prepare_cached(asset, &folder.join("cache"), &options).unwrap().pack;
    scene.assets.iter().map(|asset| pack(asset).settings().unwrap()).collect()
}

#[test]
fn flags_override_settings_of_the_scene_file() {
    let dir = TempDir::new().unwrap();
    std::fs::write(dir.path().join("a.obj"), TRIANGLE).unwrap();
    let scene = "[[asset]]\nname = 'fine'\nfile = 'a.obj'\nposition_bits = 16\ncodec = 'zstd'\n\
        [[asset]]\nname = 'close'\nfile = 'a.obj'\ntolerance = 0.01\n\
        [[asset]]\nname = 'plain'\nfile = 'a.obj'\n";
    let flags = PreparationSettings {
        precision: "10".parse().ok().map(Precision::Bits),
        ..PreparationSettings::default()
    };
    let told = settings(dir.path(), scene, flags);
    for settings in &told {
        assert!(settings.starts_with("position-bits 10,"), "{told:?}");
    }
    // A setting without a flag is the scene file's, else the default.
    assert!(told[0].contains("codec zstd") && told[1].contains("codec auto"), "{told:?}");
    let told = settings(dir.path(), scene, PreparationSettings::default());
    assert!(told[0].starts_with("position-bits 16,") && told[1].starts_with("tolerance 0.01,"), "{told:?}");
    assert!(told[2].starts_with("position-bits 14,"), "{told:?}");
}

#[test]
fn each_model_has_the_codec_that_suits_it_unless_one_is_chosen() {
    let dir = TempDir::new().unwrap();
    // Steps, along the axes or rotated about all of them.
    let steps = |turned: bool| {
        let mut obj = String::new();
        for (x, y) in (0..10).flat_map(|y| (0..10).map(move |x| (f64::from(x), f64::from(y)))) {
            let z = (x / 2.0).floor();
            let [a, b, c] = if turned {
                [0.36 * x - 0.48 * y + 0.8 * z, 0.8 * x + 0.6 * y, 0.64 * y - 0.48 * x + 0.6 * z]
            } else {
                [x, y, z]
            };
            obj.push_str(&format!("v {a} {b} {c}\n"));
        }
        for i in (1..=9).flat_map(|x| (0..9).map(move |y| y * 10 + x)) {
            obj.push_str(&format!("f {} {} {} {}\n", i, i + 1, i + 11, i + 10));
        }
        obj
    };
    for (name, turned) in [("steps.obj", false), ("turned.obj", true)] {
        std::fs::write(dir.path().join(name), steps(turned)).unwrap();
    }
    let scene = "[[asset]]\nname = 'a'\nfile = 'steps.obj'\n\
        [[asset]]\nname = 'b'\nfile = 'turned.obj'\n\
        [[asset]]\nname = 'c'\nfile = 'steps.obj'\ncodec = 'range'\n\
        [[asset]]\nname = 'd'\nfile = 'turned.obj'\ncodec = 'axis-aligned'\n";
    let scene = scene::parse(&dir.path().join("scene.toml"), scene).unwrap();
    let options = Options { quiet: true, ..Options::default() };
    let codecs = scene.assets.iter().map(|asset| {
        let pack = prepare_cached(asset, &dir.path().join("cache"), &options).unwrap().pack;
        pack.base().unwrap().codec
    });
    assert_eq!(
        codecs.collect::<Vec<_>>(),
        [Codec::AxisAligned, Codec::Range, Codec::Range, Codec::AxisAligned]
    );
}

#[test]
fn a_cached_pack_of_another_model_is_not_served() {
    let dir = tempfile::TempDir::new().unwrap();
    let cache = dir.path().join("cache");
    let options = Options { quiet: true, ..Options::default() };
    let prepared = |name: &str, corner: u32| {
        let file = dir.path().join(name);
        std::fs::write(&file, format!("v 0 0 0\nv {corner} 0 0\nv 0 1 0\nf 1 2 3\n")).unwrap();
        prepare_cached(&Asset::of_file(&file), &cache, &options).unwrap()
    };
    let (one, other) = (prepared("one.obj", 1), prepared("other.obj", 2));
    let right = other.pack.fingerprint();
    std::fs::copy(one.pack.path(), other.pack.path()).unwrap();
    let again = prepared("other.obj", 2);
    assert!(again.report.is_some(), "it is prepared anew");
    assert_eq!(again.pack.fingerprint(), right);
    assert!(prepared("other.obj", 2).report.is_none());
}

const GLTF_TRIANGLE: &str = r#"{"asset": {"version": "2.0"}, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
    "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
    "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 0]}],
    "bufferViews": [{"buffer": 0, "byteLength": 36}], "buffers": [{"byteLength": 36, "uri":
    "data:application/octet-stream;base64,AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAA"}]}"#;

#[test]
fn the_least_effort_is_set_where_no_pack_is_cached_and_none_is_set() {
    let dir = TempDir::new().unwrap();
    let cache = dir.path().join("cache");
    for (name, text) in [("a.obj", TRIANGLE), ("b.obj", TRIANGLE), ("c.gltf", GLTF_TRIANGLE)] {
        std::fs::write(dir.path().join(name), text).unwrap();
    }
    let scene = "[[asset]]\nname = 'a'\nfile = 'a.obj'\n\
        [[asset]]\nname = 'b'\nfile = 'b.obj'\n\
        [[asset]]\nname = 'c'\nfile = 'c.gltf'\n\
        [[asset]]\nname = 'd'\nfile = 'b.obj'\neffort = 'full'\n";
    let scene = scene::parse(&dir.path().join("scene.toml"), scene).unwrap();
    let efforts = || {
        let mut assets = scene.assets.clone();
        prefer_least_effort(&mut assets, &cache, &Sources::in_folder(&cache));
        let effort = |asset: &Asset| asset.preparation_settings.effort;
        assets.iter().map(effort).collect::<Vec<_>>()
    };
    let (full, least) = (Some(Effort::Full), Some(Effort::Least));
    assert_eq!(efforts(), [least, least, least, full]);
    let options = Options { quiet: true, ..Options::default() };
    let some = [scene.assets[0].clone(), scene.assets[2].clone()];
    prepare_all_of(&some, &cache, &options, &Sources::in_folder(&cache), |_, _| {}).unwrap();
    assert_eq!(efforts(), [None, least, None, full]);
}

/// glTF files from elsewhere, read and described without preparing their geometry.
///
/// ```sh
/// LODESTREAM_MODELS=… cargo test --release -p lodestream-server no_sample -- --ignored --nocapture
/// ```
#[test]
#[ignore = "needs $LODESTREAM_MODELS, a folder with glTF files"]
fn no_sample_is_refused_for_its_materials() {
    let models = std::env::var_os("LODESTREAM_MODELS").expect("$LODESTREAM_MODELS names a folder");
    let (mut folders, mut files) = (vec![std::path::PathBuf::from(models)], Vec::new());
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else if lodestream_import::is_gltf(&path) {
                files.push(path);
            }
        }
    }
    files.sort();
    assert!(!files.is_empty());
    for path in files {
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        match lodestream_import::import(&path) {
            Ok(imported) => {
                let described =
                    super::describe::describe(&name, &imported.materials, &Default::default(), &Serial)
                        .unwrap();
                let lost: Vec<_> = imported.warnings.iter().chain(&described.warnings).collect();
                println!(
                    "{name}: {} materials, {} textures",
                    imported.materials.len(),
                    described.textures.len()
                );
                lost.iter().for_each(|warning| println!("    {}", warning.rsplit('/').next().unwrap_or("")));
            }
            Err(error) => {
                let why = error.to_string();
                println!("{name}: {}", why.rsplit('/').next().unwrap_or(""));
                let geometry = ["has no faces", ": nodes["].iter().any(|word| why.contains(word));
                assert!(geometry, "{why}");
            }
        }
    }
}

#[test]
fn many_assets_of_one_file_give_the_same_packs_side_by_side_and_one_by_one() {
    let dir = TempDir::new().unwrap();
    for number in 0..20 {
        let height = 1.0 + 0.1 * f64::from(number);
        let obj =
            format!("v 0 0 0\nv 1 0 0\nv 0 {height} 0\nv 0 0 {height}\nf 1 2 3\nf 1 4 2\nf 1 3 4\nf 2 4 3\n");
        std::fs::write(dir.path().join(format!("{number}.obj")), obj).unwrap();
    }
    let files: Vec<_> = (0..20).map(|number| dir.path().join(format!("{number}.obj"))).collect();
    let assets = scene::of_files(&files).unwrap().assets;
    let threads = |count| Options { threads: NonZeroUsize::new(count), quiet: true, ..Options::default() };
    let bytes = |cached: &Cached| std::fs::read(cached.pack.path()).unwrap();
    let mut order = Vec::new();
    let many =
        prepare_all(&assets, &dir.path().join("many"), &threads(3), |number, _| order.push(number)).unwrap();
    assert!(order.iter().copied().eq(0..20));
    assert!(many.iter().all(|cached| cached.report.is_some()));
    for (asset, cached) in assets.iter().zip(&many) {
        let alone = prepare_cached(asset, &dir.path().join("alone"), &threads(1)).unwrap();
        assert_eq!(bytes(&alone), bytes(cached), "{}", asset.name);
        assert_eq!(alone.pack.path().file_name(), cached.pack.path().file_name());
    }
    // The second time from the cache; a file that has changed is prepared again.
    std::fs::write(&files[7], TRIANGLE).unwrap();
    let again = prepare_all(&assets, &dir.path().join("many"), &threads(3), |_, _| {}).unwrap();
    let prepared = again.iter().filter(|cached| cached.report.is_some()).count();
    assert_eq!(prepared, 1);
    std::fs::remove_file(&files[7]).unwrap();
    let why = prepare_all(&assets, &dir.path().join("many"), &threads(3), |_, _| {}).unwrap_err();
    assert!(why.to_string().contains("7.obj"), "{why}");
}

/// A PLY file with texture coordinates, which is never read whole, and STL, which names no other files.
#[test]
fn a_texture_of_a_scan_that_appears_beside_it_later_is_noticed() {
    let dir = TempDir::new().unwrap();
    let ply = "ply\nformat ascii 1.0\ncomment TextureFile C:\\scans\\SKIN.png\nelement vertex 3\nproperty float x\n\
               property float y\nproperty float z\nproperty float s\nproperty float t\nelement face 1\n\
               property list uchar int vertex_indices\nend_header\n0 0 0 0 0\n1 0 0 1 0\n0 1 0 0 1\n3 0 1 2\n";
    let stl = "solid\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n";
    let prepared = |name: &str, text: &str| {
        let file = dir.path().join(name);
        std::fs::write(&file, text).unwrap();
        let options = Options { quiet: true, ..Options::default() };
        prepare_cached(&Asset::of_file(&file), &dir.path().join("cache"), &options).unwrap()
    };
    let without = prepared("a.ply", ply);
    assert!(without.files.contains(&dir.path().join("SKIN.png")), "{:?}", without.files);
    let warnings = without.report.unwrap().warnings;
    assert!(warnings.len() == 1 && warnings[0].contains("SKIN.png"), "{warnings:?}");
    assert!(prepared("a.ply", ply).report.is_none());
    image::RgbImage::from_pixel(8, 8, image::Rgb([200, 30, 40])).save(dir.path().join("skin.PNG")).unwrap();
    let with = prepared("a.ply", ply);
    assert!(with.report.unwrap().warnings.is_empty());
    assert_eq!(with.pack.textures().len(), 1);
    assert_eq!(prepared("a.stl", stl).report.unwrap().faces, 1);
    assert!(prepared("a.stl", stl).report.is_none());
}
