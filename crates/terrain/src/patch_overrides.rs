//! The height overrides of one patch, sorted by the level in which each point first appears.

use super::mode::Mode;
use super::numbers::{index, span};
use super::points::HeightOverrides;

/// The change at one height override, in the patch's coordinates of the level in which its point first appears.
#[derive(Clone, Copy, Debug)]
pub(super) struct OverrideDelta {
    pub(super) y: u16,
    pub(super) x: u16,
    pub(super) mode: Mode,
    /// Added to the generated height.
    pub(super) difference: i64,
}

/// The height overrides of one patch, with the change that each makes, by level.
#[derive(Clone, Debug)]
pub(super) struct PatchOverrides {
    pub(super) points: HeightOverrides,
    /// By level, each sorted by row and then column.
    pub(super) levels: Vec<Vec<OverrideDelta>>,
}

impl PatchOverrides {
    /// The points of a level, sorted.
    pub(super) fn level(&self, level: u8) -> &[OverrideDelta] {
        self.levels.get(usize::from(level)).map_or(&[], Vec::as_slice)
    }

    /// The coarsest level with points.
    pub(super) fn first_level(&self) -> Option<u8> {
        (0..).zip(&self.levels).find(|(_, points)| !points.is_empty()).map(|(level, _)| level)
    }

    /// Memory held, in bytes.
    pub(super) fn bytes(&self) -> usize {
        let deltas: usize =
            self.levels.iter().map(|level| level.capacity() * size_of::<OverrideDelta>()).sum();
        deltas + size_of_val(self.points.as_slice())
    }
}

/// The points in a range of rows, among points sorted by row and column.
fn rows(points: &[OverrideDelta], first: i64, last: i64) -> &[OverrideDelta] {
    let from = points.partition_point(|p| i64::from(p.y) < first);
    let to = points.partition_point(|p| i64::from(p.y) <= last);
    &points[from..to]
}

/// Calls `each` with column and point for the points of a row at `y` that starts at `x`.
pub(super) fn row_points(
    points: &[OverrideDelta],
    (x, y): (i64, i64),
    width: usize,
    mut each: impl FnMut(usize, &OverrideDelta),
) {
    let row = rows(points, y, y);
    let from = row.partition_point(|p| i64::from(p.x) < x);
    for point in &row[from..] {
        let column = i64::from(point.x) - x;
        if column >= span(width) {
            break;
        }
        each(index(column), point);
    }
}
