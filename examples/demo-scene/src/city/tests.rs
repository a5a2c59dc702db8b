//! Tests of the city: bytes, counts, files that are imported as any user's.

use glam::{DVec2, DVec3};
use lodestream_bake::prepare::Threads;
use lodestream_import::gltf;

use super::facade::{self, Opening};
use super::materials;
use super::part::Part;
use super::*;
use crate::tests::{files, hash};

/// [`hash`] of all files of 300 parts of seed 7.
const GOLDEN: &str = "3da23c18f8d2e604e03ea145d6c8e43aed5555d365cd39db87622efdb9fce3ca";

fn small(seed: u64, parts: usize) -> (tempfile::TempDir, Summary) {
    let dir = tempfile::tempdir().unwrap();
    let summary = generate(dir.path(), &Options { seed, parts }).unwrap();
    (dir, summary)
}

#[test]
fn same_seed_same_bytes_and_the_golden_hash() {
    let ((first, summary), (second, _), (other, _)) = (small(7, 300), small(7, 300), small(8, 300));
    let first = files(first.path());
    assert_eq!(first, files(second.path()));
    assert_eq!(summary.bytes, first.values().map(|bytes| bytes.len() as u64).sum::<u64>());
    let other = files(other.path());
    for name in ["block-001.glb", "streets.glb", "plaster.png", "scene.toml"] {
        assert_ne!(first[name], other[name], "{name}");
    }
    assert_eq!(hash(&first), GOLDEN);
}

#[test]
fn a_city_has_as_many_parts_as_asked_for_and_two_hundred_faces_each() {
    for parts in [100, 1_000, 5_000] {
        let lots = chosen(&Options { seed: 1, parts });
        let mut streets = Streets::new(Glb::count(), 1);
        let mut houses = Glb::count();
        for lot in &lots {
            streets.add(lot);
            add(&mut houses, 0, lot);
        }
        let counted = streets.glb.parts + houses.parts;
        assert!((parts..parts + 200).contains(&counted), "{counted} of {parts}");
    }
    let (_dir, summary) = small(1, 1_000);
    assert!((1_000..1_200).contains(&summary.instances), "{}", summary.instances);
    let each = summary.instanced_faces / summary.instances;
    assert!((150..400).contains(&each), "{each} faces a part");
    // Some meshes are placed many times, most once.
    assert!(summary.assets < summary.instances && 2 * summary.assets > summary.instances);
}

#[test]
fn the_importer_reads_every_part_without_a_warning() {
    let (dir, summary) = small(3, 400);
    let (mut placed, mut faces) = (0, 0);
    for name in files(dir.path()).keys().filter(|name| name.ends_with(".glb")) {
        let path = dir.path().join(name);
        let contents = gltf::contents(&path, None).unwrap();
        placed += contents.placed.len();
        let imported = lodestream_import::import(&path).unwrap();
        assert_eq!(imported.warnings, Vec::<String>::new(), "{name}");
        faces += imported.mesh.faces.len();
        let described = lodestream_bake::prepare::describe::describe(
            name,
            &imported.materials,
            &Default::default(),
            &Threads::all_cores(),
        )
        .unwrap();
        assert_eq!(described.warnings, Vec::<String>::new(), "{name}");
        // Everything may be in a batch, but cars, of many materials, and large grounds.
        for (name, size) in contents.names.iter().zip(&contents.sizes) {
            assert!(size.is_some() || name.starts_with("car") || name == "square", "{name}");
        }
        // What is above the ground is on a block, and no part is lost far away.
        let far = imported.mesh.positions.iter().map(|at| DVec3::from(*at).length()).fold(0.0, f64::max);
        assert!(far < 400.0, "{name}: {far}");
    }
    assert_eq!((placed, faces), (summary.instances, summary.instanced_faces));
    let scene = lodestream_bake::scene::read(&summary.scene).unwrap();
    assert!(scene.assets.len() < 150, "{} assets", scene.assets.len());
}

#[test]
fn nodes_are_nested_and_have_names_and_extras() {
    let (dir, _) = small(1, 300);
    let bytes = std::fs::read(dir.path().join("block-001.glb")).unwrap();
    let length = u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
    let root: serde_json::Value = serde_json::from_slice(&bytes[20..20 + length]).unwrap();
    let node = |index: usize| &root["nodes"][index];
    let child = |parent: &serde_json::Value, start: &str| {
        let children = parent["children"].as_array().unwrap();
        let found = children.iter().map(|index| index.as_u64().unwrap() as usize);
        found.map(node).find(|node| node["name"].as_str().unwrap().starts_with(start)).unwrap()
    };
    let block = child(node(0), "block");
    let building = child(block, "building");
    assert!(building["extras"]["built"].as_u64().is_some_and(|year| (1870..1990).contains(&year)));
    let window = child(child(building, "floor 1"), "window");
    assert!(window["mesh"].is_u64() && window["extras"]["type"].is_string(), "{window}");
}

#[test]
fn faces_have_area_and_normals_on_their_side() {
    for seed in 0..3 {
        for lot in plan::lots(seed, 2).iter().step_by(7) {
            let mut glb = Glb::new("test");
            add(&mut glb, 0, lot);
            assert!(glb.parts > 20, "{lot:?}");
        }
    }
    let style = facade::Style {
        wall: 0,
        base: 11,
        trim: materials::named("trim pale"),
        frame: materials::named("paint white"),
        roof: materials::named("slate"),
        ornament: facade::Ornament::Corniced,
    };
    let parts = [
        facade::window(&style, [1.1, 1.9], true),
        facade::door(&style, [1.3, 3.1]),
        facade::cornice(&style, 11.0),
        facade::shop_front(&style, [8.0, 2.75], 5),
        facade::stairs(0, 2.0, 3),
        ledges::balcony(&style, 2.1, 0.8, true),
        ledges::balcony(&style, 2.1, 0.8, false),
        ledges::bay(&style, 2.8, 3.4),
        ledges::drainpipe(16.0),
        ledges::curtain_wall(0, 26.0, 3.6, 8),
        roof::pitched(&style, 11.0, 12.0, 0.7),
        roof::dormer(&style, 0.7),
        roof::chimney(3),
        street::lamp(),
        street::bench(),
        street::car(0, true),
        street::tree(3, 0, 8),
    ];
    for (number, part) in parts.iter().enumerate() {
        for surface in part.surfaces.values() {
            for face in &surface.faces {
                let [a, b, c] = face.map(|corner| surface.positions[usize::from(corner)]);
                let normal = (b - a).cross(c - a);
                assert!(normal.length() > 1e-9, "part {number}: a face without area at {a}");
                let lean: f64 =
                    face.iter().map(|&corner| surface.normals[usize::from(corner)].dot(normal)).sum();
                // Leaves point wherever they like.
                assert!(lean > 0.0 || number == parts.len() - 1, "part {number}: a normal turned in at {a}");
            }
        }
    }
}

#[test]
fn a_wall_has_the_area_that_its_openings_leave() {
    let openings = [Opening::new(-2.0, 0.9, [1.0, 1.5]), Opening::new(1.0, 0.0, [1.2, 2.1])];
    let wall = facade::wall(0, [-4.0, 4.0], 3.0, &openings);
    let area = |part: &Part, is_front: bool| -> f64 {
        let surface = &part.surfaces[&0];
        let faces =
            surface.faces.iter().map(|face| face.map(|corner| surface.positions[usize::from(corner)]));
        faces
            .map(|[a, b, c]| (b - a).cross(c - a) * 0.5)
            .filter(|normal| (normal.z > 1e-9) == is_front)
            .map(DVec3::length)
            .sum()
    };
    assert!((area(&wall, true) - (24.0 - 1.5 - 2.52)).abs() < 1e-9);
    // The door has no sill.
    let reveals = facade::REVEAL * (2.0 * (1.0 + 1.5) + 1.2 + 2.0 * 2.1);
    assert!((area(&wall, false) - reveals).abs() < 1e-9);
    assert_eq!(openings[0].low, DVec2::new(-2.5, 0.9));
}

#[test]
fn numbers_of_parts_out_of_range_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    for parts in [0, 99, 200_001] {
        let refused = generate(dir.path(), &Options { seed: 1, parts });
        assert!(matches!(refused, Err(Error::Parts(_))), "{parts}");
    }
}
