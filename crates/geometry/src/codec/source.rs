//! The encoder's input for one chunk.

use crate::collapse::{Placed, Records};
use crate::mesh::Face;
use crate::mesh::skin::Skin;
use crate::mesh::wedges::Wedges;

/// The input of one chunk, in the ids of its builder (the simplified mesh).
pub(crate) struct Source<'a> {
    pub(crate) records: &'a Records,
    /// Initial position of a builder's vertex.
    pub(crate) place: &'a (dyn Fn(u32) -> Placed + 'a),
    /// New positions of older vertices of the region, ascending by vertex.
    pub(crate) moves: &'a [Placed],
    /// Low bits that the grid of the chunk's vertices leaves out.
    pub(crate) shift: u8,
    /// The builder's wedges: the mesh's, and those added by collapses.
    pub(crate) wedges: &'a Wedges<'a>,
    /// The builder's faces, for their materials.
    pub(crate) faces: &'a [Face],
    /// Part of each of the builder's vertices; empty if there is one part.
    pub(crate) parts: &'a [u32],
    /// Skin of each; empty if there are none.
    pub(crate) skins: &'a [Skin],
    /// Builder's ids by slot of the mesh before the chunk.
    pub(crate) vertex_by_slot: &'a [u32],
    pub(crate) wedge_by_slot: &'a [u32],
    pub(crate) face_by_slot: &'a [u32],
    /// Slots of the builder's existing vertices.
    pub(crate) slot_of_vertex: &'a [u32],
    /// Whether a builder's vertex is interior to the region.
    pub(crate) interior: &'a (dyn Fn(u32) -> bool + 'a),
}

impl Source<'_> {
    /// The part of a builder's vertex.
    pub(crate) fn part(&self, vertex: u32) -> u32 {
        self.parts.get(vertex as usize).copied().unwrap_or(0)
    }

    /// The skin of a builder's vertex.
    pub(crate) fn skin(&self, vertex: u32) -> Skin {
        self.skins.get(vertex as usize).copied().unwrap_or_default()
    }
}
