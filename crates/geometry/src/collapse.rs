//! What a region's simplification did, in the order it was done: enough to redo and to undo it. Simplification
//! writes it; the encoder reads it backwards.

use std::ops::Range;

/// Stands for the target of a vertex without faces, which is dropped.
pub(crate) const NO_VERTEX: u32 = u32::MAX;

/// Where a vertex is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Placed {
    pub(crate) vertex: u32,
    pub(crate) cell: [i32; 3],
    /// How many of the lowest bits of `cell` are known to be zero.
    pub(crate) shift: u8,
}

/// A corner of a face that moved with a collapse.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct MovedCorner {
    pub(crate) face: u32,
    /// Wedge of the removed vertex.
    pub(crate) from: u32,
    /// Wedge of the vertex that stays.
    pub(crate) to: u32,
}

/// A face that vanished with a collapse.
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

    /// The same by other ids.
    pub(crate) fn renamed(&self, face: impl Fn(u32) -> u32, vertex: impl Fn(u32) -> u32) -> Self {
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
    pub(crate) kept_end: u32,
}

/// The collapses of one region in one level.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Records {
    pub(crate) collapses: Vec<Collapse>,
    /// Largest cost so far in this region, by collapse; forgotten once it is known how many there are.
    pub(crate) costs: Vec<f64>,
    pub(crate) moved: Vec<MovedCorner>,
    pub(crate) removed: Vec<RemovedFace>,
    /// Wedges of these faces when they vanished. Empty until a level is put away: so long, faces that are dead tell.
    pub(crate) vanished: Vec<[u32; 3]>,
    /// Wedges that a collapse kept: the source wedge of each. Until [`Records::commit`] they are
    /// numbered from `first_kept` on.
    pub(crate) kept: Vec<u32>,
    pub(crate) first_kept: u32,
    /// How many collapses are left at each point between none and all undone where a client may stop,
    /// coarse to fine, so descending.
    pub(crate) truncation_points: Vec<u32>,
    /// No input vertex is farther from the vertex that it was collapsed to; infinite where faces
    /// vanished without one. So long as each point of a face is taken to the same place between the
    /// face's corners, that bounds the distance of the surfaces, both ways.
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

    /// Wedges of the faces that vanished with one collapse.
    pub(crate) fn vanished(&self, index: usize) -> &[[u32; 3]] {
        let from = index.checked_sub(1).map_or(0, |i| self.collapses[i].removed_end);
        &self.vanished[from as usize..self.collapses[index].removed_end as usize]
    }

    /// Keeps the first `count` collapses only.
    pub(crate) fn truncate(&mut self, count: usize) {
        self.collapses.truncate(count);
        self.costs.truncate(count);
        let (moved, removed, kept) =
            self.collapses.last().map_or((0, 0, 0), |c| (c.moved_end, c.removed_end, c.kept_end));
        self.moved.truncate(moved as usize);
        self.removed.truncate(removed as usize);
        self.kept.truncate(kept as usize);
        self.shrink();
    }

    /// Gives back the room that grew with the lists: all regions of a level are kept at once.
    pub(crate) fn shrink(&mut self) {
        self.collapses.shrink_to_fit();
        self.costs.shrink_to_fit();
        self.moved.shrink_to_fit();
        self.removed.shrink_to_fit();
        self.kept.shrink_to_fit();
    }

    /// Chooses the truncation_points: `parts` equal parts as long as each has `least` collapses, since errors fall
    /// about in proportion to what is undone.
    pub(crate) fn choose_truncation_points(&mut self, parts: usize, least: usize) {
        let total = self.collapses.len();
        let parts = parts.min(total / least.max(1)).max(1);
        self.truncation_points = (1..parts).rev().map(|part| (total * part / parts) as u32).collect();
    }

    /// The truncation_points that are coded, as places in [`Records::truncation_points`]: the middle one. Each costs about 0.5 bits a
    /// split, because which vertices go first must be said; errors are measured at all of them.
    pub(crate) fn coded_truncation_points(&self) -> Range<usize> {
        let middle = self.truncation_points.len() / 2;
        middle..(middle + 1).min(self.truncation_points.len())
    }
}
