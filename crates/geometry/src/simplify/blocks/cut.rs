//! Cuts a mesh into compact blocks with equal numbers of faces.

use crate::mesh::QuantisedMesh;
use crate::mesh::rows::Rows;
use crate::mesh::vec3::{add, scale};
use crate::simplify::partition::halves;

/// No block.
const NONE: u32 = u32::MAX;

/// The blocks of a mesh, ordered so that consecutive ones are mostly neighbours.
pub(super) struct Cut {
    /// Faces of each block, ascending.
    faces: Rows<u32>,
    /// Per vertex: whether it belongs to several blocks.
    shared: Vec<bool>,
}

impl Cut {
    pub(super) fn new(mesh: &QuantisedMesh, count: usize) -> Self {
        let vertices = |face: usize| mesh.faces[face].wedges.map(|w| mesh.wedges[w as usize].vertex);
        let block_of_face = halves(
            (0..mesh.faces.len()).map(|face| {
                let [a, b, c] = vertices(face).map(|v| mesh.positions[v as usize].map(f64::from));
                scale(add(add(a, b), c), 1.0 / 3.0)
            }),
            count,
            0,
        );
        let mut first = vec![NONE; mesh.positions.len()];
        let mut shared = vec![false; mesh.positions.len()];
        for (face, &block) in block_of_face.iter().enumerate() {
            for v in vertices(face).map(|v| v as usize) {
                if first[v] == NONE {
                    first[v] = block;
                }
                shared[v] |= first[v] != block;
            }
        }
        let faces = Rows::new(count, || block_of_face.iter().zip(0..).map(|(&block, face)| (block, face)));
        Self { faces, shared }
    }

    pub(super) fn count(&self) -> usize {
        self.faces.len()
    }

    pub(super) fn faces(&self, block: usize) -> &[u32] {
        self.faces.row(block as u32)
    }

    pub(super) fn is_shared(&self, vertex: u32) -> bool {
        self.shared[vertex as usize]
    }
}
