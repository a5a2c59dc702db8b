//! Meshes at the edges of what there is: each prepares and passes its check, or is refused by name.

use lodestream_geometry::base::Base;
use lodestream_geometry::check::check;
use lodestream_geometry::mesh::{QuantisedMesh, SourceMesh};
use lodestream_geometry::pool::Serial;
use lodestream_geometry::prepare::Prepared;
use lodestream_geometry::quantise::{QuantiseSettings, quantise};
use lodestream_geometry::{MeshError, Settings};

use crate::common::{bare, plain_faces, prepared, quantised, regions, shapes, with_bits};
use crate::promises::deltas;

/// Prepares, checks, and returns the asset with its fully refined mesh.
pub(crate) fn survives(name: &str, mesh: &QuantisedMesh, region_faces: usize) -> Prepared {
    let asset = prepared(mesh, &regions(region_faces));
    let report = check(&asset.base, &asset.infos, &asset.chunks, 10, 3, &Serial).unwrap();
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
        assert!(asset.base.root_error > 0.0 && f64::from(asset.base.root_error) < scale, "{scale}");
        assert!(asset.infos.iter().any(|i| i.error > 0.0));
    }
}

#[test]
fn a_mesh_longer_than_a_float_can_say_is_refused() {
    let source = shapes::placed(shapes::sphere(8, 12, 0.0), 3e38, 0.0);
    assert!(matches!(refused(&source), MeshError::BadPrecision { .. }));
}

#[test]
fn millimetres_at_ten_million() {
    let mesh = with_bits(&shapes::placed(shapes::sphere(16, 24, 0.05), 0.5, 1e7), 16);
    survives("offset", &mesh, 200);
    assert!(mesh.grid.step < 1e-4);
    let p = mesh.grid.position(mesh.positions[0]);
    assert!((p[0] - 1e7).abs() <= 0.6, "{p:?}");
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
fn nothing_at_all() {
    assert_eq!(refused(&SourceMesh::default()), MeshError::NoFaces { dropped: 0 });
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
fn coarse_grids_fold_everything_together() {
    for bits in [4, 6] {
        survives("coarse grid", &with_bits(&shapes::sphere(30, 40, 0.05), bits), 200);
    }
}

#[test]
fn many_tiny_components_alone() {
    let mut source = shapes::cube(0.1);
    for i in 1..600 {
        let at = [f64::from(i % 10), f64::from(i / 10 % 10), f64::from(i / 100)];
        source = shapes::join(source, &shapes::cube(0.1), at);
    }
    for region_faces in [200, 1000] {
        survives("cubes", &quantised(&source), region_faces);
    }
}

#[test]
fn regions_are_never_larger_than_their_decoder_accepts() {
    // Nearly three splits a face. In one region they would be more than one chunk may have.
    let asset = prepared(
        &quantised(&shapes::soup(50_000)),
        &Settings { region_faces: 1 << 30, ..Settings::default() },
    );
    let (mesh, _) = deltas(&asset);
    assert_eq!(mesh.face_count(), 50_000);
    assert!(asset.infos.iter().map(|i| i.vertices).max() > Some(40_000));
}
