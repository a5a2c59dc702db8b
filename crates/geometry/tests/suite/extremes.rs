//! Extreme meshes: each is prepared and passes its check, or is refused with a reason.

use lodestream_geometry::base::Base;
use lodestream_geometry::check::check;
use lodestream_geometry::mesh::{Corner, QuantisedMesh, SourceMesh};
use lodestream_geometry::pool::Serial;
use lodestream_geometry::prepare::Prepared;
use lodestream_geometry::quantise::{QuantiseSettings, quantise};
use lodestream_geometry::{MeshError, Settings};

use crate::common::{bare, plain_faces, prepared, quantised, regions, shapes, with_bits};
use crate::invariants::deltas;

/// Prepares, checks, and returns the asset with its fully refined mesh.
pub(crate) fn survives(name: &str, mesh: &QuantisedMesh, region_faces: usize) -> Prepared {
    let asset = prepared(mesh, &regions(region_faces));
    let sets = if mesh.faces.len() < 5000 { 10 } else { 3 };
    let report = check(&asset.base, &asset.infos, &asset.chunks, sets, 3, &Serial).unwrap();
    assert_eq!((report.cracks, report.order_dependent, report.undo_errors), (0, 0, 0), "{name}");
    assert!(plain_faces(&deltas(&asset).0.to_mesh()) == plain_faces(mesh), "{name}");
    assert!(Base::decode(&asset.base.encode().unwrap()).unwrap() == asset.base, "{name}: base");
    for info in &asset.infos {
        assert!(info.error.is_finite() && info.sphere.radius.is_finite(), "{name}: {info:?}");
        assert!(info.sphere.center.iter().all(|x| x.is_finite()), "{name}: {info:?}");
    }
    asset
}

fn refused(source: &SourceMesh) -> MeshError {
    quantise(source, &QuantiseSettings::default()).unwrap_err()
}

#[test]
fn one_triangle() {
    survives(
        "triangle",
        &quantised(&bare(vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], &[[0, 1, 2]])),
        1000,
    );
}

#[test]
fn one_tetrahedron() {
    let corners = vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    survives("tetrahedron", &quantised(&bare(corners, &[[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])), 1000);
}

#[test]
fn one_cube() {
    survives("cube", &quantised(&shapes::cube(1.0)), 50);
}

#[test]
fn tiny_and_huge_coordinates() {
    for scale in [1e-30, 1e-10, 1e10, 1e30, 3e37] {
        let mesh = quantised(&shapes::placed(shapes::sphere(16, 24, 0.05), scale, 0.0));
        let asset = survives(&format!("scale {scale}"), &mesh, 200);
        assert!(asset.base.geometric_error > 0.0 && f64::from(asset.base.geometric_error) < scale, "{scale}");
        assert!(asset.infos.iter().any(|i| i.error > 0.0));
    }
}

#[test]
fn a_mesh_beyond_f32_range_is_refused() {
    let source = shapes::placed(shapes::sphere(8, 12, 0.0), 3e38, 0.0);
    assert!(matches!(refused(&source), MeshError::BadPrecision { .. }));
}

#[test]
fn millimetres_at_ten_million() {
    // A ball of one metre with two millimetres of relief.
    let source = shapes::placed(shapes::sphere(16, 24, 4e-3), 0.5, 1e7);
    let mesh = with_bits(&source, 16);
    let asset = survives("offset", &mesh, 200);
    assert!(mesh.grid.step < 1e-4 && asset.infos.iter().any(|i| i.error > 0.0));
    assert_eq!(mesh.positions.len(), source.positions.len());
    let full = deltas(&asset).0.to_mesh();
    let near = |p: &[f64; 3]| {
        let close = |q: [f64; 3]| (0..3).all(|k| (p[k] - q[k]).abs() < 1e-4);
        full.positions.iter().any(|&q| close(full.grid.position(q)))
    };
    assert!(source.positions.iter().all(near), "a vertex moved by a tenth of a millimetre");
}

#[test]
fn all_points_on_a_line() {
    let positions: Vec<[f64; 3]> = (0..400).map(|i| [f64::from(i), f64::from(2 * i), 0.0]).collect();
    let faces: Vec<[u32; 3]> = (0..398).map(|i| [i, i + 1, i + 2]).collect();
    for region_faces in [50, 1000] {
        survives("line", &quantised(&bare(positions.clone(), &faces)), region_faces);
    }
}

#[test]
fn all_points_equal() {
    let source = bare(vec![[1.0, 2.0, 3.0]; 9], &[[0, 1, 2], [3, 4, 5], [6, 7, 8]]);
    assert_eq!(refused(&source), MeshError::NoFaces { dropped: 3 });
}

#[test]
fn an_empty_mesh() {
    assert_eq!(refused(&SourceMesh::default()), MeshError::NoFaces { dropped: 0 });
}

#[test]
fn faces_that_name_one_vertex_twice_alone() {
    let source = bare(vec![[0.0; 3], [1.0, 0.0, 0.0]], &[[0, 1, 1], [0, 0, 0], [1, 0, 1]]);
    assert_eq!(refused(&source), MeshError::NoFaces { dropped: 3 });
}

#[test]
fn faces_without_area_among_good_ones() {
    let mut source = shapes::sphere(16, 24, 0.05);
    // A degenerate face between some edges and their midpoints, and slivers of repeated positions.
    for i in (0..source.faces.len()).step_by(5) {
        let [a, b, c] = source.faces[i];
        let [p, q] = [a, b].map(|corner| source.positions[corner.position as usize]);
        source.positions.push([0, 1, 2].map(|k| 0.5 * (p[k] + q[k])));
        let middle = Corner { position: source.positions.len() as u32 - 1, ..a };
        source.faces.extend([[a, middle, b], [a, a, c]]);
        source.materials.extend([0, 0]);
    }
    let mesh = quantised(&source);
    let good = 2 * 24 * 15;
    assert_eq!(mesh.faces.len(), good + good / 5, "only faces with a repeated vertex are dropped");
    survives("no area", &mesh, 200);
}

#[test]
fn every_face_twice_or_three_times() {
    let source = shapes::duplicates(shapes::sphere(16, 24, 0.02));
    let mesh = quantised(&source);
    assert_eq!(mesh.faces.len(), source.faces.len(), "duplicates are kept");
    survives("duplicates", &mesh, 200);
}

#[test]
fn an_edge_of_two_hundred_faces() {
    let mut positions = vec![[0.0, 0.0, 0.0], [0.0, 0.0, 1.0]];
    for i in 0..200 {
        let angle = std::f64::consts::TAU * f64::from(i) / 200.0;
        positions.push([angle.cos(), angle.sin(), 0.5]);
    }
    let faces: Vec<[u32; 3]> = (2..202).map(|leaf| [0, 1, leaf]).collect();
    survives("book", &quantised(&bare(positions, &faces)), 2000);
}

#[test]
fn a_vertex_where_two_thousand_sheets_meet() {
    let mut source = bare(vec![[0.0; 3]], &[]);
    for i in 0..2000 {
        let (angle, z) = (2.4 * f64::from(i), f64::from(i) / 1000.0 - 1.0);
        let r = (1.0 - z * z).max(0.0).sqrt();
        let tip = |turn: f64| [r * (angle + turn).cos(), r * (angle + turn).sin(), z];
        source.positions.extend([tip(0.0), tip(0.02)]);
        let corner = Corner::at;
        source.faces.push([corner(0), corner(2 * i + 1), corner(2 * i + 2)]);
        source.materials.push(0);
    }
    survives("sheets", &quantised(&source), 5000);
}

#[test]
fn points_apart_that_share_one_cell() {
    // The second sphere is far smaller than a cell: distinct vertices on one grid point.
    let small = shapes::placed(shapes::sphere(6, 8, 0.0), 1e-7, 0.0);
    let mesh = quantised(&shapes::join(shapes::sphere(16, 24, 0.02), &small, [2.0, 0.0, 0.0]));
    survives("one cell", &mesh, 200);
}

#[test]
fn points_that_differ_by_less_than_the_smallest_step() {
    let source = bare(vec![[0.0; 3], [5e-324, 0.0, 0.0], [0.0, 5e-324, 0.0]], &[[0, 1, 2]]);
    survives("subnormal", &quantised(&source), 1000);
}

#[test]
fn not_numbers_and_infinities_are_refused() {
    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e39] {
        for axis in 0..3 {
            let mut source = shapes::cube(1.0);
            source.positions[5][axis] = bad;
            assert!(matches!(refused(&source), MeshError::BadCoordinate { index: 5, .. }), "{bad}");
        }
        let mut source = shapes::torus(4, 5);
        source.uvs[7][1] = bad as f32;
        assert_eq!(refused(&source), MeshError::BadUv { index: 7 });
    }
}

#[test]
fn a_vertex_of_ten_thousand_faces() {
    let asset = survives("hub", &quantised(&shapes::hub(10_000)), 1000);
    assert!(asset.base.faces.len() < 2000, "{} faces", asset.base.faces.len());
}

#[test]
fn a_hub_inside_one_region() {
    survives("hub in a region", &quantised(&shapes::hub(1400)), 1000);
}

#[test]
fn the_last_material_is_refused_and_the_one_before_is_not() {
    let mut source = shapes::cube(1.0);
    source.materials[3] = u16::MAX;
    assert!(matches!(refused(&source), MeshError::TooLarge { kind: "materials", .. }));
    source.materials[3] = u16::MAX - 1;
    survives("materials", &quantised(&source), 1000);
}

#[test]
fn a_million_times_longer_than_wide() {
    for region_faces in [50, 200, 1000] {
        survives("needles", &with_bits(&shapes::needles(3000), 24), region_faces);
    }
}

#[test]
fn coarse_grids_merge_many_points() {
    for bits in [4, 6] {
        survives("coarse grid", &with_bits(&shapes::sphere(30, 40, 0.05), bits), 200);
    }
}

#[test]
fn many_tiny_components_alone() {
    for region_faces in [200, 1000] {
        survives("tetrahedra", &quantised(&shapes::dust(600)), region_faces);
    }
}

/// Components vanish or shrink to two faces back to back; all are restored.
fn tiny_components_survive(count: u32) {
    let mesh = with_bits(&shapes::dust(count), 12);
    let asset = prepared(&mesh, &Settings::default());
    assert!(asset.base.faces.len() <= 2 * count as usize, "{} faces", asset.base.faces.len());
    assert!(asset.base.geometric_error <= 0.05 * asset.base.diagonal, "{}", asset.base.geometric_error);
    assert!(plain_faces(&deltas(&asset).0.to_mesh()) == plain_faces(&mesh));
}

#[test]
fn four_thousand_tiny_components() {
    tiny_components_survive(4_000);
}

/// Four million faces: `cargo test --release -p lodestream-geometry --test suite -- --ignored a_million_tiny`.
#[test]
#[ignore = "takes minutes and gigabytes"]
fn a_million_tiny_components() {
    tiny_components_survive(1_000_000);
}

#[test]
fn regions_are_never_larger_than_their_decoder_accepts() {
    // Nearly three splits per face; in one region they would exceed a chunk's limit.
    let mesh = quantised(&shapes::soup(50_000));
    for top_regions in [1.5, 16.0] {
        let asset = prepared(
            &mesh,
            &Settings { region_faces: *Settings::REGION_FACES.end(), top_regions, ..Settings::default() },
        );
        let (mesh, _) = deltas(&asset);
        assert_eq!(mesh.face_count(), 50_000);
        assert!(asset.infos.iter().map(|i| i.vertices).max() > Some(40_000));
    }
}
