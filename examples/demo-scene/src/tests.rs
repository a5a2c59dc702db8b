//! Tests of the written files, read back as text: complete, well-formed, and the same on every machine.

use super::*;
use glam::{DVec2, DVec3};
use lodestream_bake::prepare::prepare_to;
use lodestream_bake::scene::Asset;
use std::collections::{BTreeMap, BTreeSet, HashMap};

/// BLAKE3 over the small scene of seed 7: texts as bytes, pictures as pixels, so that a new PNG encoder does not
/// matter.
/// A change of the scene changes it; another machine must not.
const GOLDEN: &str = "e05e43c5a91ea0e960ee22a0c7bff908dfb56ca393f898ca35333f1b20d2553b";

/// An OBJ file's own statements.
#[derive(Default)]
struct Parsed {
    positions: Vec<DVec3>,
    uvs: Vec<DVec2>,
    normals: Vec<DVec3>,
    faces: Vec<[(usize, Option<usize>, usize); 3]>,
    materials: BTreeSet<String>,
    library: String,
}

fn parse(path: &Path) -> Parsed {
    let mut parsed = Parsed::default();
    for line in std::fs::read_to_string(path).unwrap().lines() {
        let words: Vec<&str> = line.split(' ').collect();
        let numbers = || words[1..].iter().map(|w| w.parse::<f64>().unwrap()).collect::<Vec<f64>>();
        match words[0] {
            "v" => parsed.positions.push(DVec3::from_slice(&numbers())),
            "vt" => parsed.uvs.push(DVec2::from_slice(&numbers())),
            "vn" => parsed.normals.push(DVec3::from_slice(&numbers())),
            "usemtl" => drop(parsed.materials.insert(words[1].to_owned())),
            "mtllib" => parsed.library = words[1].to_owned(),
            "o" => {}
            "f" => {
                assert_eq!(words.len(), 4, "triangles only");
                parsed.faces.push([1, 2, 3].map(|k| {
                    let mut index = words[k].split('/').map(|w| w.parse::<usize>().ok().map(|i| i - 1));
                    (index.next().unwrap().unwrap(), index.next().unwrap(), index.next().unwrap().unwrap())
                }));
            }
            other => panic!("unexpected {other}"),
        }
    }
    parsed
}

fn small(seed: u64) -> (tempfile::TempDir, Summary) {
    let dir = tempfile::tempdir().unwrap();
    let summary = generate(dir.path(), &Options::small(seed)).unwrap();
    (dir, summary)
}

pub(crate) fn files(dir: &Path) -> BTreeMap<String, Vec<u8>> {
    std::fs::read_dir(dir)
        .unwrap()
        .map(|entry| {
            let path = entry.unwrap().path();
            (path.file_name().unwrap().to_str().unwrap().to_owned(), std::fs::read(&path).unwrap())
        })
        .collect()
}

/// Hash of files; pictures by their pixels, since encoders may change.
pub(crate) fn hash(files: &BTreeMap<String, Vec<u8>>) -> String {
    let mut hasher = blake3::Hasher::new();
    for (name, bytes) in files {
        hasher.update(name.as_bytes());
        if name.ends_with(".png") {
            hasher.update(image::load_from_memory(bytes).unwrap().as_bytes());
        } else {
            hasher.update(bytes);
        }
    }
    hasher.finalize().to_hex().to_string()
}

#[test]
fn same_seed_same_bytes_and_the_golden_hash() {
    let ((first, summary), (second, _)) = (small(7), small(7));
    let first_files = files(first.path());
    assert_eq!(first_files, files(second.path()));
    assert_eq!(summary.bytes, first_files.values().map(|b| b.len() as u64).sum::<u64>());
    assert_eq!(hash(&first_files), GOLDEN);
}

#[test]
fn another_seed_changes_ground_stone_and_statues() {
    let ((a, _), (b, _)) = (small(7), small(8));
    let (a, b) = (files(a.path()), files(b.path()));
    for name in ["lion.obj", "sage.obj", "dragon.obj", "boulder.obj", "brick.png", "scene.toml"] {
        assert_ne!(a[name], b[name], "{name}");
    }
}

#[test]
fn every_file_that_is_named_exists() {
    let (dir, summary) = small(1);
    let scene: toml::Table = std::fs::read_to_string(&summary.scene).unwrap().parse().unwrap();
    lodestream_bake::scene::read(&summary.scene).unwrap();
    let assets = scene["asset"].as_array().unwrap();
    assert_eq!(assets.len(), summary.assets);
    let library = std::fs::read_to_string(dir.path().join(obj::MATERIAL_FILE)).unwrap();
    let materials: BTreeSet<String> =
        library.lines().filter_map(|l| l.strip_prefix("newmtl ")).map(str::to_owned).collect();
    for line in library.lines() {
        if let Some(file) = line.strip_prefix("map_Kd ").or_else(|| line.strip_prefix("map_Bump ")) {
            let picture = image::open(dir.path().join(file)).unwrap();
            assert!(picture.width() >= 8 && picture.width() == picture.height());
        }
    }
    let mut names = BTreeSet::new();
    for asset in assets {
        assert!(names.insert(asset["name"].as_str().unwrap().to_owned()), "asset named twice");
        let parsed = parse(&dir.path().join(asset["file"].as_str().unwrap()));
        assert_eq!(parsed.library, obj::MATERIAL_FILE);
        assert!(!parsed.materials.is_empty() && parsed.materials.is_subset(&materials));
    }
    let instances = scene["instance"].as_array().unwrap();
    assert_eq!(instances.len(), summary.instances);
    let mut count: BTreeMap<&str, usize> = BTreeMap::new();
    for instance in instances {
        let asset = instance["asset"].as_str().unwrap();
        assert!(names.contains(asset), "{asset}");
        *count.entry(asset).or_default() += 1;
        let length: f64 =
            instance["rotation"].as_array().unwrap().iter().map(|c| c.as_float().unwrap().powi(2)).sum();
        assert!((length - 1.0).abs() < 1e-6);
    }
    assert_eq!(count.len(), summary.assets, "an asset is never placed");
    assert!(count["column"] >= 20 && count["lion"] + count["sage"] + count["dragon"] >= 10, "{count:?}");
}

#[test]
fn the_importer_gives_no_warnings() {
    let (dir, summary) = small(1);
    let mut faces = 0;
    for asset in lodestream_bake::scene::read(&summary.scene).unwrap().assets {
        let imported = lodestream_import::import(&asset.file).unwrap();
        assert_eq!(imported.warnings, Vec::<String>::new(), "{}", asset.name);
        faces += imported.mesh.faces.len();
        let described = lodestream_bake::prepare::describe::describe(
            &asset.name,
            &imported.materials,
            &asset.preparation_settings,
            &lodestream_bake::prepare::Threads::all_cores(),
        )
        .unwrap();
        assert_eq!(described.warnings, Vec::<String>::new(), "{}", asset.name);
        let relief = described
            .description
            .materials
            .iter()
            .any(|m| m.height_texture.is_some() && m.relief_depth > 0.0);
        assert_eq!(relief, asset.preparation_settings.relief_depth.is_some(), "{}", asset.name);
    }
    assert_eq!(faces, summary.distinct_faces);
    drop(dir);
}

#[test]
fn meshes_are_well_formed_as_written() {
    let (dir, summary) = small(1);
    let mut total = 0;
    let organic = ["lion.obj", "sage.obj", "dragon.obj", "boulder.obj"];
    for path in files(dir.path()).keys().filter(|n| n.ends_with(".obj")) {
        let mesh = parse(&dir.path().join(path));
        total += mesh.faces.len();
        assert!(mesh.normals.iter().all(|n| (n.length() - 1.0).abs() < 2e-5), "{path}: normal not unit");
        assert!(mesh.uvs.iter().all(|t| t.abs().max_element() <= 32.0), "{path}: uv out of range");
        let mut leaning = 0;
        let mut used = vec![false; mesh.positions.len()];
        for face in &mesh.faces {
            let [a, b, c] = face.map(|corner| mesh.positions[corner.0]);
            let normal = (b - a).cross(c - a);
            assert!(normal.length() > 1e-9, "{path}: degenerate face {face:?}");
            for (position, uv, normal_index) in face {
                used[*position] = true;
                assert!(uv.is_none_or(|uv| uv < mesh.uvs.len()));
                // Where a statue's tail is thinner than its faces are large, some faces may even fold over.
                let lean = mesh.normals[*normal_index].dot(normal.normalize());
                let least = if organic.contains(&path.as_str()) { -1.01 } else { 0.0 };
                assert!(lean > least, "{path}: normal points away from its face ({lean}): {face:?}");
                leaning += usize::from(lean < 0.3);
            }
        }
        assert!(used.iter().all(|u| *u), "{path}: unused vertex");
        assert!(leaning * 20 < mesh.faces.len() * 3, "{path}: {leaning} corners lean far");
    }
    assert_eq!(total, summary.distinct_faces);
    assert!((8_000..40_000).contains(&total), "{total} faces");
}

/// Checks that every directed edge occurs once and its reverse once, that there is one component, and that positions
/// are distinct.
fn assert_closed_manifold(mesh: &ObjMesh, name: &str) {
    let mut edges: HashMap<(u32, u32), u32> = HashMap::new();
    for face in mesh.groups.iter().flat_map(|group| &group.faces) {
        for k in 0..3 {
            *edges.entry((face[k].position, face[(k + 1) % 3].position)).or_default() += 1;
        }
    }
    for ((a, b), count) in &edges {
        assert!(*count == 1 && edges.contains_key(&(*b, *a)), "{name}: edge {a}-{b}");
    }
    let bits: BTreeSet<[u64; 3]> = mesh.positions.iter().map(|p| p.to_array().map(f64::to_bits)).collect();
    assert_eq!(bits.len(), mesh.positions.len(), "{name}: two vertices in one place");
    let euler = mesh.positions.len() as i64 - edges.len() as i64 / 2 + mesh.faces() as i64;
    assert!(euler <= 2 && euler % 2 == 0, "{name}: Euler characteristic {euler}");
}

#[test]
fn statues_are_closed_manifolds() {
    for seed in 1..3 {
        for (figure, name) in [
            (statues::lion(seed), "lion"),
            (statues::sage(seed), "sage"),
            (statues::dragon(seed), "dragon"),
            (statues::boulder(seed), "boulder"),
        ] {
            for cell in [0.2, 0.061] {
                assert_closed_manifold(&polygonise(&figure, cell), &format!("{name} {seed} {cell}"));
            }
        }
    }
}

#[test]
fn vertices_lie_on_the_solid_they_came_from() {
    let figure = statues::lion(3);
    let all = figure.all();
    let mesh = polygonise(&figure, 0.05);
    let mut far = 0;
    for p in &mesh.positions {
        far += usize::from(figure.distance(*p, &all).abs() > 0.012);
    }
    assert!(
        far * 50 < mesh.positions.len(),
        "{far} of {} vertices are off the surface",
        mesh.positions.len()
    );
}

#[test]
fn full_detail_has_its_face_counts() {
    let mut statues = Vec::new();
    let mut total = 0;
    for (name, _, _, make) in asset_rows(&Options::full(1)) {
        let mesh = make();
        total += mesh.faces();
        if ["lion", "sage", "dragon"].contains(&name) {
            assert_closed_manifold(&mesh, name);
            statues.push(mesh.faces());
        }
    }
    assert!(statues.iter().all(|faces| *faces >= 300_000), "{statues:?}");
    assert!(total >= 1_200_000, "{total}");
}

#[test]
fn base_meshes_of_buildings_have_small_errors() {
    let dir = tempfile::tempdir().unwrap();
    let buildings = ["stylobate", "roof", "cella", "plinth", "avenue"];
    for (name, _, _, make) in asset_rows(&Options::full(1)).into_iter().filter(|r| buildings.contains(&r.0)) {
        let (file, pack) = (dir.path().join(format!("{name}.obj")), dir.path().join(format!("{name}.lsp")));
        obj::write(&file, &make()).unwrap();
        prepare_to(&Asset::of_file(&file), &Default::default(), &pack).unwrap();
        let base = lodestream_store::PackFile::open(&pack).unwrap().base().unwrap();
        let error = base.geometric_error / base.diagonal;
        // Buildings have walls of a few large faces near other walls' corners. With four sample points per face the
        // error was 13 %.
        assert!(error <= 0.05, "{name}: {error} of the diagonal");
    }
}

#[test]
fn detail_out_of_range_and_impossible_folders_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    for detail in [0.0, 3.0, f64::NAN] {
        let refused = generate(dir.path(), &Options { seed: 1, detail });
        assert!(matches!(refused, Err(Error::Detail(_))), "{detail}");
    }
    let file = dir.path().join("file");
    std::fs::write(&file, "x").unwrap();
    assert!(matches!(generate(&file, &Options::small(1)), Err(Error::Write { .. })));
}

#[test]
fn the_site_is_level_and_the_valley_has_sides_for_every_seed() {
    for seed in 1..6 {
        let (_dir, summary) = small(seed);
        let terrain = lodestream_bake::scene::read(&summary.scene).unwrap().terrain.unwrap();
        let height = |x: f64, z: f64| terrain.height(x, z).unwrap();
        // Objects on the site are neither below the ground nor in the air.
        for i in -10..=10 {
            for z in [-20.0, 0.0, 14.0, 30.0, 47.0] {
                let ground = height(f64::from(i) * 1.3, z);
                assert!((ground + 0.04).abs() <= 0.011, "seed {seed}: {ground} at {i}, {z}");
            }
        }
        for z in [-800.0, 0.0, 800.0] {
            // Random offsets of the terrain around are up to 70 m.
            let sides = height(-800.0, z).min(height(900.0, z));
            assert!(sides > 25.0, "seed {seed}: {sides} at {z}");
        }
        assert!(height(0.0, -3100.0) > 200.0, "seed {seed}: no mountains: {}", height(0.0, -3100.0));
    }
}
