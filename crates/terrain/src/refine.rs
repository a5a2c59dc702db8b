//! One step of diamond-square: from a rectangle of points to the points on and between them.
//!
//! Fournier, Fussell and Carpenter, "Computer rendering of stochastic models", CACM 25(6), 1982; in the form with
//! centres and then edge midpoints that average two ends and two centres (described, with its artefacts, by Miller,
//! "The definition and rendering of terrain maps", SIGGRAPH 1986). Midpoints on a patch border average their two ends
//! only: a border depends on itself alone, so neighbours agree on it.

use super::noise::{LevelNoise, RowNoise};
use super::numbers::{index, span};
use super::rect::Rect;

/// A value that can be averaged: a height or a difference.
pub(super) trait Value: Copy + Default {
    /// (a + b + 1) / 2, rounded down.
    fn mean2(a: Self, b: Self) -> Self;
    /// (a + b + c + d + 2) / 4, rounded down.
    fn mean4(a: Self, b: Self, c: Self, d: Self) -> Self;
}

impl Value for i32 {
    // Magnitudes are below 2^29 (Parameters::check), so the sums fit.
    #[inline(always)]
    fn mean2(a: i32, b: i32) -> i32 {
        (a + b + 1) >> 1
    }
    #[inline(always)]
    fn mean4(a: i32, b: i32, c: i32, d: i32) -> i32 {
        (a + b + c + d + 2) >> 2
    }
}

impl Value for i64 {
    // Magnitudes are those of a few differences of 32-bit numbers.
    #[inline(always)]
    fn mean2(a: i64, b: i64) -> i64 {
        (a + b + 1) >> 1
    }
    #[inline(always)]
    fn mean4(a: i64, b: i64, c: i64, d: i64) -> i64 {
        (a + b + c + d + 2) >> 2
    }
}

/// The detail that a level adds to averages.
pub(super) trait Detail<V> {
    /// State of one row.
    type Row: Copy;
    /// Starts a row whose first point is (x, y).
    fn row(&self, x: i64, y: i64) -> Self::Row;
    /// The average `mean` at the point `column` to the right of the row's first, with its detail added.
    fn add(&self, row: Self::Row, column: usize, mean: V) -> V;
    /// Sets points of a row that are given instead of averaged: those that are new in the level. Called when the
    /// row's centres are complete, before they are averaged, and when the row is complete.
    fn give(&self, x: i64, y: i64, row: &mut [V]);
}

/// Random offsets, without given values.
pub(super) struct Offsets<'a, const GAUSSIAN: bool>(pub(super) &'a LevelNoise);

impl<const GAUSSIAN: bool> Detail<i32> for Offsets<'_, GAUSSIAN> {
    type Row = RowNoise;
    #[inline(always)]
    fn row(&self, x: i64, y: i64) -> RowNoise {
        self.0.row(x, y)
    }
    #[inline(always)]
    fn add(&self, row: RowNoise, column: usize, mean: i32) -> i32 {
        mean + self.0.offset::<GAUSSIAN>(row.hash(column))
    }
    #[inline(always)]
    fn give(&self, _x: i64, _y: i64, _row: &mut [i32]) {}
}

/// Values of a rectangle inside a larger row-major array.
#[derive(Clone, Copy)]
pub(super) struct View<'a, V> {
    pub(super) values: &'a [V],
    pub(super) stride: usize,
    pub(super) rect: Rect,
}

impl<'a, V> View<'a, V> {
    fn row(&self, row: usize) -> &'a [V] {
        &self.values[row * self.stride..][..self.rect.width]
    }
}

/// Fills `out` with the points of `level` ≥ 1 on and between those of `parent`, row by row.
///
/// The outermost rows and columns average along themselves, as is correct on a patch border; elsewhere their new
/// points are wrong, and [`Rect::parent`] ensures that they are not used.
pub(super) fn refine<V: Value, D: Detail<V>>(parent: View<'_, V>, level: u8, detail: &D, out: &mut [V]) {
    let Rect { x, y, width, height } = parent.rect.child();
    let border = (1_i64 << level) - 1;
    // Columns of the parent (relative to its first) that are patch borders.
    let first_border = index((-(x >> 1)).rem_euclid(1 << (level - 1)));
    let cells = parent.rect.width - 1;
    for j in 0..parent.rect.height {
        let above = parent.row(j);
        if j + 1 < parent.rect.height {
            let row_y = y + 2 * span(j) + 1;
            let row = &mut out[(2 * j + 1) * width..][..width];
            between_rows(above, parent.row(j + 1), x, row_y, detail, row);
            detail.give(x, row_y, row);
            let below = parent.row(j + 1);
            let of = detail.row(x, row_y);
            for i in 1..cells {
                let mean = V::mean4(above[i], below[i], row[2 * i - 1], row[2 * i + 1]);
                row[2 * i] = detail.add(of, 2 * i, mean);
            }
            for i in [0, cells].into_iter().chain((first_border..cells).step_by(1 << (level - 1))) {
                row[2 * i] = detail.add(of, 2 * i, V::mean2(above[i], below[i]));
            }
            detail.give(x, row_y, row);
        }
        let row_y = y + 2 * span(j);
        let edge = j == 0 || j + 1 == parent.rect.height || row_y & border == 0;
        let (before, rest) = out.split_at_mut(2 * j * width);
        let (row, after) = rest.split_at_mut(width);
        let of = detail.row(x, row_y);
        row[0] = above[0];
        if edge {
            for i in 0..cells {
                row[2 * i + 1] = detail.add(of, 2 * i + 1, V::mean2(above[i], above[i + 1]));
                row[2 * i + 2] = above[i + 1];
            }
        } else {
            let (upper, lower) = (&before[(2 * j - 1) * width..], &after[..width]);
            for i in 0..cells {
                let mean = V::mean4(above[i], above[i + 1], upper[2 * i + 1], lower[2 * i + 1]);
                row[2 * i + 1] = detail.add(of, 2 * i + 1, mean);
                row[2 * i + 2] = above[i + 1];
            }
        }
        detail.give(x, row_y, row);
    }
    debug_assert_eq!(out.len(), width * height);
}

/// The centres between two rows of points: the odd columns of the row between.
#[inline(always)]
fn between_rows<V: Value, D: Detail<V>>(above: &[V], below: &[V], x: i64, y: i64, detail: &D, row: &mut [V]) {
    let of = detail.row(x, y);
    for i in 0..above.len() - 1 {
        let mean = V::mean4(above[i], above[i + 1], below[i], below[i + 1]);
        row[2 * i + 1] = detail.add(of, 2 * i + 1, mean);
    }
}
