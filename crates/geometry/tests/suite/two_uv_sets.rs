//! A second set of texture coordinates: coded exactly, the same in any order of chunks, with seams and errors of its
//! own, and free for meshes without one.

use std::collections::BTreeSet;

use lodestream_geometry::base::Base;
use lodestream_geometry::check::check;
use lodestream_geometry::mesh::{Corner, MAX_UV_BITS, NONE, SourceMesh, UvGrid};
use lodestream_geometry::pool::Serial;
use lodestream_geometry::prepare::{Prepared, suit};
use lodestream_geometry::quantise::{QuantiseSettings, quantise};
use lodestream_geometry::refine::ActiveMesh;
use lodestream_geometry::{Codec, MeshError, Settings};

use crate::common::{
    in_blocks, plain_faces, prepared, quantised, regions, shapes, with_bits, with_truncation_points,
};
use crate::invariants::deltas;

fn lightmapped() -> SourceMesh {
    shapes::lightmapped(shapes::torus(30, 50), 2)
}

/// The mesh without its first set.
fn only_second(mut mesh: SourceMesh) -> SourceMesh {
    mesh.uvs.clear();
    mesh.faces.iter_mut().flatten().for_each(|corner| corner.uv = NONE);
    mesh
}

/// The mesh without its second set.
fn only_first(mut mesh: SourceMesh) -> SourceMesh {
    mesh.second_uvs.clear();
    mesh.faces.iter_mut().flatten().for_each(|corner| corner.second_uv = NONE);
    mesh
}

fn bytes_of(asset: &Prepared) -> usize {
    asset.base.encode().unwrap().len() + asset.chunks.iter().map(Vec::len).sum::<usize>()
}

#[test]
fn all_chunks_together_give_both_sets_back_in_each_codec() {
    for source in [lightmapped(), only_second(lightmapped()), shapes::lightmapped(shapes::frigate(12), 2)] {
        for codec in [Codec::Range, Codec::Zstd, Codec::AxisAligned] {
            let mut mesh = quantised(&source);
            suit(&mut mesh, codec);
            assert!(mesh.second_uv_grid.bits > 0);
            for settings in [with_truncation_points(300), in_blocks(600, regions(100))] {
                let asset = prepared(&mesh, &Settings { codec, ..settings });
                assert!(asset.chunks.len() > 2);
                let base = Base::decode(&asset.base.encode().unwrap()).unwrap();
                assert!(base == asset.base, "{codec}");
                let (active, _) = deltas(&Prepared { base, ..asset });
                assert!(active.has_second_uvs());
                let full = active.to_mesh();
                assert!(plain_faces(&full) == plain_faces(&mesh), "{codec}");
                assert_eq!((full.uv_grid, full.second_uv_grid), (mesh.uv_grid, mesh.second_uv_grid));
            }
        }
    }
}

#[test]
fn each_set_has_seams_where_the_other_has_none() {
    let mesh = quantised(&lightmapped());
    let distinct = |key: &dyn Fn(&lodestream_geometry::mesh::Wedge) -> [i32; 2]| {
        mesh.wedges.iter().map(|w| (w.vertex, key(w))).collect::<BTreeSet<_>>().len()
    };
    let first = distinct(&|w| w.attributes.uv);
    let second = distinct(&|w| w.attributes.second_uv.map(i32::from));
    let (vertices, both) = (mesh.positions.len(), mesh.wedges.len());
    assert!(first > vertices + 50 && second > vertices + 50, "{vertices} {first} {second}");
    assert!(both > first + 50 && both > second + 20, "{both} {first} {second}");
}

/// Every face around a vertex is a chart of the second set, while the first has no seam there.
#[test]
fn a_chart_for_every_face_around_a_vertex_comes_back() {
    let mut source = shapes::hub(300);
    let side = 1.0 / (source.faces.len() * 3) as f32;
    source.uvs = source.positions.iter().map(|p| [p[0] as f32, p[1] as f32]).collect();
    for corner in source.faces.iter_mut().flatten() {
        corner.uv = corner.position;
        corner.second_uv = source.second_uvs.len() as u32;
        source.second_uvs.push([corner.second_uv as f32 * side, 0.5]);
    }
    let mesh = quantise(&source, &QuantiseSettings { uv_bits: 16, ..QuantiseSettings::default() }).unwrap();
    assert_eq!(mesh.wedges.len(), mesh.faces.len() * 3);
    for codec in [Codec::Range, Codec::Zstd] {
        let asset = prepared(&mesh, &Settings { codec, ..regions(1000) });
        assert!(plain_faces(&deltas(&asset).0.to_mesh()) == plain_faces(&mesh), "{codec}");
    }
}

#[test]
fn both_sets_depend_on_the_cut_alone() {
    for source in [lightmapped(), only_second(lightmapped())] {
        let asset = prepared(&quantised(&source), &with_truncation_points(300));
        let report = check(&asset.base, &asset.infos, &asset.chunks, 12, 5, &Serial).unwrap();
        assert_eq!((report.cracks, report.order_dependent, report.undo_errors), (0, 0, 0));
    }
}

#[test]
fn a_renderer_gets_the_coordinates_of_the_source() {
    let source = lightmapped();
    let mesh = quantise(&source, &QuantiseSettings { uv_bits: MAX_UV_BITS, ..QuantiseSettings::default() });
    let (active, _) = deltas(&prepared(&mesh.unwrap(), &regions(300)));
    let cells = |uv: [f32; 2]| uv.map(|x| (f64::from(x) * 1e3).round() as i32);
    let meant: BTreeSet<_> = source.second_uvs.iter().copied().map(cells).collect();
    let near = |[u, v]: [i32; 2]| (-1..=1).any(|x| (-1..=1).any(|y| meant.contains(&[u + x, v + y])));
    let faces = (0..active.material_count()).flat_map(|m| active.indices(m)).filter(|face| **face != [0; 3]);
    let mut seen = BTreeSet::new();
    for &slot in faces.flatten() {
        let shown = cells(active.render_vertex(slot).second_uv);
        assert!(near(shown), "{shown:?}");
        seen.insert(shown);
    }
    assert!(seen.len() * 2 > meant.len(), "{} of {}", seen.len(), meant.len());
}

#[test]
fn a_mesh_without_a_second_set_has_none_and_pays_nothing() {
    let plain = shapes::torus(30, 50);
    let mut unused = plain.clone();
    unused.second_uvs = vec![[0.25, 0.75]];
    let [plain, unused] = [plain, unused].map(|source| prepared(&quantised(&source), &regions(200)));
    assert!(plain == unused);
    assert_eq!(plain.base.second_uv_grid, UvGrid::NONE);
    let active = ActiveMesh::new(&plain.base);
    assert!(!active.has_second_uvs());
    assert_eq!(active.render_vertex(0).second_uv, [0.0; 2]);
}

#[test]
fn a_second_set_equal_to_the_first_costs_less_than_the_first() {
    let first = shapes::torus(60, 40);
    let mut twice = first.clone();
    twice.second_uvs.clone_from(&twice.uvs);
    twice.faces.iter_mut().flatten().for_each(|corner| corner.second_uv = corner.uv);
    let mut none = first.clone();
    none.uvs.clear();
    none.faces.iter_mut().flatten().for_each(|corner| corner.uv = NONE);
    let [none, first, twice] =
        [none, first, twice].map(|source| bytes_of(&prepared(&quantised(&source), &regions(1000))));
    assert!(first > none && twice > first && twice - first <= first - none, "{none} {first} {twice}");
}

/// Many seams of one set alone: without sharing, each of their wedges would cost both sets' coordinates.
#[test]
fn seams_of_one_set_leave_the_other_cheap() {
    let source = shapes::lightmapped(shapes::torus(60, 40), 4);
    let bytes = |source: &SourceMesh| bytes_of(&prepared(&quantised(source), &regions(1000)));
    let none = bytes(&only_first(only_second(source.clone())));
    let (first, second) = (bytes(&only_first(source.clone())), bytes(&only_second(source.clone())));
    let (both, sum) = (bytes(&source) - none, first + second - 2 * none);
    assert!(both * 100 < sum * 115, "both sets take {both} bytes, each alone {sum} together");
}

/// Largest attribute error, in shares of its side, of a flat square whose sets are mapped by the given functions.
fn attribute_error(first: fn(f32, f32) -> [f32; 2], second: Option<fn(f32, f32) -> [f32; 2]>) -> f64 {
    let mut mesh = SourceMesh::default();
    for (y, x) in (0..=40_u8).flat_map(|y| (0..=40_u8).map(move |x| (y, x))) {
        let (s, t) = (f32::from(x) / 40.0, f32::from(y) / 40.0);
        mesh.positions.push([s.into(), t.into(), 0.0]);
        mesh.uvs.push(first(s, t));
        mesh.second_uvs.extend(second.map(|map| map(s, t)));
    }
    for i in (0..40).flat_map(|y| (0..40).map(move |x| y * 41 + x)) {
        for face in [[i, i + 1, i + 42], [i, i + 42, i + 41]] {
            let second_uv = |v| if second.is_some() { v } else { NONE };
            mesh.faces.push(face.map(|v| Corner { uv: v, second_uv: second_uv(v), ..Corner::at(v) }));
            mesh.materials.push(0);
        }
    }
    let asset = prepared(&quantised(&mesh), &regions(400));
    assert!(asset.infos.len() > 2);
    asset.infos.iter().map(|info| f64::from(info.attribute_error)).fold(0.0, f64::max)
}

#[test]
fn a_distorted_second_set_is_an_attribute_error() {
    let (even, distorted) = (|s, t| [s, t], |s: f32, t| [s * s * s, t]);
    let none = attribute_error(even, None);
    assert!(none < 2e-3, "{none}");
    assert!(attribute_error(even, Some(even)) < 2e-3);
    let (second, first) = (attribute_error(even, Some(distorted)), attribute_error(distorted, None));
    assert!(second > 0.01 && (second / first - 1.0).abs() < 0.5, "{second} {first}");
}

#[test]
fn texture_bits_hold_for_both_sets() {
    for bits in [1, 9, MAX_UV_BITS] {
        let settings = QuantiseSettings { uv_bits: bits, ..QuantiseSettings::default() };
        let mesh = quantise(&lightmapped(), &settings).unwrap();
        assert_eq!((mesh.uv_grid.bits, mesh.second_uv_grid.bits), (bits, bits));
        let top = (1_u32 << bits) - 1;
        let most = mesh.wedges.iter().flat_map(|w| w.attributes.second_uv).max().unwrap();
        assert_eq!(u32::from(most), top);
        let asset = prepared(&mesh, &regions(300));
        assert!(plain_faces(&deltas(&asset).0.to_mesh()) == plain_faces(&mesh), "{bits} bits");
    }
}

#[test]
fn bad_second_coordinates_are_refused() {
    let mut source = lightmapped();
    source.second_uvs[7] = [0.5, f32::NAN];
    let refused = |source: &SourceMesh| quantise(source, &QuantiseSettings::default()).unwrap_err();
    assert_eq!(refused(&source), MeshError::BadUv { index: 7 });
    let mut source = lightmapped();
    source.faces[3][1].second_uv = source.second_uvs.len() as u32;
    assert!(matches!(refused(&source), MeshError::BadIndex { face: 3, kind: "second uv", .. }));
}

#[test]
fn grids_of_two_sets_out_of_range_are_refused() {
    let asset = prepared(&with_bits(&shapes::lightmapped(shapes::torus(9, 11), 1), 12), &regions(50));
    let bytes = asset.base.encode().unwrap();
    // Version, position bits, attributes, levels, shifts, and the grid of the positions precede the bits of both sets.
    let at = 5 + usize::from(asset.base.level_count).div_ceil(2) + 32;
    assert_eq!(bytes[2] & 0x1f, 0x1f);
    assert_eq!(bytes[at..at + 2], [asset.base.uv_grid.bits, asset.base.second_uv_grid.bits]);
    for (place, value) in [(at, 17), (at + 1, 17), (at + 1, 0), (at + 1, 255), (2, 0x11), (2, 0x1e)] {
        let mut damaged = bytes.clone();
        damaged[place] = value;
        let why = Base::decode(&damaged).unwrap_err().to_string();
        assert!(why.contains("out of range"), "{place} {value}: {why}");
    }
    // The second grid is checked as the first.
    let mut damaged = bytes;
    damaged[at + 2 + 32..at + 2 + 40].copy_from_slice(&1e300_f64.to_le_bytes());
    let why = Base::decode(&damaged).unwrap_err().to_string();
    assert!(why.contains("beyond 32-bit"), "{why}");
}
