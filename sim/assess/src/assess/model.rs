//! The assessed model, prepared and decoded.

use lodestream_compress::decode_prefix;
use lodestream_geometry::ancestor_closed_cut::Member;
use lodestream_geometry::mesh::QuantisedMesh;
use lodestream_geometry::prepare::Prepared;
use lodestream_geometry::refine::{ActiveMesh, ChunkDelta};

use crate::measure::Surface;

/// A prepared model with all chunks decoded.
pub(super) struct Model {
    pub(super) mesh: QuantisedMesh,
    pub(super) input: Surface,
    pub(super) prepared: Prepared,
    pub(super) deltas: Vec<ChunkDelta>,
}

impl Model {
    /// The surface with an ancestor-closed cut of chunks applied.
    pub(super) fn surface(&self, set: &[Member]) -> anyhow::Result<Surface> {
        let mut active = ActiveMesh::new(&self.prepared.base);
        for &Member { chunk, truncation } in set {
            let id = chunk as usize;
            if truncation.is_none() {
                active.apply(&self.deltas[id])?;
            } else {
                let (info, payload) = (&self.prepared.infos[id], &self.prepared.chunks[id]);
                active.apply(&decode_prefix(&active, chunk, info, truncation, payload)?)?;
            }
        }
        Ok(surface(&active.to_mesh()))
    }

    /// The error that the index states for each chunk missing from an ancestor-closed cut, wholly or in part.
    pub(super) fn left(&self, set: &[Member]) -> Vec<f64> {
        let mut left: Vec<f64> = self.prepared.infos.iter().map(|i| f64::from(i.error)).collect();
        for &Member { chunk, truncation } in set {
            left[chunk as usize] = f64::from(self.prepared.infos[chunk as usize].extent(truncation).error);
        }
        left
    }

    pub(super) fn diagonal(&self) -> f64 {
        f64::from(self.prepared.base.diagonal)
    }
}

/// The triangles of a mesh, in the asset's units.
pub(super) fn surface(mesh: &QuantisedMesh) -> Surface {
    Surface {
        positions: mesh.positions.iter().map(|&p| mesh.grid.position(p)).collect(),
        triangles: mesh.faces.iter().map(|f| f.wedges.map(|w| mesh.wedges[w as usize].vertex)).collect(),
    }
}
