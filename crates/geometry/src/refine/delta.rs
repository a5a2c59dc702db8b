//! What a decoded chunk does to a mesh, in canonical ids: independent of what else is applied.

use crate::mesh::Attributes;

/// The id of a vertex, wedge or face: who brought it, and which of theirs it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Id {
    /// What brought it: 0 for the base mesh, chunk id + 1 for a chunk.
    pub owner: u32,
    /// Index among the elements of its owner.
    pub index: u32,
}

/// An older vertex that a chunk moves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Moved {
    /// The vertex.
    pub vertex: Id,
    /// Position before.
    pub from: [i32; 3],
    /// Position after.
    pub to: [i32; 3],
    /// Shifts before and after.
    pub shifts: [u8; 2],
}

/// A vertex that a chunk adds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NewVertex {
    /// Position on the grid.
    pub position: [i32; 3],
    /// Its shift.
    pub shift: u8,
    /// The vertex it splits from; `None` for a vertex that starts a new piece of surface.
    pub parent: Option<Id>,
}

/// A wedge that a chunk adds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NewWedge {
    /// Its vertex.
    pub vertex: Id,
    /// Its attributes.
    pub attributes: Attributes,
}

/// A face that a chunk adds, as it is once the whole chunk is applied.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NewFace {
    /// Its wedges.
    pub wedges: [Id; 3],
    /// Its material.
    pub material: u16,
}

/// A corner of an older face that moves to another wedge.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Repoint {
    /// The face.
    pub face: Id,
    /// Which of its corners, 0 to 2.
    pub corner: u8,
    /// Wedge before.
    pub from: Id,
    /// Wedge after.
    pub to: Id,
}

/// A decoded chunk, or its beginning up to a truncation.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ChunkDelta {
    /// Id of the chunk.
    pub chunk: u32,
    /// The truncation that it ends at, an index of [`crate::asset::index::ChunkInfo::truncation_points`]; `None` for the whole
    /// chunk. Its ids are those of the whole chunk, of which it holds the first.
    pub truncation: Option<u8>,
    /// Ids of the chunks that must be applied whole first.
    pub parents: Vec<u32>,
    /// Older vertices moved.
    pub moves: Vec<Moved>,
    /// Vertices added.
    pub vertices: Vec<NewVertex>,
    /// Wedges added.
    pub wedges: Vec<NewWedge>,
    /// Faces added.
    pub faces: Vec<NewFace>,
    /// Corners moved.
    pub repoints: Vec<Repoint>,
}
