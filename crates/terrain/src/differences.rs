//! Applying height overrides: a second field, interpolated like the first but without offsets, that takes given
//! values at overridden points and is added to the generated heights.
//!
//! At a fixed point its value is the given height minus the generated one; at an additive point it is the given
//! change. Because it is interpolated like diamond-square, the result is what diamond-square would give with the
//! overridden heights inserted during generation; but overrides may be set in any order.

use super::mode::Mode;
use super::numbers::{saturate, signed};
use super::patch_overrides::{OverrideDelta, PatchOverrides, row_points};
use super::points::HeightOverrides;
use super::rect::Rect;
use super::refine::{Detail, View, refine};
use super::window::{Buffers, Scratch, descend};
use super::world::Terrain;

/// Side, in finest points, of the blocks in which the heights below fixed points are generated.
const BLOCK: u16 = 64;
/// A block is generated as a whole if it has at most this many points per override, else point by point.
const SPARSE: usize = 64;

/// The difference field of a level: no offsets, given values at overridden points.
struct GivenDifferences<'a> {
    points: &'a [OverrideDelta],
    /// The patch's first point in the level.
    origin: (i64, i64),
}

impl Detail<i64> for GivenDifferences<'_> {
    type Row = ();
    #[inline(always)]
    fn row(&self, _x: i64, _y: i64) {}
    #[inline(always)]
    fn add(&self, _row: (), _column: usize, mean: i64) -> i64 {
        mean
    }
    fn give(&self, x: i64, y: i64, row: &mut [i64]) {
        let at = (x - self.origin.0, y - self.origin.1);
        row_points(self.points, at, row.len(), |column, point| row[column] = point.difference);
    }
}

/// The differences in a rectangle inside a patch's closed square, at a level from 0 on. Returns false if all are 0.
fn window(
    patch: &PatchOverrides,
    (px, py): (i64, i64),
    level: u8,
    rect: Rect,
    buffers: &mut Buffers<i64>,
    out: &mut Vec<i64>,
) -> bool {
    let Some(first) = patch.first_level().filter(|&first| first <= level) else { return false };
    let given =
        |level: u8| GivenDifferences { points: patch.level(level), origin: (px << level, py << level) };
    let corners = |rect: Rect, out: &mut Vec<i64>| {
        out.clear();
        out.resize(rect.len(), 0);
        if first == 0 {
            for (row, y) in out.chunks_mut(rect.width).zip(rect.y..) {
                given(0).give(rect.x, y, row);
            }
        }
    };
    let step = |parent: View<'_, i64>, level: u8, out: &mut [i64]| refine(parent, level, &given(level), out);
    descend(rect, first.saturating_sub(1), level, buffers, out, corners, step);
    true
}

impl Terrain {
    /// Computes the differences that the height overrides of patch (`px`, `py`) make.
    pub(super) fn differences(&self, px: i64, py: i64, points: HeightOverrides) -> PatchOverrides {
        let n = self.parameters.finest_level;
        let mut levels = vec![Vec::new(); usize::from(n) + 1];
        let under = self.heights_under(px, py, &points);
        for (point, under) in points.as_slice().iter().zip(under) {
            let zeros = (point.x | point.y | 1 << n).trailing_zeros();
            let difference = match point.mode {
                Mode::Additive => i64::from(point.height),
                Mode::Fixed => i64::from(point.height) - i64::from(under),
            };
            let (x, y) = (point.x >> zeros, point.y >> zeros);
            levels[usize::from(n) - zeros as usize].push(OverrideDelta {
                y,
                x,
                mode: point.mode,
                difference,
            });
        }
        levels.iter_mut().for_each(Vec::shrink_to_fit);
        PatchOverrides { points, levels }
    }

    /// Generated heights at fixed points (0 at others), block by block, so that memory is that of one block.
    fn heights_under(&self, px: i64, py: i64, points: &HeightOverrides) -> Vec<i32> {
        let n = self.parameters.finest_level;
        let points = points.as_slice();
        let mut under = vec![0; points.len()];
        let mut fixed: Vec<usize> = (0..points.len()).filter(|&i| points[i].mode == Mode::Fixed).collect();
        fixed.sort_by_key(|&i| (points[i].y / BLOCK, points[i].x / BLOCK));
        let mut scratch = Scratch::new();
        let mut heights = Vec::new();
        for block in fixed.chunk_by(|&i, &j| {
            (points[i].y / BLOCK, points[i].x / BLOCK) == (points[j].y / BLOCK, points[j].x / BLOCK)
        }) {
            let span = |of: &dyn Fn(usize) -> u16| {
                block.iter().fold((u16::MAX, 0), |(low, high), &i| (low.min(of(i)), high.max(of(i))))
            };
            let ((left, right), (top, bottom)) = (span(&|i| points[i].x), span(&|i| points[i].y));
            let at = |x: u16, y: u16| ((px << n) + i64::from(x), (py << n) + i64::from(y));
            let (x, y) = at(left, top);
            let (x_end, y_end) = at(right, bottom);
            let rect = Rect::from_corners(x, y, x_end, y_end);
            if rect.len() <= SPARSE * block.len() {
                self.stamped(signed(n), rect, &mut scratch.heights, &mut heights);
                for &i in block {
                    let (column, row) = (points[i].x - left, points[i].y - top);
                    under[i] = heights[usize::from(row) * rect.width + usize::from(column)];
                }
            } else {
                for &i in block {
                    let (x, y) = at(points[i].x, points[i].y);
                    self.stamped(signed(n), Rect::new(x, y, 1, 1), &mut scratch.heights, &mut heights);
                    under[i] = heights[0];
                }
            }
        }
        under
    }

    /// Adds the effect of height overrides to the heights of a rectangle.
    pub(super) fn add_differences(&self, level: i8, rect: Rect, scratch: &mut Scratch, heights: &mut [i32]) {
        if self.patches.is_empty() {
            return;
        }
        let Ok(fine) = u8::try_from(level) else {
            let sparse = u32::from(level.unsigned_abs());
            for (&(px, py), patch) in self.patches_near(level, rect) {
                for corner in self.owned_points(px, py, 0) {
                    let at = Rect::new(corner.x >> sparse, corner.y >> sparse, 1, 1);
                    if (corner.x | corner.y) & ((1 << sparse) - 1) == 0 && rect.intersection(&at).is_some() {
                        let mut change = [0];
                        GivenDifferences { points: patch.level(0), origin: (px, py) }.give(
                            corner.x,
                            corner.y,
                            &mut change,
                        );
                        let i = rect.index_of(at.x, at.y);
                        heights[i] = saturate(i64::from(heights[i]) + change[0]);
                    }
                }
            }
            return;
        };
        let Scratch { differences, sums, .. } = scratch;
        for (&(px, py), patch) in self.patches_near(level, rect) {
            for owned_points in self.owned_points(px, py, fine) {
                let Some(part) = rect.intersection(&owned_points) else { continue };
                if !window(patch, (px, py), fine, part, differences, sums) {
                    continue;
                }
                for (row, changes) in sums.chunks(part.width).enumerate() {
                    let start = rect.index_of(part.x, part.y) + row * rect.width;
                    for (height, change) in heights[start..][..part.width].iter_mut().zip(changes) {
                        *height = saturate(i64::from(*height) + change);
                    }
                }
            }
        }
    }

    /// The points of a level whose differences this patch adds: all except those on a right or lower border that
    /// another patch with overrides adds. Border points are overridden in both patches, so either may add them.
    fn owned_points(&self, px: i64, py: i64, level: u8) -> impl Iterator<Item = Rect> {
        let has = |dx: i64, dy: i64| self.patches.contains_key(&(px + dx, py + dy));
        let (x, y, side) = (px << level, py << level, 1_usize << level);
        let (right, below) = ((px + 1) << level, (py + 1) << level);
        let parts = [
            Some(Rect::new(x, y, side, side)),
            (!has(1, 0)).then(|| Rect::new(right, y, 1, side)),
            (!has(0, 1) && side > 1).then(|| Rect::new(x + 1, below, side - 1, 1)),
            (!has(0, 1) && !has(-1, 1)).then(|| Rect::new(x, below, 1, 1)),
            (!has(1, 1) && !has(0, 1) && !has(1, 0)).then(|| Rect::new(right, below, 1, 1)),
        ];
        parts.into_iter().flatten()
    }

    /// The patches with overrides that begin in a rectangle, or before it and extend into it; may include others.
    pub(super) fn patches_near(
        &self,
        level: i8,
        rect: Rect,
    ) -> impl Iterator<Item = (&(i64, i64), &PatchOverrides)> {
        let patch = |at: i64| if level < 0 { at << -level } else { at >> level };
        let world = 1_i64 << self.parameters.extent_log2;
        let clamp = |at: i64| patch(at).clamp(-world, world - 1);
        // A rectangle that begins on a border also needs the patch before it.
        let (left, right) = (clamp(rect.x - 1), clamp(rect.right()));
        let (top, bottom) = (clamp(rect.y - 1), clamp(rect.bottom()));
        self.patches
            .range((left, top)..=(right, bottom))
            .filter(move |((_, py), _)| (top..=bottom).contains(py))
            .map(|(at, patch)| (at, &**patch))
    }
}
