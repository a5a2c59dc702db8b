//! Quantisation: welding, dropping, snapping, normal groups, errors.

use lodestream_geometry::MeshError;
use lodestream_geometry::mesh::{Attributes, Corner, NONE, QuantisedMesh, SourceMesh};
use lodestream_geometry::quantise::{Precision, QuantiseSettings, quantise};

use crate::common::{all, bare, quantised, shapes};

fn with(source: &SourceMesh, precision: Precision) -> Result<QuantisedMesh, MeshError> {
    quantise(source, &QuantiseSettings { precision, ..QuantiseSettings::default() })
}

/// Largest distance between a corner's source position and its grid point, for meshes without dropped elements.
fn farthest(source: &SourceMesh, mesh: &QuantisedMesh) -> f64 {
    assert_eq!(source.faces.len(), mesh.faces.len());
    let mut worst = 0.0_f64;
    for (from, to) in source.faces.iter().zip(&mesh.faces) {
        for (corner, wedge) in from.iter().zip(to.wedges) {
            let p = source.positions[corner.position as usize];
            let vertex = mesh.wedges[wedge as usize].vertex;
            let q = mesh.grid.position(mesh.positions[vertex as usize]);
            worst = worst.max((0..3).map(|i| (p[i] - q[i]).powi(2)).sum::<f64>().sqrt());
        }
    }
    worst
}

#[test]
fn equal_positions_are_welded_and_unused_ones_dropped() {
    let source = bare(
        vec![[9.0; 3], [0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-0.0, 0.0, -0.0], [0.0, -1.0, 0.0]],
        &[[1, 2, 3], [4, 5, 2]],
    );
    let mesh = quantised(&source);
    assert_eq!((mesh.positions.len(), mesh.wedges.len(), mesh.faces.len()), (4, 4, 2));
    // The unused corner at (9, 9, 9) does not extend the grid.
    assert_eq!(mesh.grid.origin, [0.0, -1.0, 0.0]);
}

#[test]
fn faces_with_a_repeated_vertex_are_dropped() {
    let corners = vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]];
    let mesh = quantised(&bare(corners.clone(), &[[0, 1, 1], [0, 1, 3], [0, 1, 2], [2, 2, 2]]));
    assert_eq!(mesh.faces.len(), 1);
    let none = quantise(&bare(corners, &[[0, 1, 3]]), &QuantiseSettings::default());
    assert_eq!(none, Err(MeshError::NoFaces { dropped: 1 }));
}

#[test]
fn remaining_elements_are_used_and_on_the_grid() {
    for (name, source) in all() {
        let mesh = quantised(&source);
        let mut used = vec![false; mesh.wedges.len()];
        for face in &mesh.faces {
            let v = face.wedges.map(|w| mesh.wedges[w as usize].vertex);
            assert!(v[0] != v[1] && v[1] != v[2] && v[0] != v[2], "{name}");
            face.wedges.iter().for_each(|&w| used[w as usize] = true);
        }
        assert!(used.iter().all(|&u| u), "{name}: a wedge is not used");
        let mut vertices = vec![false; mesh.positions.len()];
        mesh.wedges.iter().for_each(|w| vertices[w.vertex as usize] = true);
        assert!(vertices.iter().all(|&u| u), "{name}: a vertex is not used");
        assert!(mesh.positions.iter().flatten().all(|x| (0..1 << mesh.grid.bits).contains(x)), "{name}");
        let mut sorted = mesh.wedges.clone();
        sorted.sort_unstable();
        assert!(sorted.windows(2).all(|w| w[0] != w[1]), "{name}: two equal wedges");
    }
}

#[test]
fn a_tolerance_is_kept_with_the_fewest_bits() {
    let source = shapes::sphere(20, 30, 0.1);
    for tolerance in [0.003, 1e-3, 1e-4, 1e-6, 2e-7] {
        let mesh = with(&source, Precision::Tolerance(tolerance)).unwrap();
        let far = farthest(&source, &mesh);
        assert!(far <= tolerance * (1.0 + 1e-9), "{far} > {tolerance}");
        assert!(far > tolerance / 8.0, "{} bits for {tolerance}: {far}", mesh.grid.bits);
    }
    for bad in [0.0, -1.0, f64::NAN, f64::INFINITY, 1e-9] {
        let error = with(&source, Precision::Tolerance(bad)).unwrap_err();
        assert!(matches!(error, MeshError::BadPrecision { .. }), "{bad}: {error}");
    }
}

#[test]
fn bits_are_kept_and_limited() {
    let source = shapes::sphere(20, 30, 0.1);
    for bits in 4..=24 {
        let mesh = with(&source, Precision::Bits(bits)).unwrap();
        assert_eq!(mesh.grid.bits, bits);
        assert!(farthest(&source, &mesh) <= mesh.grid.step * 0.5 * 3.0_f64.sqrt() * (1.0 + 1e-9));
        assert_eq!(mesh.positions.iter().flatten().max(), Some(&((1 << bits) - 1)));
    }
    for bits in [0, 1, 3, 25, 31, 32, 255] {
        assert!(
            matches!(with(&source, Precision::Bits(bits)), Err(MeshError::BadPrecision { .. })),
            "{bits}"
        );
    }
}

#[test]
fn texture_coordinates_are_within_half_a_step() {
    let source = shapes::torus(20, 30);
    for uv_bits in [1, 8, 12, 16] {
        let settings = QuantiseSettings { uv_bits, ..QuantiseSettings::default() };
        let mesh = quantise(&source, &settings).unwrap();
        for (from, to) in source.faces.iter().zip(&mesh.faces) {
            for (corner, wedge) in from.iter().zip(to.wedges) {
                let uv = source.uvs[corner.uv as usize];
                let got = mesh.uv_grid.uv(mesh.wedges[wedge as usize].attributes.uv);
                for axis in 0..2 {
                    let off = (f64::from(uv[axis]) - got[axis]).abs();
                    assert!(off <= mesh.uv_grid.step[axis] * 0.5000001, "{uv_bits} bits: {off}");
                }
            }
        }
    }
}

#[test]
fn a_mesh_without_texture_coordinates_has_no_uv_grid() {
    let mesh = quantised(&shapes::cube(1.0));
    assert_eq!(mesh.uv_grid.bits, 0);
    assert!(mesh.wedges.iter().all(|w| w.attributes == Attributes::default()));
}

#[test]
fn seams_make_wedges_and_not_vertices() {
    let mesh = quantised(&shapes::torus(20, 30));
    assert_eq!(mesh.positions.len(), 600);
    assert_eq!(mesh.wedges.len(), 21 * 31);
    let flat = quantised(&shapes::flat_shaded(shapes::cube(1.0)));
    assert_eq!((flat.positions.len(), flat.wedges.len()), (8, 24));
}

#[test]
fn normals_within_a_degree_share_a_group() {
    let mut source =
        bare(vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]], &[[0, 1, 2], [0, 2, 3]]);
    for (degrees, wedges) in [(0.5_f32, 4), (1.5, 6), (90.0, 6)] {
        let angle = degrees.to_radians();
        // Only directions matter, not lengths.
        source.normals = vec![[0.0, 0.0, 1.0], [3.0 * angle.sin(), 0.0, 3.0 * angle.cos()]];
        for (face, corners) in source.faces.iter_mut().enumerate() {
            corners.iter_mut().for_each(|c| c.normal = face as u32);
        }
        assert_eq!(quantised(&source).wedges.len(), wedges, "{degrees} degrees");
    }
    // Zero, missing and non-finite normals form one group, separate from valid ones.
    source.normals = vec![[0.0; 3], [f32::NAN, 0.0, 0.0]];
    assert_eq!(quantised(&source).wedges.len(), 4);
    source.faces[0].iter_mut().for_each(|c| c.normal = NONE);
    assert_eq!(quantised(&source).wedges.len(), 4);
    source.normals[1] = [0.0, 0.0, 1.0];
    assert_eq!(quantised(&source).wedges.len(), 6);
}

#[test]
fn indices_out_of_range_are_named() {
    let base = shapes::torus(4, 5);
    let change = |f: &dyn Fn(&mut Corner)| {
        let mut source = base.clone();
        f(&mut source.faces[7][1]);
        quantise(&source, &QuantiseSettings::default()).unwrap_err()
    };
    for (error, kind) in [
        (change(&|c| c.position = 20), "position"),
        (change(&|c| c.position = NONE), "position"),
        (change(&|c| c.uv = 30), "uv"),
        (change(&|c| c.normal = 0), "normal"),
    ] {
        assert!(matches!(error, MeshError::BadIndex { face: 7, kind: k, .. } if k == kind), "{error}");
    }
}
