//! All codecs encode the same meshes.

use lodestream_geometry::base::Base;
use lodestream_geometry::check::check;
use lodestream_geometry::index::ChunkInfo;
use lodestream_geometry::mesh::SourceMesh;
use lodestream_geometry::pool::Serial;
use lodestream_geometry::prepare::{Prepared, suit};
use lodestream_geometry::random::Random;
use lodestream_geometry::refine::ActiveMesh;
use lodestream_geometry::{Codec, Settings};

use crate::common::{all, bare, plain_faces, prepared, quantised, regions, shapes, with_truncation_points};

fn zstd_settings(faces: usize) -> Settings {
    Settings { codec: Codec::Zstd, ..regions(faces) }
}

/// Index entries without bytes, truncation points and wedges: a wedge may occur twice, in different chunks, and
/// truncation points change where.
fn uncoded(infos: &[ChunkInfo]) -> Vec<ChunkInfo> {
    let uncoded =
        |i: &ChunkInfo| ChunkInfo { payload_bytes: 0, truncation_points: Vec::new(), wedges: 0, ..i.clone() };
    infos.iter().map(uncoded).collect()
}

#[test]
fn every_level_is_the_same_mesh_under_both_codecs() {
    for (name, source) in all() {
        let mesh = quantised(&source);
        let assets = [regions(200), zstd_settings(200)].map(|settings| prepared(&mesh, &settings));
        let [ranged, zstd_settings] = &assets;
        assert!(uncoded(&ranged.infos) == uncoded(&zstd_settings.infos), "{name}: index");
        assert!(
            zstd_settings.infos.iter().all(|info| info.truncation_points.is_empty()),
            "{name}: truncation_points"
        );
        let levels = ranged.infos.iter().map(|info| info.level).max().unwrap_or(0);
        for level in 0..=levels {
            let [one, other] = assets.each_ref().map(|asset| {
                let base = Base::decode(&asset.base.encode().unwrap()).unwrap();
                assert!(base == asset.base, "{name}: base");
                let mut mesh = ActiveMesh::new(&base);
                for (id, info) in (0..).zip(&asset.infos).filter(|(_, info)| info.level <= level) {
                    let delta = mesh.decode(id, info, &asset.chunks[id as usize]).unwrap();
                    mesh.apply(&delta).unwrap();
                }
                plain_faces(&mesh.to_mesh())
            });
            assert!(one == other, "{name}: level {level}");
        }
    }
}

/// A base mesh may be coded by either codec, independent of the chunks' codec; the smaller form is stored.
#[test]
fn base_meshes_are_the_same_under_both_codecs() {
    for (name, source) in all() {
        let asset = prepared(&quantised(&source), &regions(200));
        for codec in [Codec::Range, Codec::AxisAligned, Codec::Zstd] {
            let blob = asset.base.encode_as(codec).unwrap();
            assert!(Base::decode_as(&blob, codec).unwrap() == asset.base, "{name}: {codec:?}");
        }
    }
}

#[test]
fn the_zstd_codec_passes_the_check() {
    for (name, source) in all() {
        let asset = prepared(&quantised(&source), &zstd_settings(200));
        let report = check(&asset.base, &asset.infos, &asset.chunks, 10, 9, &Serial).unwrap();
        assert_eq!((report.cracks, report.order_dependent, report.undo_errors), (0, 0, 0), "{name}");
    }
}

/// A surface of revolution: a stepped profile about an axis, with vertices at the corners only.
fn surface_of_revolution(steps: u32, around: u32) -> SourceMesh {
    let mut random = Random::new(3);
    let (mut radius, mut z) = (3.0, 0.0);
    // Between the ends on the axis, each step has two corners: along the axis, then across.
    let mut profile = vec![(0.0, 0.0), (radius, 0.0)];
    for _ in 0..steps {
        z += 0.1 + random.unit();
        profile.push((radius, z));
        radius = 1.0 + 3.0 * random.unit();
        profile.push((radius, z));
    }
    profile.push((0.0, z));
    let place = |(radius, z): (f64, f64), j: u32| {
        let angle = std::f64::consts::TAU * f64::from(j) / f64::from(around);
        [radius * angle.cos(), radius * angle.sin(), z]
    };
    let mut positions = vec![place(profile[0], 0)];
    for &corner in &profile[1..profile.len() - 1] {
        positions.extend((0..around).map(|j| place(corner, j)));
    }
    positions.push([0.0, 0.0, z]);
    let rings = profile.len() as u32 - 2;
    let at = |ring: u32, j: u32| 1 + ring * around + j % around;
    let mut faces = Vec::new();
    for j in 0..around {
        faces.push([0, at(0, j + 1), at(0, j)]);
        faces.push([1 + rings * around, at(rings - 1, j), at(rings - 1, j + 1)]);
        for ring in 0..rings - 1 {
            let (a, b, c, d) = (at(ring, j), at(ring, j + 1), at(ring + 1, j), at(ring + 1, j + 1));
            faces.extend([[a, b, d], [a, d, c]]);
        }
    }
    bare(positions, &faces)
}

#[test]
fn axis_aligned_geometry_takes_a_third_fewer_bytes() {
    let mesh = quantised(&surface_of_revolution(40, 48));
    let of = |codec| prepared(&mesh, &Settings { codec, ..with_truncation_points(400) });
    let [ranged, axis_aligned] = [Codec::Range, Codec::AxisAligned].map(of);
    let bytes = |asset: &Prepared| asset.chunks.iter().map(Vec::len).sum::<usize>();
    assert!(
        bytes(&axis_aligned) * 3 <= bytes(&ranged) * 2,
        "{} bytes instead of {}",
        bytes(&axis_aligned),
        bytes(&ranged)
    );
    assert!(axis_aligned.infos.iter().any(|info| !info.truncation_points.is_empty()));
    let base = Base::decode(&axis_aligned.base.encode().unwrap()).unwrap();
    assert!(base == axis_aligned.base && base.codec == Codec::AxisAligned);
    let whole = |asset: &Prepared| {
        let mut active = ActiveMesh::new(&asset.base);
        for (id, info) in (0..).zip(&asset.infos) {
            let delta = active.decode(id, info, &asset.chunks[id as usize]).unwrap();
            active.apply(&delta).unwrap();
        }
        plain_faces(&active.to_mesh())
    };
    assert!(whole(&axis_aligned) == whole(&ranged));
}

#[test]
fn axis_aligned_assets_pass_the_check() {
    for (name, source) in all() {
        let asset = prepared(
            &quantised(&source),
            &Settings { codec: Codec::AxisAligned, ..with_truncation_points(200) },
        );
        let report = check(&asset.base, &asset.infos, &asset.chunks, 10, 9, &Serial).unwrap();
        assert_eq!((report.cracks, report.order_dependent, report.undo_errors), (0, 0, 0), "{name}");
    }
}

/// Wedges of axis-aligned geometry are predicted from face orientations and texture projections.
#[test]
fn dressed_stones_with_projected_textures_take_less_than_half_of_the_bytes() {
    let zstd_settings = quantised(&shapes::stones(120));
    let mut suited = zstd_settings.clone();
    suit(&mut suited, Codec::AxisAligned);
    let of = |mesh, codec| {
        let asset = prepared(mesh, &Settings { codec, ..regions(400) });
        let bytes = asset.base.encode().unwrap().len() + asset.chunks.iter().map(Vec::len).sum::<usize>();
        (asset, bytes)
    };
    let (_, ranged) = of(&zstd_settings, Codec::Range);
    let (asset, axis_aligned) = of(&suited, Codec::AxisAligned);
    assert!(axis_aligned * 20 < ranged * 9, "{axis_aligned} bytes instead of {ranged}");
    // Without renumbered groups the result is equally correct, but larger.
    let (_, unnamed) = of(&zstd_settings, Codec::AxisAligned);
    assert!(axis_aligned < unnamed, "{axis_aligned} and {unnamed}");
    let mut active = ActiveMesh::new(&asset.base);
    for (id, info) in (0..).zip(&asset.infos) {
        let delta = active.decode(id, info, &asset.chunks[id as usize]).unwrap();
        active.apply(&delta).unwrap();
    }
    assert!(plain_faces(&active.to_mesh()) == plain_faces(&suited));
}

#[test]
fn the_old_axis_aligned_version_is_refused() {
    let settings = Settings { codec: Codec::AxisAligned, ..regions(200) };
    let mut blob = prepared(&quantised(&shapes::torus(8, 10)), &settings).base.encode().unwrap();
    blob[1] = blob[1] & 0x3f | 0x40;
    let why = Base::decode(&blob).unwrap_err().to_string();
    assert!(why.contains("prepare the model again"), "{why}");
}

/// A zstd payload has no decodable prefix, and is not mistaken for a range-coded one.
#[test]
fn payloads_of_other_codecs_are_refused() {
    let mesh = quantised(&shapes::torus(30, 40));
    let [ranged, zstd_settings] =
        [regions(2000), zstd_settings(2000)].map(|settings| prepared(&mesh, &settings));
    assert!(!ranged.infos[0].truncation_points.is_empty());
    let mut active = ActiveMesh::new(&zstd_settings.base);
    let info = ChunkInfo {
        truncation_points: ranged.infos[0].truncation_points.clone(),
        ..zstd_settings.infos[0].clone()
    };
    let why = active.decode_prefix(0, &info, Some(0), &zstd_settings.chunks[0]).unwrap_err().to_string();
    assert!(why.contains("no truncation points"), "{why}");
    assert!(active.decode(0, &zstd_settings.infos[0], &ranged.chunks[0]).is_err());
    active = ActiveMesh::new(&ranged.base);
    assert!(active.decode(0, &zstd_settings.infos[0], &zstd_settings.chunks[0]).is_err());
}
