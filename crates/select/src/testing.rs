//! Synthetic assets for tests of this crate and of dependent ones.

use lodestream_geometry::index::{ChunkInfo, Sphere, TruncationPoint};
use lodestream_scene::description::AssetEntry;

/// A square of side 2 about the origin in the xz plane, refined as a quadtree: level l has 4^l patches
/// and errors of 0.2 / 2^l, with two truncation points. Parents are the patch above and its neighbour to the
/// right.
pub fn plane(levels: u8) -> Vec<ChunkInfo> {
    let mut chunks = Vec::new();
    let mut first_of_level = 0;
    for level in 0..levels {
        let side = 1_u32 << level;
        let first = chunks.len() as u32;
        for row in 0..side {
            for column in 0..side {
                let mut parents = Vec::new();
                if level > 0 {
                    let above = |r: u32, c: u32| first_of_level + (r / 2) * (side / 2) + c / 2;
                    parents.push(above(row, column));
                    parents.push(above(row, (column + 1).min(side - 1)));
                    parents.dedup();
                }
                let size = 2.0 / side as f32;
                let (error, payload_bytes) = (0.2 / side as f32, 700 + (row * 131 + column * 57) % 900);
                let truncation = |part: u32, share: f32| TruncationPoint {
                    payload_bytes: payload_bytes * part / 10,
                    error: error * share,
                    vertices: 30 * part,
                    wedges: 30 * part,
                    faces: 60 * part,
                };
                chunks.push(ChunkInfo {
                    level: level + 1,
                    sphere: Sphere {
                        center: [(column as f32 + 0.5) * size - 1.0, 0.0, (row as f32 + 0.5) * size - 1.0],
                        radius: size * 0.75,
                    },
                    error,
                    truncation_points: vec![truncation(3, 0.8), truncation(6, 0.6)],
                    parents,
                    payload_bytes,
                    vertices: 300,
                    wedges: 300,
                    faces: 600,
                    ..ChunkInfo::default()
                });
            }
        }
        first_of_level = first;
    }
    chunks
}

/// The scene's entry of a [`plane`].
pub fn plane_entry(name: &str, chunks: &[ChunkInfo], base_bytes: u32) -> AssetEntry {
    AssetEntry {
        name: name.into(),
        fingerprint: [7; 16],
        origin: [0.0; 3],
        sphere: Sphere { center: [0.0; 3], radius: 1.5 },
        root_error: 0.25,
        base_bytes,
        chunk_count: chunks.len() as u32,
        shared: Vec::new(),
    }
}
