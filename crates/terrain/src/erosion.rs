//! Spike removal and thermal erosion of one level.
//!
//! Thermal erosion after Musgrave, Kolb and Mace, "The synthesis and rendering of eroded fractal terrains", SIGGRAPH
//! 1989: where neighbours differ by more than the talus, part of the excess slides. All slides of a pass are computed
//! from the heights before it (Jacobi iteration), so the order does not matter and material is conserved. Spikes of
//! diamond-square (Miller 1986) are points outside the range of their neighbours.
//!
//! A point's height depends on points at most [`Erosion::margin`] away, so any rectangle can be eroded separately
//! with that margin, and neighbouring rectangles agree.

use super::mode::Mode;
use super::numbers::{index, saturate, signed, span};
use super::parameters::Erosion;
use super::patch_overrides::PatchOverrides;
use super::patch_overrides::{OverrideDelta, row_points};
use super::rect::Rect;
use super::refine::{Detail, View, refine};
use super::window::{Scratch, descend, needed};
use super::world::Terrain;

/// Side of the largest block of the erosion level that is eroded at once for a coarser level.
const BLOCK_SIDE: usize = 512;
/// Share of an excess that slides to one neighbour in a pass, as a shift: an eighth, so that four neighbours leave
/// half.
const SLIDE_SHIFT: u32 = 3;

/// Changes by erosion at a level finer than the eroded one: interpolated, except at fixed points.
struct ErosionDifferences<'a> {
    patches: &'a [(&'a (i64, i64), &'a PatchOverrides)],
    level: u8,
}

impl ErosionDifferences<'_> {
    /// Calls `each` with the column of every fixed point in a row of the level.
    fn fixed(&self, x: i64, y: i64, width: usize, mut each: impl FnMut(usize)) {
        for ((px, py), patch) in self.patches {
            let at = (x - (px << self.level), y - (py << self.level));
            row_points(patch.level(self.level), at, width, |column, point: &OverrideDelta| {
                if point.mode == Mode::Fixed {
                    each(column);
                }
            });
        }
    }
}

impl Detail<i64> for ErosionDifferences<'_> {
    type Row = ();
    #[inline(always)]
    fn row(&self, _x: i64, _y: i64) {}
    #[inline(always)]
    fn add(&self, _row: (), _column: usize, mean: i64) -> i64 {
        mean
    }
    fn give(&self, x: i64, y: i64, row: &mut [i64]) {
        self.fixed(x, y, row.len(), |column| row[column] = 0);
    }
}

impl Terrain {
    /// The heights of a rectangle with erosion, which must be on.
    pub(super) fn eroded_window(&self, level: i8, rect: Rect, scratch: &mut Scratch, out: &mut Vec<i32>) {
        let eroding = self.parameters.erosion.level;
        if i32::from(level) < i32::from(eroding) {
            let sparse = i32::from(eroding).abs_diff(i32::from(level));
            return self.eroded_subset(rect, sparse, scratch, out);
        }
        let level = level.unsigned_abs();
        let coarse = needed(rect, eroding, level);
        let mut eroded = Vec::new();
        self.erode(coarse, scratch, &mut eroded);
        if level == eroding {
            *out = eroded;
            return;
        }
        self.featured(signed(eroding), coarse, scratch, out);
        let differences: Vec<i64> =
            eroded.iter().zip(&*out).map(|(&after, &before)| i64::from(after) - i64::from(before)).collect();
        self.featured(signed(level), rect, scratch, out);
        let patches: Vec<_> = self.patches_near(signed(level), rect).collect();
        let Scratch { differences: buffers, sums, .. } = scratch;
        let step = |parent: View<'_, i64>, level: u8, out: &mut [i64]| {
            refine(parent, level, &ErosionDifferences { patches: &patches, level }, out);
        };
        descend(rect, eroding, level, buffers, sums, |_, out| *out = differences, step);
        for (height, change) in out.iter_mut().zip(&*sums) {
            *height = saturate(i64::from(*height) + change);
        }
    }

    /// Every 2^`sparse`th point of the eroded level.
    fn eroded_subset(&self, rect: Rect, sparse: u32, scratch: &mut Scratch, out: &mut Vec<i32>) {
        // If points are farther apart than erosion reaches, each is eroded separately.
        let margin = self.parameters.erosion.margin();
        let side = if (1_usize << sparse) > 2 * margin + 1 { 1 } else { (BLOCK_SIDE >> sparse).max(1) };
        out.clear();
        out.resize(rect.len(), 0);
        let mut eroded = Vec::new();
        for top in (0..rect.height).step_by(side) {
            for left in (0..rect.width).step_by(side) {
                let (width, height) = (side.min(rect.width - left), side.min(rect.height - top));
                let block = Rect::new(
                    (rect.x + span(left)) << sparse,
                    (rect.y + span(top)) << sparse,
                    ((width - 1) << sparse) + 1,
                    ((height - 1) << sparse) + 1,
                );
                self.erode(block, scratch, &mut eroded);
                for row in 0..height {
                    let from = &eroded[(row << sparse) * block.width..][..block.width];
                    let to = &mut out[(top + row) * rect.width + left..][..width];
                    to.iter_mut().zip(from.iter().step_by(1 << sparse)).for_each(|(to, from)| *to = *from);
                }
            }
        }
    }

    /// The heights of a rectangle of the eroded level.
    fn erode(&self, rect: Rect, scratch: &mut Scratch, out: &mut Vec<i32>) {
        let erosion = self.parameters.erosion;
        let margin = erosion.margin();
        let m = span(margin);
        let grown = Rect::new(rect.x - m, rect.y - m, rect.width + 2 * margin, rect.height + 2 * margin);
        let mut heights = Vec::new();
        self.featured(signed(erosion.level), grown, scratch, &mut heights);
        let fixed_points = self.fixed_points(erosion.level, grown);
        let mut next = heights.clone();
        if erosion.spike_limit > 0 {
            let range = self.parameters.ranges()[usize::from(erosion.level)];
            let limit = (i64::from(range) * i64::from(erosion.spike_limit)) >> 4;
            pass(&heights, grown.width, 1, &mut next, |around, out| remove_spikes(around, limit, out));
            restore_fixed(&fixed_points, &heights, &mut next);
            std::mem::swap(&mut heights, &mut next);
        }
        let talus = (i64::from(self.parameters.amplitude) * i64::from(erosion.talus)) >> 16;
        // Heights stay within their range, so narrow ones remain narrow.
        let narrow = talus <= i64::from(NARROW) && are_narrow(&heights);
        // Later passes need a smaller margin than earlier ones: a single point costs a third of its square.
        let first = margin + 1 - usize::from(erosion.passes);
        for ring in first..=margin {
            if narrow {
                pass(&heights, grown.width, ring, &mut next, |around, out| slide::<true>(around, talus, out));
            } else {
                pass(&heights, grown.width, ring, &mut next, |around, out| {
                    slide::<false>(around, talus, out)
                });
            }
            restore_fixed(&fixed_points, &heights, &mut next);
            std::mem::swap(&mut heights, &mut next);
        }
        out.clear();
        for row in heights.chunks(grown.width).skip(margin).take(rect.height) {
            out.extend_from_slice(&row[margin..margin + rect.width]);
        }
    }

    /// Indices of fixed points of the levels up to `level` in a rectangle of it.
    fn fixed_points(&self, level: u8, rect: Rect) -> Vec<usize> {
        let mut fixed_points = Vec::new();
        for (&(px, py), patch) in self.patches_near(signed(level), rect) {
            for appears in 0..=level {
                let shift = level - appears;
                for point in patch.level(appears).iter().filter(|p| p.mode == Mode::Fixed) {
                    let x = (px << level) + (i64::from(point.x) << shift) - rect.x;
                    let y = (py << level) + (i64::from(point.y) << shift) - rect.y;
                    if (0..span(rect.width)).contains(&x) && (0..span(rect.height)).contains(&y) {
                        fixed_points.push(index(y) * rect.width + index(x));
                    }
                }
            }
        }
        fixed_points
    }
}

impl Erosion {
    /// Distance around a patch, in finest grid units, within which other patches' features affect its heights.
    #[must_use]
    pub fn reach(&self, finest_level: u8) -> i64 {
        span(self.margin()) << finest_level.saturating_sub(self.level)
    }
}

/// Inner part of a row with its neighbouring rows and columns, all of equal length.
struct Neighbourhood<'a> {
    row: &'a [i32],
    left: &'a [i32],
    right: &'a [i32],
    above: [&'a [i32]; 3],
    below: [&'a [i32]; 3],
}

/// Computes every point of a row-major array, except its outermost `ring` ≥ 1 rows and columns, from the points
/// around it. The rim of `next` is unchanged.
#[inline(always)]
fn pass(
    heights: &[i32],
    width: usize,
    ring: usize,
    next: &mut [i32],
    rule: impl Fn(&Neighbourhood<'_>, &mut [i32]),
) {
    if width <= 2 * ring {
        return;
    }
    let inner = width - 2 * ring;
    for y in ring..heights.len() / width - ring {
        let part = |y: usize, x: usize| &heights[y * width + x..][..inner];
        let three = |y: usize| [ring - 1, ring, ring + 1].map(|x| part(y, x));
        let around = Neighbourhood {
            row: part(y, ring),
            left: part(y, ring - 1),
            right: part(y, ring + 1),
            above: three(y - 1),
            below: three(y + 1),
        };
        rule(&around, &mut next[y * width + ring..][..inner]);
    }
}

/// Largest magnitude for which all arithmetic fits in 32 bits. Heights without features are always below.
const NARROW: i32 = 1 << 29;

fn are_narrow(heights: &[i32]) -> bool {
    heights.iter().all(|h| (-NARROW..=NARROW).contains(h))
}

/// Restores fixed points.
fn restore_fixed(fixed_points: &[usize], heights: &[i32], next: &mut [i32]) {
    for &i in fixed_points {
        next[i] = heights[i];
    }
}

/// Clamps heights to at most `limit` outside the range of their eight neighbours.
fn remove_spikes(around: &Neighbourhood<'_>, limit: i64, out: &mut [i32]) {
    let Neighbourhood { row, left, right, above, below } = around;
    // Equal slice lengths eliminate bounds checks.
    let n = out.len();
    let [row, left, right] = [row, left, right].map(|part| &part[..n]);
    let [above, below] = [above, below].map(|three| three.map(|part| &part[..n]));
    for i in 0..n {
        let (mut low, mut high) = (left[i].min(right[i]), left[i].max(right[i]));
        for part in above.iter().chain(&below) {
            (low, high) = (low.min(part[i]), high.max(part[i]));
        }
        out[i] = saturate(i64::from(row[i]).clamp(i64::from(low) - limit, i64::from(high) + limit));
    }
}

/// Heights after slides to and from the four neighbours. `NARROW` if heights and talus are.
fn slide<const NARROW: bool>(around: &Neighbourhood<'_>, talus: i64, out: &mut [i32]) {
    let Neighbourhood { row, left, right, above, below } = around;
    let n = out.len();
    let [row, left, right, above, below] = [*row, *left, *right, above[1], below[1]].map(|part| &part[..n]);
    // Exact if `NARROW`.
    let narrow = saturate(talus);
    for i in 0..n {
        let height = row[i];
        let neighbours = [left[i], right[i], above[i], below[i]];
        out[i] = if NARROW {
            let from = |neighbour: i32| {
                let difference = neighbour - height;
                ((difference - narrow).max(0) >> SLIDE_SHIFT) - ((-difference - narrow).max(0) >> SLIDE_SHIFT)
            };
            height + neighbours.map(from).iter().sum::<i32>()
        } else {
            let from = |neighbour: i32| {
                let difference = i64::from(neighbour) - i64::from(height);
                ((difference - talus).max(0) >> SLIDE_SHIFT) - ((-difference - talus).max(0) >> SLIDE_SHIFT)
            };
            let slid = i64::from(height) + neighbours.map(from).iter().sum::<i64>();
            #[expect(
                clippy::cast_possible_truncation,
                reason = "between the lowest and the highest of the five"
            )]
            let slid = slid as i32;
            slid
        };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn erosion_conserves_material() {
        let mut heights = vec![0; 21 * 21];
        heights[10 * 21 + 10] = 100_003;
        let mut next = heights.clone();
        for _ in 0..9 {
            pass(&heights, 21, 1, &mut next, |around, out| slide::<true>(around, 10, out));
            std::mem::swap(&mut heights, &mut next);
        }
        assert_eq!(heights.iter().sum::<i32>(), 100_003);
        let top = heights[10 * 21 + 10];
        assert!(top < 10_000 && top > heights[10 * 21 + 11], "{top}");
        assert_eq!(heights[10 * 21 + 9], heights[9 * 21 + 10], "the same in x and y");
    }

    #[test]
    fn slopes_below_the_talus_stay() {
        let heights: Vec<i32> = (0..81).map(|i| i % 9 * 10).collect();
        let mut next = heights.clone();
        pass(&heights, 9, 1, &mut next, |around, out| slide::<true>(around, 10, out));
        assert_eq!(next, heights);
    }

    #[test]
    fn spikes_are_removed_and_slopes_are_not() {
        let mut heights: Vec<i32> = (0..81).map(|i| i % 9 * 1000).collect();
        heights[40] = 100_000;
        heights[22] = i32::MIN;
        let mut next = heights.clone();
        pass(&heights, 9, 1, &mut next, |around, out| remove_spikes(around, 7, out));
        assert_eq!((next[40], next[22]), (5007, 3000 - 7));
        assert_eq!(next[50], 5000);
        // The extremes of integers must not overflow.
        let mut wild = [i32::MAX; 9];
        wild[4] = i32::MIN;
        let mut next = wild;
        pass(&wild, 3, 1, &mut next, |around, out| remove_spikes(around, i64::from(u32::MAX), out));
        pass(&wild, 3, 1, &mut next, |around, out| slide::<false>(around, 0, out));
        assert!(next[4] < i32::MAX);
    }

    #[test]
    fn narrow_and_wide_arithmetic_agree() {
        let mut random = lodestream_geometry::random::Random::new(3);
        for spread in [100, NARROW] {
            let mut height = || random.below(2 * spread as usize + 1) as i32 - spread;
            let heights: Vec<i32> = (0..40 * 30).map(|_| height()).collect();
            assert!(are_narrow(&heights));
            let (mut narrow, mut wide) = (heights.clone(), heights.clone());
            let talus = i64::from(spread) / 9;
            pass(&heights, 40, 1, &mut narrow, |around, out| slide::<true>(around, talus, out));
            pass(&heights, 40, 1, &mut wide, |around, out| slide::<false>(around, talus, out));
            assert!(narrow == wide && narrow != heights && are_narrow(&narrow));
        }
    }
}
