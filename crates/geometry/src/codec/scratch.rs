//! What the splits of a chunk are worked out in: allocated once a chunk.

use crate::codec::fan::{Fan, StarFace};
use crate::codec::ring::Ring;
use crate::codec::start::Starts;
use crate::mesh::vec3::Vec3;

/// A side at which the fan of a split vertex is cut, where a new face may appear: between a face that stays and one
/// that goes, or at an end.
pub(crate) struct Cut {
    /// Ring vertex of the new face.
    pub(crate) x: u32,
    /// The new face is (t, x, u), else (u, x, t).
    pub(crate) left: bool,
    /// Neighbouring star_faces: one that stays, one that moves.
    pub(crate) stays: Option<usize>,
    pub(crate) moves: usize,
}

/// A face that the split adds: third vertex, orientation, and the cut that it fills.
pub(crate) struct Added {
    pub(crate) x: u32,
    pub(crate) left: bool,
    pub(crate) cut: Option<usize>,
    /// Number in the region.
    pub(crate) local: u32,
    /// Builder's face, when encoding.
    pub(crate) face: Option<u32>,
}

/// What was decided about a split so far.
#[derive(Default)]
pub(crate) struct Split {
    pub(crate) t: u32,
    pub(crate) u: u32,
    pub(crate) fan: Fan,
    /// The star_faces that move, in order of the list.
    pub(crate) moving: Vec<usize>,
    /// Whether each star_face moves; not set where those that move are one run.
    pub(crate) moves: Vec<bool>,
    /// Start and length, if those that move are one run of the only segment.
    pub(crate) run: Option<(usize, usize)>,
    pub(crate) cuts: Vec<Cut>,
    pub(crate) added: Vec<Added>,
    /// The wedge that each star_face had at the old vertex.
    pub(crate) targets: Vec<u32>,
}

/// What texture coordinates are fitted to.
#[derive(Default)]
pub(crate) struct Fitting {
    /// (wedge of t, wedge of u) pairs so far.
    pub(crate) pairs: Vec<(u32, u32)>,
    /// (place, texture coordinate, weight) of each wedge that was seen.
    pub(crate) points: Vec<(Vec3, Vec3, f64)>,
    pub(crate) seen: Vec<u32>,
}

impl Scratch {
    /// Memory held, in bytes, but for what only a star of many faces takes much of.
    pub(crate) fn bytes(&self) -> usize {
        (self.star.capacity() + self.split.as_ref().map_or(0, |s| s.fan.star_faces.capacity()))
            * size_of::<StarFace>()
            + self.ring.many.iter().map(|list| list.capacity() * size_of::<f64>()).sum::<usize>()
            + self.fitting.points.capacity() * size_of::<(Vec3, Vec3, f64)>()
    }
}

/// All of it.
#[derive(Default)]
pub(crate) struct Scratch {
    /// The star that was looked at last.
    pub(crate) star: Vec<StarFace>,
    /// The ring around it, and the runs that may move.
    pub(crate) ring: Ring,
    pub(crate) starts: Starts,
    pub(crate) split: Option<Box<Split>>,
    pub(crate) fitting: Fitting,
}
