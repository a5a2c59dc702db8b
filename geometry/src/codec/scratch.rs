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
    /// Start and length, if those that move are one run of the only segment.
    pub(crate) run: Option<(usize, usize)>,
    pub(crate) cuts: Vec<Cut>,
    pub(crate) added: Vec<Added>,
    /// The wedge that each spoke had at the old vertex.
    pub(crate) targets: Vec<u32>,
}

/// What is known of a neighbour of a star's centre, by list: where it is relative to the centre, how far that is, its
/// valence, whether it is interior (1 or 0), and the area of the face from here to the next, doubled.
pub(crate) const X: usize = 0;
pub(crate) const Y: usize = 1;
pub(crate) const Z: usize = 2;
pub(crate) const LENGTH: usize = 3;
pub(crate) const VALENCE: usize = 4;
pub(crate) const INTERIOR: usize = 5;
pub(crate) const AREA: usize = 6;

/// The neighbours in order, a list for each thing that is known of them; what is behind the last means nothing.
#[derive(Default)]
pub(crate) struct Ring([Vec<f64>; 7]);

impl Ring {
    /// Makes room for so many.
    pub(crate) fn grow(&mut self, count: usize) {
        if self.0[X].len() < count {
            self.0.iter_mut().for_each(|list| list.resize(count, 0.0));
        }
    }

    /// Sets the one at `i`, for which there is room.
    #[inline]
    pub(crate) fn set(&mut self, i: usize, values: [f64; 7]) {
        for (list, value) in self.0.iter_mut().zip(values) {
            list[i] = value;
        }
    }

    /// Says the first `count` again from `end` on.
    pub(crate) fn repeat(&mut self, end: usize, count: usize) {
        for list in &mut self.0 {
            let (first, rest) = list.split_at_mut(end);
            rest.iter_mut().zip(&first[..count]).for_each(|(to, from)| *to = *from);
        }
    }

    #[inline]
    pub(crate) fn list(&self, list: usize) -> &[f64] {
        &self.0[list]
    }

    #[inline]
    pub(crate) fn place(&self, i: usize) -> Vec3 {
        [self.0[X][i], self.0[Y][i], self.0[Z][i]]
    }
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
        (self.star.capacity() + self.split.fan.spokes.capacity()) * size_of::<Spoke>()
            + self.ring.list(X).len() * 7 * size_of::<f64>()
            + self.fitting.points.capacity() * size_of::<(Vec3, Vec3, f64)>()
    }
}

/// All of it.
#[derive(Default)]
pub(crate) struct Scratch {
    /// The star that was looked at last.
    pub(crate) star: Vec<Spoke>,
    /// The ring around it; (score, start) of the runs that may move, and numbers that compare as the scores.
    pub(crate) ring: Ring,
    pub(crate) scores: Vec<(f64, usize)>,
    pub(crate) keys: Vec<i64>,
    pub(crate) split: Split,
    pub(crate) fitting: Fitting,
}
