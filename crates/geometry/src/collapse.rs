//! The collapses of a region in order, with what is needed to redo and undo each. Simplification writes these
//! records; the encoder reads them backwards.

use std::ops::Range;

/// Target of a collapse that drops a vertex without faces.
pub(crate) const NO_VERTEX: u32 = u32::MAX;

/// A vertex and its grid cell.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Placed {
    pub(crate) vertex: u32,
    pub(crate) cell: [i32; 3],
    /// Number of low bits of `cell` that are zero.
    pub(crate) shift: u8,
}

/// A face corner that a collapse moves to another vertex.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct MovedCorner {
    pub(crate) face: u32,
    /// Wedge of the removed vertex.
    pub(crate) from: u32,
    /// Wedge of the vertex that stays.
    pub(crate) to: u32,
}

/// A face that a collapse removes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct RemovedFace {
    pub(crate) face: u32,
    /// The corner that is neither the removed vertex nor its target, where a split could not find it
    /// among the target's neighbours; else [`NO_VERTEX`].
    third: u32,
}

impl RemovedFace {
    pub(crate) fn new(face: u32, third: Option<u32>) -> Self {
        Self { face, third: third.unwrap_or(NO_VERTEX) }
    }

    pub(crate) fn third(&self) -> Option<u32> {
        (self.third != NO_VERTEX).then_some(self.third)
    }

    /// Maps the ids.
    pub(crate) fn with_ids(&self, face: impl Fn(u32) -> u32, vertex: impl Fn(u32) -> u32) -> Self {
        Self::new(face(self.face), self.third().map(vertex))
    }
}

/// One half-edge collapse: `removed` goes onto `target`. Without a target: a vertex whose faces are
/// all gone is dropped.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Collapse {
    pub(crate) removed: u32,
    /// [`NO_VERTEX`] for a vertex without faces.
    pub(crate) target: u32,
    /// Ends of this collapse's parts of the lists in [`Records`]; they start where the previous ends.
    pub(crate) moved_end: u32,
    pub(crate) removed_end: u32,
    pub(crate) added_wedges_end: u32,
}

/// The collapses of one region in one level.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Records {
    pub(crate) collapses: Vec<Collapse>,
    /// Largest cost so far in this region, by collapse; cleared once the number of collapses is final.
    pub(crate) costs: Vec<f64>,
    pub(crate) moved: Vec<MovedCorner>,
    pub(crate) removed: Vec<RemovedFace>,
    /// Wedges of the removed faces at the time they were removed. Empty until the level is stored as a checkpoint;
    /// until then the dead faces still hold them.
    pub(crate) removed_wedges: Vec<[u32; 3]>,
    /// Wedges that a collapse adds to the target: the source wedge of each. Until [`Records::commit`] they are
    /// numbered from `first_added_wedge` on.
    pub(crate) added_wedges: Vec<u32>,
    pub(crate) first_added_wedge: u32,
    /// Truncation points: how many collapses remain at each, coarse to fine, so descending.
    pub(crate) truncation_points: Vec<u32>,
    /// Upper bound on the distance between an input vertex and the vertex it was collapsed to; infinite if faces were
    /// removed without a target. If each point of a face is mapped to the same barycentric coordinates, this bounds
    /// the distance of the surfaces both ways.
    pub(crate) reach: f64,
}

impl Records {
    /// The parts of one collapse.
    pub(crate) fn parts(&self, index: usize) -> (&Collapse, &[MovedCorner], &[RemovedFace]) {
        let collapse = &self.collapses[index];
        let (moved, removed) = match index.checked_sub(1).map(|i| &self.collapses[i]) {
            Some(before) => (before.moved_end, before.removed_end),
            None => (0, 0),
        };
        (
            collapse,
            &self.moved[moved as usize..collapse.moved_end as usize],
            &self.removed[removed as usize..collapse.removed_end as usize],
        )
    }

    /// Wedges of the faces that one collapse removed.
    pub(crate) fn removed_wedges(&self, index: usize) -> &[[u32; 3]] {
        let from = index.checked_sub(1).map_or(0, |i| self.collapses[i].removed_end);
        &self.removed_wedges[from as usize..self.collapses[index].removed_end as usize]
    }

    /// Drops all but the first `count` collapses.
    pub(crate) fn truncate(&mut self, count: usize) {
        self.collapses.truncate(count);
        self.costs.truncate(count);
        let (moved, removed, added_wedges) =
            self.collapses.last().map_or((0, 0, 0), |c| (c.moved_end, c.removed_end, c.added_wedges_end));
        self.moved.truncate(moved as usize);
        self.removed.truncate(removed as usize);
        self.added_wedges.truncate(added_wedges as usize);
        self.shrink();
    }

    /// Releases spare capacity: the records of all regions of a level are in memory together.
    pub(crate) fn shrink(&mut self) {
        self.collapses.shrink_to_fit();
        self.costs.shrink_to_fit();
        self.moved.shrink_to_fit();
        self.removed.shrink_to_fit();
        self.added_wedges.shrink_to_fit();
    }

    /// Chooses the truncation points: `parts` equal parts, or fewer so that each has at least `least` collapses.
    /// Errors fall about in proportion to the number of splits.
    pub(crate) fn choose_truncation_points(&mut self, parts: usize, least: usize) {
        let total = self.collapses.len();
        let parts = parts.min(total / least.max(1)).max(1);
        self.truncation_points = (1..parts).rev().map(|part| (total * part / parts) as u32).collect();
    }

    /// The largest count of collapses, at most `count`, that does not divide collapses of equal cost: a component that
    /// vanishes as a whole, if it has at most `most` vertices. Needs the costs.
    pub(crate) fn aligned(&self, count: usize, most: usize) -> usize {
        let divides = |count: usize| count > 0 && self.costs.get(count) == self.costs.get(count - 1);
        let start = (count.saturating_sub(most)..=count).rev().find(|&count| !divides(count));
        start.unwrap_or(count)
    }

    /// Aligns the truncation points ([`Self::aligned`]).
    pub(crate) fn align_truncation_points(&mut self, most: usize) {
        let mut points: Vec<u32> =
            self.truncation_points.iter().map(|&point| self.aligned(point as usize, most) as u32).collect();
        points.dedup();
        points.retain(|&point| point > 0);
        self.truncation_points = points;
    }

    /// The truncation points that are encoded, as indices of [`Records::truncation_points`]: only the middle one.
    /// Each costs about 0.5 bits per split, because the order of the splits must be encoded; errors are measured at
    /// all of them.
    pub(crate) fn coded_truncation_points(&self) -> Range<usize> {
        let middle = self.truncation_points.len() / 2;
        middle..(middle + 1).min(self.truncation_points.len())
    }
}
