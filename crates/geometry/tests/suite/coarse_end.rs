//! Base meshes of difficult inputs: many components, holes, seams everywhere, high valences.

use std::collections::{BTreeMap, BTreeSet};

use lodestream_geometry::check::check;
use lodestream_geometry::mesh::{Face, QuantisedMesh, SourceMesh, Wedge};
use lodestream_geometry::pool::{Serial, Silent};
use lodestream_geometry::prepare::{Hooks, Prepared, prepare};
use lodestream_geometry::random::Random;
use lodestream_geometry::{Metric, Named as _, Settings};

use crate::common::{prepared, quantised, regions, shapes};

/// Prepares with the default settings, checks random ancestor-closed cuts, and requires a base error of at most 5 %.
fn prepare_and_check(name: &str, mesh: &QuantisedMesh, sets: usize) -> Prepared {
    let asset = prepared(mesh, &Settings::default());
    let report = check(&asset.base, &asset.infos, &asset.chunks, sets, 7, &Serial).unwrap();
    assert_eq!((report.cracks, report.order_dependent, report.undo_errors), (0, 0, 0), "{name}");
    let error = f64::from(asset.base.geometric_error / asset.base.diagonal);
    assert!(error <= 0.05, "{name}: {error} of the diagonal, {} faces", asset.base.faces.len());
    asset
}

/// Edges with one face, by vertices.
fn boundary(wedges: &[Wedge], faces: &[Face]) -> usize {
    let mut edges: BTreeMap<(u32, u32), usize> = BTreeMap::new();
    for face in faces {
        let corners = face.wedges.map(|w| wedges[w as usize].vertex);
        for k in 0..3 {
            let (a, b) = (corners[k], corners[(k + 1) % 3]);
            *edges.entry((a.min(b), a.max(b))).or_default() += 1;
        }
    }
    edges.values().filter(|&&faces| faces == 1).count()
}

#[test]
fn thirteen_hundred_components_have_a_small_base() {
    let mesh = quantised(&shapes::crowd(1299));
    assert!(mesh.faces.len() > 48_000 && mesh.faces.len() < 52_000, "{}", mesh.faces.len());
    let asset = prepare_and_check("crowd", &mesh, 4);
    assert!(asset.base.faces.len() <= 2000, "{} faces", asset.base.faces.len());
    let bytes = asset.base.encode().unwrap().len();
    assert!(bytes <= 12_000, "{bytes} bytes");
}

#[test]
fn large_thin_parts_keep_their_area() {
    let [width, height, thickness] = [1.5, 0.9, 0.03];
    let (columns, rows, layers, z) = (3, 4, 3, 2.0);
    let mut scene = shapes::crowd(200);
    // One behind the other, so each is near enough to stand for all of them.
    for wall in 0..columns * rows * layers {
        let (layer, wall) = (wall / (columns * rows), wall % (columns * rows));
        let at = [
            f64::from(wall % columns) * 1.7 - 2.5,
            f64::from(wall / columns) - 2.0,
            z + 0.06 * f64::from(layer),
        ];
        scene = shapes::join(scene, &shapes::slab([width, height, thickness]), at);
    }
    let base = prepare_and_check("walls", &quantised(&scene), 4).base;
    // Area of the base mesh seen along z at the walls' positions, which a coarse grid may move.
    let mut area = 0.0;
    for face in &base.faces {
        let [a, b, c] =
            face.wedges.map(|w| base.grid.position(base.positions[base.wedges[w as usize].vertex as usize]));
        if [a, b, c].iter().all(|p| (p[2] - z).abs() < 0.05 * f64::from(base.diagonal)) {
            area += 0.5 * ((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])).abs();
        }
    }
    let share = area / (2.0 * f64::from(columns * rows * layers) * width * height);
    assert!((0.9..1.2).contains(&share), "{share} of the walls is left, {} faces", base.faces.len());
    assert!(base.faces.len() <= 800, "{} faces", base.faces.len());
}

#[test]
fn holes_close() {
    let mesh = quantised(&shapes::perforated(60, 80));
    let before = boundary(&mesh.wedges, &mesh.faces);
    assert!(before > 500, "{before} boundary edges");
    let asset = prepare_and_check("holes", &mesh, 10);
    let after = boundary(&asset.base.wedges, &asset.base.faces);
    assert!(after * 7 < before, "{after} of {before} boundary edges are left");
    assert!(asset.base.faces.len() < 300, "{} faces", asset.base.faces.len());
}

#[test]
fn a_frigate_with_seams_everywhere_never_opens() {
    let mesh = quantised(&shapes::frigate(40));
    let mut wedges: BTreeMap<u32, BTreeSet<[i32; 2]>> = BTreeMap::new();
    for wedge in &mesh.wedges {
        wedges.entry(wedge.vertex).or_default().insert(wedge.attributes.uv);
    }
    let on_seams = wedges.values().filter(|uvs| uvs.len() > 1).count();
    assert!(on_seams * 10 > mesh.positions.len() * 9, "{on_seams} of {}", mesh.positions.len());
    assert_eq!(boundary(&mesh.wedges, &mesh.faces), 0);
    let asset = prepare_and_check("frigate", &mesh, 60);
    assert_eq!(boundary(&asset.base.wedges, &asset.base.faces), 0);
    assert!(asset.base.faces.len() * 10 < mesh.faces.len(), "{} faces", asset.base.faces.len());
}

#[test]
fn other_metrics_and_rounds_pass_the_check() {
    let meshes = [shapes::torus(40, 70), shapes::perforated(24, 30), shapes::frigate(6), shapes::crowd(40)];
    let (mut bytes, mut along_seams) = (BTreeSet::new(), BTreeSet::new());
    for source in &meshes {
        let mesh = quantised(source);
        for &metric in Metric::ALL {
            for round_share in [None, Some(0.05), Some(0.2)] {
                let settings = Settings { metric, round_share, ..regions(200) };
                let asset = prepared(&mesh, &settings);
                let report = check(&asset.base, &asset.infos, &asset.chunks, 6, 9, &Serial).unwrap();
                let found = (report.cracks, report.order_dependent, report.undo_errors);
                assert_eq!(found, (0, 0, 0), "{metric:?}, {round_share:?}");
                let of = if metric == Metric::ClusteringSeams { &mut along_seams } else { &mut bytes };
                of.insert(asset.chunks);
            }
        }
    }
    assert_eq!(bytes.len(), meshes.len() * 9, "a setting does nothing");
    // Not all of them have seams.
    assert!(along_seams.difference(&bytes).count() >= 3, "seams have no effect");
}

#[test]
fn the_top_is_one_chunk_of_as_many_faces_as_asked_for() {
    for source in [shapes::torus(40, 70), shapes::perforated(24, 30), shapes::crowd(40)] {
        let mesh = quantised(&source);
        let mut levels = Vec::new();
        for top_regions in [0.25, 1.0, 1.5, 4.0, 16.0] {
            let asset = prepared(&mesh, &Settings { top_regions, ..regions(200) });
            let report = check(&asset.base, &asset.infos, &asset.chunks, 6, 9, &Serial).unwrap();
            let found = (report.cracks, report.order_dependent, report.undo_errors);
            assert_eq!(found, (0, 0, 0), "{top_regions}");
            let error = f64::from(asset.base.geometric_error / asset.base.diagonal);
            assert!(error <= 0.05, "{top_regions}: {error} of the diagonal");
            let coarsest: Vec<_> = asset.infos.iter().filter(|i| i.parents.is_empty()).collect();
            assert_eq!(coarsest.len(), 1, "{top_regions}");
            let faces = asset.base.faces.len() + coarsest[0].faces as usize;
            let merged = (top_regions * 200.0) as usize;
            assert!(faces <= merged.max(400), "{top_regions}: {faces} faces after the first chunk");
            levels.push(asset.base.level_count);
        }
        assert!(levels.is_sorted_by(|a, b| a >= b) && levels[0] > levels[4], "{levels:?}");
    }
}

#[test]
fn settings_out_of_range_are_refused_by_name() {
    let mesh = quantised(&shapes::torus(20, 30));
    let refused = |settings: Settings| {
        prepare(&mesh, &settings, &Hooks::new(&Serial, &Silent)).unwrap_err().to_string()
    };
    let top = |top_regions| refused(Settings { top_regions, ..regions(50) });
    assert_eq!(top(-1.0), "top regions -1 is out of range: 0.25 to 16");
    assert_eq!(top(f64::NAN), "top regions NaN is out of range: 0.25 to 16");
    assert_eq!(refused(regions(49)), "region faces 49 is out of range: 50 to 20000");
}

/// Slabs, posts and tubes in rows, of sizes that vary; each is a part.
fn building(parts: u32) -> SourceMesh {
    let mut random = Random::new(21);
    let mut mesh = SourceMesh::default();
    for part in 0..parts {
        let size = 0.4 + 1.2 * random.unit();
        let shape = match part % 3 {
            0 => shapes::slab([2.4 * size, 2.0 * size, 0.2]),
            1 => shapes::slab([0.15, 0.15, 2.7 * size]),
            _ => shapes::placed(shapes::torus(12, 6), 0.5 * size, 0.0),
        };
        let faces = shape.faces.len();
        let at = [f64::from(part % 20) * 5.0, f64::from(part / 20) * 5.0, f64::from(part % 7) * 0.3];
        mesh = shapes::join(mesh, &shape, at);
        mesh.parts.extend(vec![part; faces]);
    }
    mesh
}

/// For each part of an input: the diagonal of its box, and that in the base mesh as a share of it, 0 where the part has
/// vanished.
fn sizes_left(mesh: &QuantisedMesh, asset: &Prepared) -> (Vec<f64>, Vec<f64>) {
    let diagonals = |positions: &[[i32; 3]], parts: &[u32]| {
        let mut bounds: BTreeMap<u32, [[i32; 3]; 2]> = BTreeMap::new();
        for (position, &part) in positions.iter().zip(parts) {
            let [low, high] = bounds.entry(part).or_insert([*position; 2]);
            for axis in 0..3 {
                low[axis] = low[axis].min(position[axis]);
                high[axis] = high[axis].max(position[axis]);
            }
        }
        let diagonal = |[low, high]: &[[i32; 3]; 2]| {
            (0..3).map(|axis| f64::from(high[axis] - low[axis]).powi(2)).sum::<f64>().sqrt()
        };
        bounds.iter().map(|(part, bounds)| (*part, diagonal(bounds))).collect::<BTreeMap<u32, f64>>()
    };
    let left = diagonals(&asset.base.positions, &asset.base.parts);
    let whole = diagonals(&mesh.positions, &mesh.parts);
    let share = |(part, whole): (&u32, &f64)| left.get(part).copied().unwrap_or(0.0) / whole;
    (whole.values().copied().collect(), whole.iter().map(share).collect())
}

#[test]
fn parts_keep_their_size_or_vanish() {
    let source = building(500);
    let mesh = quantised(&source);
    let asset = prepare_and_check("building", &mesh, 4);
    let (diagonals, sizes_left) = sizes_left(&mesh, &asset);
    let sizes = &sizes_left;
    let torn = sizes.iter().filter(|&&size| size > 0.0 && size < 0.75).count();
    let left = sizes.iter().filter(|&&size| size > 0.0).count();
    assert!(torn * 50 <= left, "{torn} of {left} parts are fragments");
    assert!((100..400).contains(&left), "{left} parts are left");
    // The largest slabs stay before the smallest.
    let slabs = |sizes: &dyn Fn(f64) -> bool| {
        let of = (0..500).step_by(3).filter(|&part| sizes(diagonals[part]));
        let left: Vec<f64> = of.map(|part| f64::from(u8::from(sizes_left[part] > 0.0))).collect();
        left.iter().sum::<f64>() / left.len() as f64
    };
    let mut sorted: Vec<f64> = diagonals.iter().copied().step_by(3).collect();
    sorted.sort_by(f64::total_cmp);
    let [low, high] = [sorted[sorted.len() / 3], sorted[sorted.len() * 2 / 3]];
    let (small, large) = (slabs(&|size| size < low), slabs(&|size| size > high));
    assert!(large > 1.5 * small, "{large} of the large slabs are left, {small} of the small ones");
}

/// A street of houses of a wall for each side and storey, with mouldings as long as the walls and windows before them, each
/// a part: first the walls.
fn street(houses: u32) -> (SourceMesh, u32) {
    let mut shapes_at: Vec<([f64; 3], [f64; 3])> = Vec::new();
    let sides = || {
        (0..houses)
            .flat_map(|house| (0..4).flat_map(move |storey| (0..2).map(move |side| (house, storey, side))))
    };
    for (house, storey, side) in sides() {
        let [x, y, z] = [14.0 * f64::from(house), 3.0 * f64::from(storey), 9.0 * f64::from(side)];
        shapes_at.push(([9.6, 2.9, 0.2], [x, y, z]));
        shapes_at.push(([0.2, 2.9, 8.6], [x - 4.8 + 9.6 * f64::from(side), y, 4.5]));
    }
    let walls = shapes_at.len() as u32;
    for (house, storey, side) in sides() {
        let out = f64::from(2 * side - 1);
        let [x, y, z] = [14.0 * f64::from(house), 3.0 * f64::from(storey), 9.0 * f64::from(side)];
        shapes_at.push(([10.4, 0.15, 0.3], [x, y + 1.5, z + 0.3 * out]));
        for window in 0..6 {
            shapes_at.push(([0.9, 1.4, 0.1], [x - 4.0 + 1.6 * f64::from(window), y, z + 0.3 * out]));
        }
    }
    let mut mesh = SourceMesh::default();
    for (part, (size, at)) in (0..).zip(shapes_at) {
        let shape = shapes::slab(size);
        mesh = shapes::join(mesh, &shape, at);
        mesh.parts.extend(vec![part; shape.faces.len()]);
    }
    (mesh, walls)
}

#[test]
fn walls_stay_although_mouldings_are_near() {
    let (source, walls) = street(7);
    let mesh = quantised(&source);
    let asset = prepare_and_check("street", &mesh, 4);
    // Each wall is within it of mouldings.
    let limit = 0.042 * f64::from(asset.base.diagonal);
    assert!(limit > 3.0, "{limit}");
    let (_, left) = sizes_left(&mesh, &asset);
    let (of_walls, others) = left.split_at(walls as usize);
    let torn = of_walls.iter().filter(|&&size| size < 0.9).count();
    assert_eq!(torn, 0, "of {walls} walls");
    let others_left = others.iter().filter(|&&size| size > 0.0).count();
    assert!(others_left * 10 < others.len(), "{others_left} of {}", others.len());
}
