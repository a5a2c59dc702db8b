//! Packs, base meshes, chunks and sequences of operations.

use lodestream_compress::{compress, encode_base};
use lodestream_geometry::Codec;
use lodestream_geometry::pack::{BlobKind, write};
use lodestream_geometry::prepare::Prepared;

use super::seed::seed;
use crate::fixtures;

fn pack(asset: &Prepared) -> Vec<u8> {
    let base = encode_base(&asset.base).expect("a prepared base is encoded");
    let stored = |chunk: &Vec<u8>| match asset.base.codec {
        Codec::Range | Codec::AxisAligned => chunk.clone(),
        Codec::Zstd => compress(chunk).expect("a chunk is compressed"),
    };
    let chunks: Vec<Vec<u8>> = asset.chunks.iter().map(stored).collect();
    let mut blobs: Vec<(BlobKind, &[u8])> = vec![(BlobKind::Base, &base)];
    blobs.extend((0..).zip(&asset.pages).map(|(i, page)| (BlobKind::IndexPage(i), page.as_slice())));
    blobs.extend((0..).zip(&chunks).map(|(i, chunk)| (BlobKind::Chunk(i), chunk.as_slice())));
    write([7; 32], &blobs).expect("a pack is written")
}

pub(super) fn packs() -> Vec<(String, Vec<u8>)> {
    fixtures::all().iter().map(|f| seed(f.name, pack(&f.asset))).collect()
}

pub(super) fn bases() -> Vec<(String, Vec<u8>)> {
    let encode = |f: &fixtures::Fixture| f.asset.base.encode().expect("a prepared base is encoded");
    fixtures::all().iter().map(|f| seed(f.name, encode(f))).collect()
}

pub(super) fn chunks() -> Vec<(String, Vec<u8>)> {
    let mut seeds = Vec::new();
    for (number, fixture) in (0..).zip(fixtures::all()) {
        for chunk in 0..fixture.asset.chunks.len() {
            let info = &fixture.asset.infos[chunk];
            let mut bytes = vec![number];
            bytes.extend((chunk as u16).to_le_bytes());
            // Counts as given, parents as they are.
            bytes.push(2);
            for count in [info.vertices, info.wedges, info.faces] {
                bytes.extend((count as u16).to_le_bytes());
            }
            bytes.extend(&fixture.asset.chunks[chunk]);
            seeds.push(seed(format!("{}-{chunk}", fixture.name), bytes));
        }
    }
    seeds
}

pub(super) fn sequences() -> Vec<(String, Vec<u8>)> {
    let mut seeds = Vec::new();
    for (number, fixture) in (0..).zip(fixtures::all()) {
        let chunks = fixture.before.len().min(12) as u16;
        let mut operation = |name: &str, operations: &mut dyn FnMut(&mut Vec<u8>)| {
            let mut bytes = vec![number];
            operations(&mut bytes);
            seeds.push(seed(format!("{}-{name}", fixture.name), bytes));
        };
        let all = |bytes: &mut Vec<u8>, operation: u8| {
            for chunk in 0..chunks {
                bytes.push(operation);
                bytes.extend(chunk.to_le_bytes());
            }
        };
        operation("up-and-down", &mut |bytes| {
            all(bytes, 0);
            all(bytes, 3);
            all(bytes, 4);
        });
        // To the first truncation points, on which children cannot be applied, and on to the end.
        operation("by-way-of-truncation_points", &mut |bytes| {
            all(bytes, 6);
            all(bytes, 3);
            all(bytes, 0);
        });
        operation("damaged", &mut |bytes| {
            for chunk in 0..chunks {
                bytes.push(u8::from(chunk % 2 == 1));
                bytes.extend(chunk.to_le_bytes());
                if chunk % 2 == 1 {
                    bytes.extend([chunk as u8 * 5, 0, 1]);
                }
            }
        });
        operation("forged", &mut |bytes| {
            all(bytes, 0);
            for chunk in (0..chunks).rev() {
                for what in 0..3 {
                    bytes.extend([3, chunk as u8, 0, 5, chunk as u8, 0, what * 3 + chunk as u8, 1, 0, 2]);
                }
            }
        });
        operation("misplaced", &mut |bytes| {
            bytes.extend([0, 0, 0]);
            for chunk in 1..chunks {
                bytes.extend([2, chunk as u8, 0, 0, 0]);
            }
        });
    }
    seeds
}
