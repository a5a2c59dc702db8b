//! Skins: coded exactly, the same in any order of chunks, and measured in their poses.

use lodestream_geometry::Codec;
use lodestream_geometry::base::Base;
use lodestream_geometry::check::check;
use lodestream_geometry::mesh::skin::{Pose, Skin};
use lodestream_geometry::mesh::{Corner, QuantisedMesh, SourceMesh};
use lodestream_geometry::pool::Serial;
use lodestream_geometry::refine::ActiveMesh;

use crate::common::{prepared, quantised, with_truncation_points};

/// A straight tube of rings along z from 0 to 4, of joints 0 to 4 a unit apart whose weights fall linearly.
fn tube(rings: u32, around: u32) -> SourceMesh {
    let mut mesh = SourceMesh::default();
    for i in 0..=rings {
        let z = 4.0 * f64::from(i) / f64::from(rings);
        for j in 0..around {
            let turn = std::f64::consts::TAU * f64::from(j) / f64::from(around);
            mesh.positions.push([0.3 * turn.cos(), 0.3 * turn.sin(), z]);
            let (low, share) = ((z as u8).min(3), z - f64::from((z as u8).min(3)));
            mesh.skins.push(Skin::new([(low, 1.0 - share), (low + 1, share)]));
        }
    }
    let at = |i: u32, j: u32| Corner::at(i * around + j % around);
    for (i, j) in (0..rings).flat_map(|i| (0..around).map(move |j| (i, j))) {
        let [a, b, c, d] = [at(i, j), at(i, j + 1), at(i + 1, j + 1), at(i + 1, j)];
        mesh.faces.extend([[a, b, c], [a, c, d]]);
    }
    mesh.materials = vec![0; mesh.faces.len()];
    mesh
}

/// Joint 3 and those above it turned by `angle` about the x axis, at z = 3.
fn bent(angle: f64) -> Pose {
    let (sin, cos) = angle.sin_cos();
    let still = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]];
    let turned = [[1.0, 0.0, 0.0, 0.0], [0.0, cos, -sin, 3.0 * sin], [0.0, sin, cos, 3.0 - 3.0 * cos]];
    vec![still, still, still, turned, turned]
}

/// Positions with their skins, sorted.
fn skins(mesh: &QuantisedMesh) -> Vec<([i32; 3], Skin)> {
    let mut all: Vec<_> = mesh.positions.iter().copied().zip(mesh.skins.iter().copied()).collect();
    all.sort_unstable();
    all
}

#[test]
fn all_chunks_together_give_every_skin_in_each_codec() {
    let mesh = quantised(&tube(60, 24));
    for codec in [Codec::Range, Codec::Zstd, Codec::AxisAligned] {
        let mut settings = with_truncation_points(300);
        settings.codec = codec;
        let asset = prepared(&mesh, &settings);
        assert!(asset.base.skinned && asset.chunks.len() > 4);
        let base = Base::decode(&asset.base.encode().unwrap()).unwrap();
        assert_eq!(base.skins, asset.base.skins);
        let mut active = ActiveMesh::new(&base);
        for (chunk, (info, bytes)) in (0..).zip(asset.infos.iter().zip(&asset.chunks)) {
            let delta = active.decode(chunk, info, bytes).unwrap();
            active.apply(&delta).unwrap();
        }
        assert_eq!(skins(&active.to_mesh()), skins(&mesh), "{codec:?}");
        let first = active.render_vertex(0);
        assert!(first.skin.weights().iter().map(|&w| u32::from(w)).sum::<u32>() == 255);
    }
}

#[test]
fn skins_depend_on_the_cut_alone() {
    let asset = prepared(&quantised(&tube(60, 24)), &with_truncation_points(300));
    let report = check(&asset.base, &asset.infos, &asset.chunks, 12, 5, &Serial).unwrap();
    assert_eq!((report.cracks, report.order_dependent, report.undo_errors), (0, 0, 0));
}

#[test]
fn equal_positions_with_different_skins_stay_apart() {
    let mut source = tube(8, 8);
    let twin = source.positions.len() as u32;
    source.positions.push(source.positions[9]);
    source.skins.push(Skin::new([(4, 1.0)]));
    source.faces[3] = [Corner::at(twin), source.faces[3][1], source.faces[3][2]];
    let mesh = quantised(&source);
    assert_eq!(mesh.positions.len(), mesh.skins.len());
    let at = mesh.skins.iter().position(|skin| *skin == Skin::new([(4, 1.0)])).unwrap();
    let here = mesh.positions.iter().filter(|p| **p == mesh.positions[at]).count();
    assert!(here >= 1);
    source.skins.pop();
    let why = lodestream_geometry::quantise::quantise(&source, &Default::default()).unwrap_err();
    assert!(why.to_string().contains("skins"), "{why}");
}

#[test]
fn a_bend_that_a_coarse_mesh_cannot_follow_is_an_attribute_error() {
    let error = |poses: Vec<Pose>| {
        let mut source = tube(60, 24);
        source.poses = poses;
        let mesh = quantised(&source);
        let asset = prepared(&mesh, &with_truncation_points(300));
        let most = asset.infos.iter().map(|info| f64::from(info.attribute_error)).fold(0.0, f64::max);
        // In units of the mesh.
        most
    };
    let (straight, bend) = (error(vec![bent(0.0)]), error(vec![bent(0.0), bent(1.5)]));
    // Without the bend only the tube's roundness errs; a ring at the bend that is missing errs by a share of its reach.
    assert!(bend > 2.0 * straight && bend < 2.0, "{straight} and {bend}");
}

#[test]
fn meshes_without_skins_have_none() {
    let mut source = tube(12, 8);
    source.skins.clear();
    let asset = prepared(&quantised(&source), &with_truncation_points(100));
    assert!(!asset.base.skinned && asset.base.skins.is_empty());
    assert!(!ActiveMesh::new(&asset.base).skinned());
}
