//! Buffers for coding splits, reused over a chunk.

use crate::codec::fan::{Fan, StarFace};
use crate::codec::ring::Ring;
use crate::codec::start::Starts;
use crate::mesh::vec3::Vec3;

/// A side at which a split vertex's fan is cut, where a new face may appear: between a face that stays and one that
/// moves, or at an end.
pub(crate) struct Cut {
    /// Ring vertex of the new face.
    pub(crate) x: u32,
    /// The new face is (t, x, u), else (u, x, t).
    pub(crate) left: bool,
    /// The neighbouring star faces: one that stays, one that moves.
    pub(crate) stays: Option<usize>,
    pub(crate) moves: usize,
}

/// A face that the split adds: third vertex, orientation, and the cut that it fills, if any.
pub(crate) struct AddedFace {
    pub(crate) x: u32,
    pub(crate) left: bool,
    pub(crate) cut: Option<usize>,
    /// Number in the region.
    pub(crate) local: u32,
    /// Builder's face, when encoding.
    pub(crate) face: Option<u32>,
}

/// State of a split.
#[derive(Default)]
pub(crate) struct Split {
    pub(crate) t: u32,
    pub(crate) u: u32,
    pub(crate) fan: Fan,
    /// The star faces that move, ascending.
    pub(crate) moving: Vec<usize>,
    /// Whether each star face moves; empty if the moving faces are one run.
    pub(crate) moves: Vec<bool>,
    /// Start and length, if the moving faces are one run of the only segment.
    pub(crate) run: Option<(usize, usize)>,
    pub(crate) cuts: Vec<Cut>,
    pub(crate) added: Vec<AddedFace>,
    /// The wedge of each star face at the old vertex.
    pub(crate) targets: Vec<u32>,
}

/// Points that texture coordinates are fitted to.
#[derive(Default)]
pub(crate) struct UvFit {
    /// (wedge of t, wedge of u) pairs so far.
    pub(crate) pairs: Vec<(u32, u32)>,
    /// (position, texture coordinate, weight) of each wedge visited.
    pub(crate) points: Vec<(Vec3, Vec3, f64)>,
    pub(crate) visited: Vec<u32>,
}

impl Scratch {
    /// Memory held, in bytes, without buffers that only large stars enlarge.
    pub(crate) fn bytes(&self) -> usize {
        (self.star.capacity() + self.split.as_ref().map_or(0, |s| s.fan.star_faces.capacity()))
            * size_of::<StarFace>()
            + self.ring.many.iter().map(|list| list.capacity() * size_of::<f64>()).sum::<usize>()
            + self.fitting.points.capacity() * size_of::<(Vec3, Vec3, f64)>()
    }
}

/// All buffers.
#[derive(Default)]
pub(crate) struct Scratch {
    /// The most recent star.
    pub(crate) star: Vec<StarFace>,
    /// The ring around it, and the possible starts of the moving run.
    pub(crate) ring: Ring,
    pub(crate) starts: Starts,
    pub(crate) split: Option<Box<Split>>,
    pub(crate) fitting: UvFit,
}
