//! The changes of a decoded chunk, in canonical ids, independent of other applied chunks.

use crate::mesh::Attributes;
use crate::mesh::skin::Skin;

/// The id of a vertex, wedge or face: its owner, and its index among the owner's elements.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Id {
    /// The owner: 0 for the base mesh, chunk id + 1 for a chunk.
    pub owner: u32,
    /// Index among the elements of its owner.
    pub index: u32,
}

/// An older vertex that a chunk moves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MovedVertex {
    /// The vertex.
    pub vertex: Id,
    /// Position before.
    pub from: [i32; 3],
    /// Position after.
    pub to: [i32; 3],
    /// Shifts (low bits that are zero) before and after.
    pub shifts: [u8; 2],
}

/// A vertex that a chunk adds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NewVertex {
    /// Position on the grid.
    pub position: [i32; 3],
    /// Its shift (low bits that are zero).
    pub shift: u8,
    /// Its skin; the default in an asset without.
    pub skin: Skin,
    /// Where it comes from.
    pub origin: Origin,
}

/// Origin of a new vertex.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Origin {
    /// It splits from this vertex and belongs to its part.
    Split(Id),
    /// It has no faces yet and starts a new piece of surface, of this part.
    Part(u32),
}

/// A wedge that a chunk adds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NewWedge {
    /// Its vertex.
    pub vertex: Id,
    /// Its attributes.
    pub attributes: Attributes,
}

/// A face that a chunk adds, in its state after the whole chunk.
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

/// A decoded chunk, whole or up to a truncation point.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ChunkDelta {
    /// Id of the chunk.
    pub chunk: u32,
    /// The truncation point, an index of [`crate::asset::index::ChunkInfo::truncation_points`]; `None` for the whole
    /// chunk. The elements are the first ones of the whole chunk, with the same ids.
    pub truncation: Option<u8>,
    /// Ids of the chunks that must be applied (whole) first.
    pub parents: Vec<u32>,
    /// Older vertices that move.
    pub moves: Vec<MovedVertex>,
    /// New vertices.
    pub vertices: Vec<NewVertex>,
    /// New wedges.
    pub wedges: Vec<NewWedge>,
    /// New faces.
    pub faces: Vec<NewFace>,
    /// Corners that move.
    pub repoints: Vec<Repoint>,
}
