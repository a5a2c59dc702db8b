//! Deterministic packs, the cache, exports, checks.

use std::num::NonZeroUsize;
use std::path::Path;

use lodestream_assess::measure::{Settings, compare, read_obj};
use lodestream_bake::export_obj::write_obj;
use lodestream_bake::prepare::{Options, Threads, prepare_cached, prepare_to};
use lodestream_bake::scene::{Asset, of_files};
use lodestream_geometry::ancestor_closed_cut::{Budget, lowest_error};
use lodestream_geometry::check::check;
use lodestream_scene::BlobPart;
use lodestream_store::PackFile;

use crate::support::scene::{TestScene, options};
use crate::support::shapes::{ball, write_scene};

/// Checks that packs depend only on their input, not on thread count, run or folder, for all kinds of asset: closed and
/// open, with one material or textured with seams and hard edges.
#[test]
fn packs_depend_only_on_their_input() {
    let (here, there) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let scenes = [&here, &there].map(|folder| of_files(&[write_scene(folder.path())]).unwrap());
    for (first, second) in scenes[0].assets.iter().zip(&scenes[1].assets) {
        let pack = |asset: &Asset, folder: &tempfile::TempDir, threads: usize| {
            let path = folder.path().join(format!("{threads}.lsp"));
            let with = Options { threads: NonZeroUsize::new(threads), ..options() };
            prepare_to(asset, &with, &path).unwrap();
            std::fs::read(path).unwrap()
        };
        let one = pack(first, &here, 1);
        assert!(one == pack(second, &there, 2), "{}: one thread and two", first.name);
        assert!(one == pack(first, &here, 1), "{}: once and again", first.name);
    }
}

fn flip(path: &Path, at: usize) {
    let mut bytes = std::fs::read(path).unwrap();
    bytes[at] ^= 0x10;
    std::fs::write(path, bytes).unwrap();
}

/// Checks a server's second start: an asset is prepared again only if one of its source files changed or the pack is
/// damaged, and no temporary file is left.
#[test]
fn the_cache_serves_until_its_input_changes() {
    let folder = tempfile::tempdir().unwrap();
    let cache = folder.path().join("cache");
    let scene = of_files(&[write_scene(folder.path())]).unwrap();
    let wall = scene.assets.iter().find(|a| a.name == "wall").unwrap();
    let prepared = || prepare_cached(wall, &cache, &options()).unwrap();
    let packs = || {
        let mut files: Vec<_> = std::fs::read_dir(&cache).unwrap().map(|f| f.unwrap().path()).collect();
        files.sort();
        files
    };
    assert!(prepared().report.is_some());
    let [path] = &packs()[..] else { panic!("{:?}", packs()) };
    let good = std::fs::read(path).unwrap();
    assert!(prepared().report.is_none(), "prepared twice");

    // A texture, a material and the model itself each count.
    for (file, from, to) in
        [("wall.mtl", "Kd 1 1 1", "Kd 1 0 1"), ("wall.obj", "v 1.2 0.9 0.2", "v 1.3 0.9 0.2")]
    {
        let path = folder.path().join(file);
        let text = std::fs::read_to_string(&path).unwrap();
        assert!(text.contains(from), "{text}");
        std::fs::write(&path, text.replace(from, to)).unwrap();
        assert!(prepared().report.is_some(), "{file} has changed");
        std::fs::write(&path, text).unwrap();
        assert!(prepared().report.is_none(), "{file} is unchanged");
    }
    let texture = folder.path().join("brick.png");
    let picture = std::fs::read(&texture).unwrap();
    image::RgbImage::from_pixel(8, 8, image::Rgb([9, 9, 9])).save(&texture).unwrap();
    assert!(prepared().report.is_some(), "a texture has changed");
    std::fs::write(&texture, picture).unwrap();

    // Damage is detected wherever it is: head, table, or any blob to the last.
    let last = good.len() - 1;
    for at in [0, 9, 30, 50, 70, 100, last / 2, last] {
        flip(path, at);
        assert!(prepared().report.is_some(), "byte {at} is damaged");
        assert!(std::fs::read(path).unwrap() == good, "the pack was not repaired");
    }
    std::fs::write(path, &good[..good.len() / 2]).unwrap();
    assert!(prepared().report.is_some(), "half a pack");
    assert!(std::fs::read(path).unwrap() == good);
    assert!(packs().iter().all(|p| p.extension().is_some_and(|e| e == "lsp")), "{:?}", packs());
}

/// Checks that a PLY file, named alone or in a scene file, gives the same asset as the OBJ file of the same mesh, and
/// is prepared again once it has changed.
#[test]
fn ply_files_are_prepared_and_cached_as_others_are() {
    let folder = tempfile::tempdir().unwrap();
    let [obj, ply, scene] = ["ball.obj", "scan.PLY", "scene.toml"].map(|name| folder.path().join(name));
    let text = ball(20, 30);
    std::fs::write(&obj, &text).unwrap();
    let lines =
        |kind: &str| -> Vec<&str> { text.lines().filter_map(|line| line.strip_prefix(kind)).collect() };
    let (places, faces) = (lines("v "), lines("f "));
    let written = |places: &[&str]| {
        let mut out = format!(
            "ply\nformat ascii 1.0\nelement vertex {}\nproperty float64 x\nproperty float64 y\nproperty float64 z\nelement \
             face {}\nproperty list uchar uint vertex_indices\nend_header\n",
            places.len(),
            faces.len()
        );
        places.iter().for_each(|place| out += &format!("{place}\n"));
        for face in &faces {
            let corners =
                face.split_whitespace().map(|c| c.split('/').next().unwrap().parse::<u32>().unwrap() - 1);
            let corners: Vec<String> = corners.map(|corner| corner.to_string()).collect();
            out += &format!("{} {}\n", corners.len(), corners.join(" "));
        }
        std::fs::write(&ply, out).unwrap();
    };
    written(&places);
    std::fs::write(
        &scene,
        "[[asset]]\nname = \"scan\"\nfile = \"scan.PLY\"\n[[instance]]\nasset = \"scan\"\n",
    )
    .unwrap();
    let cache = folder.path().join("cache");
    let prepared = |file: &Path| {
        let scene = of_files(&[file.to_owned()]).unwrap();
        let cached = prepare_cached(&scene.assets[0], &cache, &options()).unwrap();
        let asset = cached.pack.load().unwrap();
        let faces = asset.refined(&asset.everything()).unwrap().face_count();
        (cached.report.is_some(), faces, asset.base.sphere)
    };
    let (anew, faces, sphere) = prepared(&obj);
    assert!(anew);
    assert_eq!(prepared(&ply), (true, faces, sphere));
    assert_eq!(prepared(&scene), (false, faces, sphere), "another pack for a scene file");
    let mut moved = places.clone();
    moved[0] = "9 9 9";
    written(&moved);
    assert!(prepared(&ply).0, "the file has changed");
}

/// Checks that an export has the stated number of faces and error.
#[test]
fn exports_are_as_good_as_they_say() {
    let folder = tempfile::tempdir().unwrap();
    let (model, out) = (folder.path().join("ball.obj"), folder.path().join("out.obj"));
    std::fs::write(&model, ball(40, 60)).unwrap();
    let pack = folder.path().join("ball.lsp");
    prepare_to(&Asset { name: "ball".into(), ..Asset::of_file(&model) }, &options(), &pack).unwrap();
    let asset = PackFile::open(&pack).unwrap().load().unwrap();
    let original = read_obj(&model).unwrap();
    let settings = Settings { samples: NonZeroUsize::new(20_000).unwrap(), ..Settings::default() };
    // Half a cell's diagonal: the error of quantisation alone.
    let rounding = 0.5 * 3.0_f64.sqrt() * asset.base.grid.step;
    let mut sizes = Vec::new();
    let third = asset.infos.iter().map(|i| u64::from(i.payload_bytes)).sum::<u64>() / 3;
    for budget in [
        Budget::Faces(600),
        Budget::Error(0.02 * original.diagonal()),
        Budget::Bytes(asset.head_bytes() + third),
        Budget::Error(0.01 * original.diagonal()),
        Budget::Everything,
    ] {
        let set = lowest_error(&asset.base, &asset.infos, asset.head_bytes(), budget);
        let mesh = asset.refined(&set.members).unwrap().to_mesh();
        write_obj(&mut std::fs::File::create(&out).unwrap(), &mesh, &asset.description.materials).unwrap();
        let exported = read_obj(&out).unwrap();
        assert_eq!(exported.triangles.len() as u64, set.faces, "{budget:?}");
        let found = compare(&original, &exported, &settings).unwrap();
        let bound = set.error + rounding;
        let (max, diagonal) = (found.max * found.diagonal, found.diagonal);
        println!("{budget:?}: {} faces, {:.4} of {bound:.4}, diagonal {diagonal:.3}", set.faces, max);
        assert!(max <= bound, "{budget:?}: {max} is beyond {bound}");
        match budget {
            Budget::Faces(limit) => assert!(set.faces <= limit),
            Budget::Error(limit) => assert!(set.error <= limit),
            Budget::Bytes(limit) => assert!(set.bytes <= limit),
            Budget::Everything => assert_eq!(set.error, 0.0),
        }
        sizes.push(set.faces);
    }
    assert!(sizes.is_sorted() && sizes[0] < sizes[4], "larger budgets give finer meshes: {sizes:?}");
}

/// Checks every kind of asset in the small scene for cracks, order dependence and exact undo.
#[test]
fn every_asset_passes_the_check() {
    for asset in &TestScene::small().assets {
        let threads = Threads::all_cores();
        let report = check(&asset.base, &asset.infos, &asset.chunks, 30, 3, &threads).unwrap();
        let found = (report.sets, report.cracks, report.order_dependent, report.undo_errors);
        assert_eq!(found, (30, 0, 0, 0), "{}", asset.description.name);
    }
}

/// Checks that every blob of a pack's description exists with its stated length.
#[test]
fn packs_hold_what_their_descriptions_state() {
    let folder = tempfile::tempdir().unwrap();
    let scene = of_files(&[write_scene(folder.path())]).unwrap();
    let wall = scene.assets.iter().find(|a| a.name == "wall").unwrap();
    let pack = prepare_cached(wall, &folder.path().join("cache"), &options()).unwrap().pack;
    let textures = pack.load().unwrap().description.textures;
    assert_eq!(textures.len(), 2, "colour and height");
    for (texture, info) in (0..).zip(&textures) {
        let widths: Vec<u32> = info.levels.iter().map(|level| level.width).collect();
        assert!(widths.len() > 2 && widths.ends_with(&[32, 64, 128]), "coarse first: {widths:?}");
        for (level, promised) in (0..).zip(&info.levels) {
            let part = BlobPart::Texture { texture, level };
            let bytes = pack.read(part).unwrap();
            assert_eq!(bytes.len(), promised.bytes as usize);
            let picture = image::load_from_memory(&bytes).unwrap();
            assert_eq!((picture.width(), picture.height()), (promised.width, promised.height));
        }
    }
}
