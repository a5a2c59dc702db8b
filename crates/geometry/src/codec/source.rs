//! A chunk as its builder knows it.

use crate::collapse::{Placed, Records};
use crate::mesh::Face;
use crate::mesh::wedges::Wedges;

/// What an encoder is told of a chunk.
pub(crate) struct Source<'a> {
    pub(crate) records: &'a Records,
    /// Where a builder's vertex is when its chunk brings it.
    pub(crate) place: &'a (dyn Fn(u32) -> Placed + 'a),
    /// Where older vertices of the region go, ascending by vertex.
    pub(crate) moves: &'a [Placed],
    /// How many bits the grid leaves out that the chunk brings vertices to.
    pub(crate) shift: u8,
    /// The builder's wedges: the mesh's, and those kept by collapses.
    pub(crate) wedges: &'a Wedges<'a>,
    /// The builder's faces, for their materials.
    pub(crate) faces: &'a [Face],
    /// Builder's ids by slot of the mesh that is encoded against.
    pub(crate) vertex_by_slot: &'a [u32],
    pub(crate) wedge_by_slot: &'a [u32],
    pub(crate) face_by_slot: &'a [u32],
    /// Slots of the builder's vertices that are there.
    pub(crate) slot_of_vertex: &'a [u32],
    /// Whether a builder's vertex is interior to the region.
    pub(crate) interior: &'a (dyn Fn(u32) -> bool + 'a),
}
