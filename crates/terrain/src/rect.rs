//! Rectangles of grid points, and the points of the next coarser level that they depend on.

use super::numbers::{index, span};

/// Points of one level, in global coordinates of that level.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Rect {
    pub(super) x: i64,
    pub(super) y: i64,
    pub(super) width: usize,
    pub(super) height: usize,
}

impl Rect {
    pub(super) fn new(x: i64, y: i64, width: usize, height: usize) -> Self {
        Self { x, y, width, height }
    }

    /// The last column.
    pub(super) fn right(&self) -> i64 {
        self.x + span(self.width) - 1
    }

    /// The last row.
    pub(super) fn bottom(&self) -> i64 {
        self.y + span(self.height) - 1
    }

    /// Index of a point in the rectangle's row-major list.
    pub(super) fn index_of(&self, x: i64, y: i64) -> usize {
        index(y - self.y) * self.width + index(x - self.x)
    }

    pub(super) fn len(&self) -> usize {
        self.width * self.height
    }

    /// The points of `level` - 1 that this rectangle of `level` ≥ 1 depends on: those around it, and at sides that
    /// are not patch borders also those for the centres beside it.
    pub(super) fn parent(&self, level: u8) -> Self {
        let (x, width) = parent_span(self.x, self.right(), level);
        let (y, height) = parent_span(self.y, self.bottom(), level);
        Self { x, y, width, height }
    }

    /// The points of the next finer level on and between these.
    pub(super) fn child(&self) -> Self {
        Self::new(2 * self.x, 2 * self.y, 2 * self.width - 1, 2 * self.height - 1)
    }

    /// The common points; `None` if there are none.
    pub(super) fn intersection(&self, other: &Self) -> Option<Self> {
        let (x, y) = (self.x.max(other.x), self.y.max(other.y));
        let (right, bottom) = (self.right().min(other.right()), self.bottom().min(other.bottom()));
        (x <= right && y <= bottom).then(|| Self::from_corners(x, y, right, bottom))
    }

    /// The rectangle between two points, inclusive.
    pub(super) fn from_corners(x: i64, y: i64, right: i64, bottom: i64) -> Self {
        Self::new(x, y, index(right - x + 1), index(bottom - y + 1))
    }
}

fn parent_span(first: i64, last: i64, level: u8) -> (i64, usize) {
    let on_border = |c: i64| c & ((1 << level) - 1) == 0;
    let from = if on_border(first) { first >> 1 } else { (first - 1) >> 1 };
    let to = if on_border(last) { last >> 1 } else { (last + 2) >> 1 };
    (from, index(to - from + 1))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_patch_needs_only_itself() {
        let patch = Rect::new(-3 * 16, 5 * 16, 17, 17);
        assert_eq!(patch.parent(4), Rect::new(-3 * 8, 5 * 8, 9, 9));
        assert_eq!(patch.parent(4).child(), patch);
    }

    #[test]
    fn a_point_needs_the_centres_around_it() {
        // Inside a patch of 16 cells: columns 4 to 8 of the finer level around an even point, 4 to 6 around an odd
        // one.
        assert_eq!(Rect::new(6, 5, 1, 1).parent(4), Rect::new(2, 2, 3, 2));
    }
}
