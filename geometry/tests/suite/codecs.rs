//! Both codecs say the same meshes.

use lodestream_geometry::base::Base;
use lodestream_geometry::check::check;
use lodestream_geometry::index::ChunkInfo;
use lodestream_geometry::pool::Serial;
use lodestream_geometry::refine::ActiveMesh;
use lodestream_geometry::{Codec, Settings};

use crate::common::{all, plain_faces, prepared, quantised, regions, shapes};

fn plain(faces: usize) -> Settings {
    Settings { codec: Codec::Plain, ..regions(faces) }
}

/// What an index says of a chunk, but for bytes, stops and wedges: a wedge may come twice, in another
/// chunk each, and a stop changes where.
fn uncoded(infos: &[ChunkInfo]) -> Vec<ChunkInfo> {
    let uncoded = |i: &ChunkInfo| ChunkInfo { payload_bytes: 0, stops: Vec::new(), wedges: 0, ..i.clone() };
    infos.iter().map(uncoded).collect()
}

#[test]
fn every_level_is_the_same_mesh_under_both_codecs() {
    for (name, source) in all() {
        let mesh = quantised(&source);
        let assets = [regions(200), plain(200)].map(|settings| prepared(&mesh, &settings));
        let [ranged, plain] = &assets;
        assert!(uncoded(&ranged.infos) == uncoded(&plain.infos), "{name}: index");
        assert!(plain.infos.iter().all(|info| info.stops.is_empty()), "{name}: stops");
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

/// A base mesh may be coded by either codec, whatever codes the chunks: it is stored as what is smaller.
#[test]
fn base_meshes_are_the_same_under_both_codecs() {
    for (name, source) in all() {
        let asset = prepared(&quantised(&source), &regions(200));
        for codec in [Codec::Range, Codec::Plain] {
            let blob = asset.base.encode_as(codec).unwrap();
            assert!(Base::decode_as(&blob, codec).unwrap() == asset.base, "{name}: {codec:?}");
        }
    }
}

#[test]
fn the_plain_codec_passes_the_check_too() {
    for (name, source) in all() {
        let asset = prepared(&quantised(&source), &plain(200));
        let report = check(&asset.base, &asset.infos, &asset.chunks, 10, 9, &Serial).unwrap();
        assert_eq!((report.cracks, report.order_dependent, report.undo_errors), (0, 0, 0), "{name}");
    }
}

/// A plain payload has no beginning that could be used, and one of the range coder's is none.
#[test]
fn plain_payloads_are_not_taken_for_others() {
    let mesh = quantised(&shapes::torus(30, 40));
    let [ranged, plain] = [regions(2000), plain(2000)].map(|settings| prepared(&mesh, &settings));
    assert!(!ranged.infos[0].stops.is_empty());
    let mut active = ActiveMesh::new(&plain.base);
    let info = ChunkInfo { stops: ranged.infos[0].stops.clone(), ..plain.infos[0].clone() };
    let why = active.decode_prefix(0, &info, Some(0), &plain.chunks[0]).unwrap_err().to_string();
    assert!(why.contains("no stopping points"), "{why}");
    assert!(active.decode(0, &plain.infos[0], &ranged.chunks[0]).is_err());
    active = ActiveMesh::new(&ranged.base);
    assert!(active.decode(0, &plain.infos[0], &plain.chunks[0]).is_err());
}
