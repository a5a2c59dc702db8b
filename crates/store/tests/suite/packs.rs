//! From models in a folder to blobs of a scene: the cache is used, damage is noticed.

use std::path::{Path, PathBuf};

use image::{Rgb, RgbImage};
use lodestream_geometry::index::decode_page;
use lodestream_geometry::pack::BlobKind;
use lodestream_geometry::refine::ActiveMesh;
use lodestream_protocol::source::{CacheUse, Reading, SceneSource, SourceError};
use lodestream_scene::asset::AssetDescription;
use lodestream_scene::{BlobId, BlobPart};
use tempfile::TempDir;

use lodestream_bake::prepare::{Options, prepare_cached, prepare_to};
use lodestream_bake::scene::{self, Scene};
use lodestream_store::*;

/// A wavy, textured sheet of 2·n² faces, and a scene of two instances of it and one of a triangle.
fn scene(dir: &Path, n: usize) -> Scene {
    let mut obj = String::from("mtllib sheet.mtl\nusemtl wave\n");
    for y in 0..=n {
        for x in 0..=n {
            let (u, v) = (x as f64 / n as f64, y as f64 / n as f64);
            let height = 0.1 * (9.0 * u).sin() * (7.0 * v).cos();
            obj.push_str(&format!("v {u} {height} {v}\nvt {u} {v}\n"));
        }
    }
    for y in 0..n {
        for x in 0..n {
            let a = y * (n + 1) + x + 1;
            let (b, c, d) = (a + 1, a + n + 1, a + n + 2);
            obj.push_str(&format!("f {a}/{a} {c}/{c} {d}/{d} {b}/{b}\n"));
        }
    }
    std::fs::write(dir.join("sheet.obj"), obj).unwrap();
    std::fs::write(dir.join("sheet.mtl"), "newmtl wave\nmap_Kd wave.png\n").unwrap();
    RgbImage::from_fn(32, 32, |x, y| Rgb([x as u8 * 8, y as u8 * 8, 0])).save(dir.join("wave.png")).unwrap();
    std::fs::write(dir.join("one.obj"), "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n").unwrap();
    let text = "[[asset]]\nname = 'one'\nfile = 'one.obj'\n[[asset]]\nname = 'sheet'\nfile = 'sheet.obj'\n\
        [[instance]]\nasset = 'one'\ntranslation = [0, 0, -50]\n\
        [[instance]]\nasset = 'sheet'\ntranslation = [0, 0, -2]\n\
        [[instance]]\nasset = 'sheet'\ntranslation = [0, 0, -4]\nrotation = { yaw = 90 }\n\
        [camera]\neye = [0, 1, 3]\ntarget = [0, 0, -9]\n";
    scene::parse(&dir.join("scene.toml"), text).unwrap()
}

fn options() -> Options {
    Options { quiet: true, ..Options::default() }
}

fn open(scene: &Scene, cache: &Path) -> (Vec<bool>, SceneStore) {
    let cached = scene.assets.iter().map(|asset| prepare_cached(asset, cache, &options()).unwrap());
    let (prepared, packs) = cached.map(|c| (c.report.is_some(), c.pack)).unzip();
    (prepared, lodestream_bake::compose::open(scene, packs, &BlobCache::new(1 << 20)).unwrap())
}

fn packs_in(cache: &Path) -> Vec<PathBuf> {
    let mut files: Vec<PathBuf> = std::fs::read_dir(cache).unwrap().map(|f| f.unwrap().path()).collect();
    files.sort();
    files
}

#[test]
fn the_second_start_finds_the_packs_of_the_first() {
    let dir = TempDir::new().unwrap();
    let cache = dir.path().join("new/cache");
    let scene = scene(dir.path(), 20);
    let (prepared, first) = open(&scene, &cache);
    assert_eq!(prepared, [true, true]);
    assert_eq!(packs_in(&cache).len(), 2);
    let (prepared, second) = open(&scene, &cache);
    assert_eq!(prepared, [false, false]);
    assert_eq!(first.header(), second.header());
    // A changed texture changes one asset, and the scene's fingerprint with it.
    RgbImage::new(32, 32).save(dir.path().join("wave.png")).unwrap();
    let (prepared, third) = open(&scene, &cache);
    assert_eq!(prepared, [false, true]);
    assert_ne!(third.header().fingerprint, first.header().fingerprint);
}

#[test]
fn a_damaged_pack_in_the_cache_is_made_again() {
    let dir = TempDir::new().unwrap();
    let scene = scene(dir.path(), 4);
    open(&scene, dir.path());
    for pack in packs_in(dir.path()).iter().filter(|p| p.extension().is_some_and(|e| e == "lsp")) {
        let bytes = std::fs::read(pack).unwrap();
        std::fs::write(pack, &bytes[..bytes.len() / 2]).unwrap();
    }
    let (prepared, _) = open(&scene, dir.path());
    assert_eq!(prepared, [true, true]);
}

#[test]
fn cache_hits_and_misses_are_counted_once_per_blob() {
    let dir = TempDir::new().unwrap();
    let (_, store) = open(&scene(dir.path(), 40), dir.path());
    let [base, chunk] = [BlobId::base(0), BlobId::chunk(0, 0)];
    assert!(matches!(store.try_read(&base), Ok(Reading::Ready(_))));
    assert_eq!(store.try_read(&chunk), Ok(Reading::Pending));
    store.read(&chunk).unwrap();
    assert!(matches!(store.try_read(&chunk), Ok(Reading::Ready(_))));
    assert!(store.try_read(&BlobId::chunk(9, 0)).is_err());
    assert_eq!(store.cache_use(), Some(CacheUse { hits: 2, misses: 1 }));
}

#[test]
fn a_client_can_rebuild_the_asset_from_the_blobs_alone() {
    let dir = TempDir::new().unwrap();
    let scene = scene(dir.path(), 40);
    let (_, store) = open(&scene, dir.path());
    assert_eq!(store.header().asset_count, 2);
    let page = store.page(0).unwrap();
    assert!(store.page(1).is_none());
    // The near sheet is asset 0, though the file lists it second.
    assert_eq!(page.assets[0].name, "sheet");
    assert_eq!(page.instances.iter().map(|i| i.asset).collect::<Vec<_>>(), [0, 0, 1]);
    let read = |part| {
        let id = BlobId::Asset { asset: 0, part };
        let bytes = store.read(&id).unwrap();
        assert_eq!(store.blob_len(&id), Some(bytes.len() as u32));
        assert_eq!(store.read(&id).unwrap(), bytes);
        bytes
    };
    let base = lodestream_compress::decode_base(&read(BlobPart::Base)).unwrap();
    assert_eq!(page.assets[0].chunk_count, base.chunk_count);
    let mut mesh = ActiveMesh::new(&base);
    let infos: Vec<_> = (0..page.assets[0].index_pages())
        .flat_map(|i| decode_page(&read(BlobPart::IndexPage(i)), i * 64).unwrap())
        .collect();
    for (id, info) in infos.iter().enumerate() {
        let delta = mesh.decode(id as u32, info, &read(BlobPart::Chunk(id as u32))).unwrap();
        mesh.apply(&delta).unwrap();
    }
    assert_eq!(mesh.face_count(), 2 * 40 * 40);
    let description = AssetDescription::decode(&base.description).unwrap();
    let texture = &description.textures[description.materials[0].base_color_texture.unwrap() as usize];
    for (level, info) in texture.levels.iter().enumerate() {
        let bytes = read(BlobPart::Texture { texture: 0, level: level as u8 });
        let image = image::load_from_memory(&bytes).unwrap();
        assert_eq!(
            (image.width(), image.height(), bytes.len() as u32),
            (info.width, info.height, info.bytes)
        );
    }
}

#[test]
fn missing_blobs_are_not_found_and_damaged_ones_unreadable() {
    let dir = TempDir::new().unwrap();
    let scene = scene(dir.path(), 40);
    let cache = dir.path().join("cache");
    let (_, store) = open(&scene, &cache);
    for id in [BlobId::chunk(0, 9999), BlobId::base(2), BlobId::texture(0, 1, 0), BlobId::index_page(0, 77)] {
        assert_eq!(store.blob_len(&id), None);
        assert_eq!(store.read(&id), Err(SourceError::NotFound(id)));
    }
    // Flip the last byte of each pack while it is open: the last blob's hash no longer fits.
    for pack in packs_in(&cache) {
        let mut bytes = std::fs::read(&pack).unwrap();
        *bytes.last_mut().unwrap() ^= 1;
        std::fs::write(&pack, bytes).unwrap();
    }
    let finest = BlobId::texture(0, 0, 2);
    assert!(store.blob_len(&finest).is_some());
    let error = store.read(&finest).unwrap_err().to_string();
    assert!(error.contains("damaged"), "{error}");
}

#[test]
fn a_pack_whose_chunk_lengths_contradict_its_index_is_refused() {
    let dir = TempDir::new().unwrap();
    let path = dir.path().join("sheet.lsp");
    prepare_to(&scene(dir.path(), 40).assets[1], &options(), &path).unwrap();
    let pack = PackFile::open(&path).unwrap();
    pack.entry("sheet").unwrap();
    let blobs = |change: &dyn Fn(&mut Vec<u8>)| {
        let mut blobs: Vec<_> =
            pack.entries().iter().map(|entry| (entry.kind, pack.read_entry(entry).unwrap())).collect();
        change(&mut blobs.iter_mut().find(|(kind, _)| *kind == BlobKind::Chunk(0)).unwrap().1);
        let blobs: Vec<_> = blobs.iter().map(|(kind, bytes)| (*kind, &bytes[..])).collect();
        lodestream_geometry::pack::write(pack.made_from(), &blobs).unwrap()
    };
    let other = dir.path().join("other.lsp");
    let longer = |chunk: &mut Vec<u8>| chunk.push(0);
    let shorter = |chunk: &mut Vec<u8>| chunk.truncate(1);
    for change in [&longer as &dyn Fn(&mut Vec<u8>), &shorter] {
        std::fs::write(&other, blobs(change)).unwrap();
        let other = PackFile::open(&other).unwrap();
        other.verify().unwrap();
        let error = other.entry("sheet").unwrap_err().to_string();
        assert!(error.contains("a chunk is not as long as its index page says"), "{error}");
    }
}

#[test]
fn a_pack_that_was_closed_to_make_room_is_read_again() {
    let dir = TempDir::new().unwrap();
    let scene = scene(dir.path(), 4);
    let path = |i: usize| dir.path().join(format!("{i}.lsp"));
    for i in 0..5 {
        prepare_to(&scene.assets[0], &options(), &path(i)).unwrap();
    }
    let pool = FilePool::new(2);
    let open = |i| PackFile::open_in(std::sync::Arc::clone(&pool), &path(i)).unwrap();
    let packs: Vec<PackFile> = (0..5).map(open).collect();
    assert_eq!(pool.count(), 2);
    for _ in 0..2 {
        for pack in &packs {
            pack.verify().unwrap();
            assert_eq!(pool.count(), 2);
        }
    }
    // What was written again with the same contents is the same pack; another asset's is not.
    prepare_to(&scene.assets[0], &options(), &path(0)).unwrap();
    packs[0].verify().unwrap();
    prepare_to(&scene.assets[1], &options(), &path(1)).unwrap();
    let error = packs[1].verify().unwrap_err().to_string();
    assert!(error.contains("1.lsp: is another pack"), "{error}");
    std::fs::remove_file(path(2)).unwrap();
    let error = packs[2].verify().unwrap_err().to_string();
    assert!(error.contains("2.lsp: cannot be read"), "{error}");
    drop(packs);
    assert_eq!(pool.count(), 0);
}

/// A scene of 1,100 assets must be served although a process may open only 1,024 files.
#[cfg(target_os = "linux")]
#[test]
fn a_scene_of_many_packs_keeps_few_files_open() {
    let dir = TempDir::new().unwrap();
    let scene = scene(dir.path(), 1);
    let path = |i: usize| dir.path().join(format!("{i}.lsp"));
    prepare_to(&scene.assets[0], &options(), &path(0)).unwrap();
    for i in 1..200 {
        std::fs::copy(path(0), path(i)).unwrap();
    }
    let packs: Vec<PackFile> = (0..200).map(|i| PackFile::open(&path(i)).unwrap()).collect();
    let open = || {
        let files = std::fs::read_dir("/proc/self/fd").unwrap().flatten();
        files
            .filter(|fd| std::fs::read_link(fd.path()).is_ok_and(|file| file.starts_with(dir.path())))
            .count()
    };
    assert!(open() <= 128, "{} files are open", open());
    packs.iter().for_each(|pack| pack.verify().unwrap());
    assert!(open() <= 128, "{} files are open once all were read", open());
}
