//! Decoders reject element counts beyond the allocation limit; encoders never exceed it.

use lodestream_geometry::Codec;
use lodestream_geometry::base::Base;
use lodestream_geometry::index::ChunkInfo;
use lodestream_geometry::mesh::{Face, SourceMesh, Wedge};
use lodestream_geometry::refine::ActiveMesh;

use crate::common::{bare, prepared, regions, shapes, with_bits};

fn flat_grid(n: u32) -> SourceMesh {
    let positions = (0..=n).flat_map(|y| (0..=n).map(move |x| [f64::from(x), f64::from(y), 0.0]));
    let mut faces = Vec::new();
    for y in 0..n {
        for x in 0..n {
            let a = y * (n + 1) + x;
            faces.extend([[a, a + 1, a + n + 2], [a, a + n + 2, a + n + 1]]);
        }
    }
    bare(positions.collect(), &faces)
}

/// The most compressible mesh: a plane on a coarse grid, in regions of maximum size.
#[test]
fn a_large_flat_grid_is_accepted_with_every_codec() {
    let mesh = with_bits(&flat_grid(200), 8);
    for codec in [Codec::Range, Codec::AxisAligned, Codec::Zstd] {
        let settings = lodestream_geometry::Settings { codec, ..regions(20_000) };
        let asset = prepared(&mesh, &settings);
        let densest =
            asset.infos.iter().zip(&asset.chunks).map(|(info, bytes)| {
                f64::from(info.vertices + info.wedges + info.faces) / bytes.len() as f64
            });
        let densest = densest.fold(0.0, f64::max);
        assert!(codec == Codec::Zstd || densest > 4.0, "{densest} elements a byte: the case is too easy");
        // Repeated coordinates are fully predicted, so the chunks are padded.
        let most = if codec == Codec::AxisAligned { 16.1 } else { 12.0 };
        assert!(densest < most, "{densest} elements a byte: too near the limit of 16");
        let mut active = ActiveMesh::new(&asset.base);
        for (id, (info, bytes)) in (0..).zip(asset.infos.iter().zip(&asset.chunks)) {
            for (stop, at) in (0..).zip(&info.truncation_points) {
                let prefix = &bytes[..at.payload_bytes as usize];
                active.decode_prefix(id, info, Some(stop), prefix).unwrap();
            }
            let delta = active.decode(id, info, bytes).unwrap();
            active.apply(&delta).unwrap();
        }
        assert_eq!(active.face_count(), 80_000);
    }
}

/// A base mesh of one long strip whose positions are all predicted: 2 bits per face remain.
#[test]
fn the_cheapest_base_mesh_is_accepted() {
    let mut base = prepared(&with_bits(&flat_grid(4), 16), &regions(50)).base;
    let count = 40_000_u32;
    // The parallelogram rule is always right.
    base.positions = (0..count as i32).map(|i| [i, i % 2, 0]).collect();
    base.wedges = (0..count).map(|vertex| Wedge { vertex, ..Wedge::default() }).collect();
    let turned = |i: u32| if i.is_multiple_of(2) { [i, i + 1, i + 2] } else { [i + 1, i, i + 2] };
    base.faces = (0..count - 2).map(|i| Face { wedges: turned(i), material: 0 }).collect();
    let elements = base.positions.len() + base.wedges.len() + base.faces.len();
    for codec in [Codec::Range, Codec::AxisAligned, Codec::Zstd] {
        base.codec = codec;
        let blob = base.encode().unwrap();
        let again = Base::decode(&blob).unwrap();
        assert_eq!(again.positions.len() + again.wedges.len() + again.faces.len(), elements);
        let density = elements as f64 / blob.len() as f64;
        assert!(codec == Codec::Zstd || density > 10.0, "{density} elements a byte: the case is too easy");
        assert!(density < 14.0, "{density} elements a byte: too near the limit of 16");
    }
}

#[test]
fn stated_counts_beyond_the_limit_are_refused() {
    for codec in [Codec::Range, Codec::AxisAligned, Codec::Zstd] {
        let settings = lodestream_geometry::Settings { codec, ..regions(200) };
        let asset = prepared(&with_bits(&shapes::torus(20, 30), 12), &settings);
        let mesh = ActiveMesh::new(&asset.base);
        let bytes = &asset.chunks[0];
        let most = 64 + 16 * bytes.len() as u32;
        let announced = |faces| ChunkInfo { vertices: 1, wedges: 0, faces, ..asset.infos[0].clone() };
        let why = mesh.decode(0, &announced(most), bytes).unwrap_err().to_string();
        assert!(why.contains("elements stated"), "{why}");
        let why = mesh.decode(0, &announced(most - 1), bytes).unwrap_err().to_string();
        assert!(!why.contains("elements stated"), "{why}");
    }
}
