//! Meshes of positions and faces only.

use lodestream_geometry::mesh::{Corner, SourceMesh};

/// A mesh without attributes.
pub(crate) fn bare(positions: Vec<[f64; 3]>, faces: &[[u32; 3]]) -> SourceMesh {
    SourceMesh {
        positions,
        faces: faces.iter().map(|f| f.map(Corner::at)).collect(),
        materials: vec![0; faces.len()],
        ..SourceMesh::default()
    }
}
