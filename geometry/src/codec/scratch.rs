//! What the splits of a chunk are worked out in: allocated once a chunk.

use crate::codec::fan::{Fan, Spoke};
use crate::mesh::vec3::Vec3;

/// A side at which the fan of a split vertex is cut, where a new face may appear: between a face that stays and one
/// that goes, or at an end.
pub(crate) struct Cut {
    /// Ring vertex of the new face.
    pub(crate) x: u32,
    /// The new face is (t, x, u), else (u, x, t).
    pub(crate) left: bool,
    /// Neighbouring spokes: one that stays, one that moves.
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
    pub(crate) moves: Vec<bool>,
    pub(crate) cuts: Vec<Cut>,
    pub(crate) added: Vec<Added>,
    /// The wedge that each spoke had at the old vertex.
    pub(crate) targets: Vec<u32>,
}

/// A neighbour, relative to the star's centre.
#[derive(Clone, Copy)]
pub(crate) struct RingVertex {
    pub(crate) at: Vec3,
    pub(crate) length: f64,
    pub(crate) valence: f64,
    pub(crate) interior: f64,
    /// Of the face from here to the next, doubled.
    pub(crate) area: f64,
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

/// All of it.
#[derive(Default)]
pub(crate) struct Scratch {
    /// The star that was looked at last.
    pub(crate) star: Vec<Spoke>,
    /// The ring around it, and (score, start) of the runs that may move.
    pub(crate) ring: Vec<RingVertex>,
    pub(crate) scores: Vec<(f64, usize)>,
    pub(crate) split: Split,
    pub(crate) fitting: Fitting,
}
