//! Level errors: vertical distance between a level's surface and the finest one.
//!
//! A level's surface is linear on triangles; each cell is split from (x, y) to (x + 1, y + 1). Triangles of a level
//! lie within those of the level before, so the largest vertical distance between two levels' surfaces is at a point
//! of the finer one.

use super::error::TerrainError;
use super::numbers::{index, signed, span};
use super::parameters::{Erosion, Parameters};
use super::stamp::{Position, Stamp};
use super::window::Scratch;
use super::world::Terrain;
use lodestream_geometry::numbers::id32;
use lodestream_geometry::random::Random;

/// Levels measured at once: squares of 65 x 65 points.
const SAMPLE_LEVELS: u8 = 6;
/// Random squares of that size per group of levels, and four times as many of half the size.
const SAMPLES: usize = 40;
/// Most squares per group of levels.
const MAX_SAMPLES: usize = 256;
/// One point of this many in a square may exceed the error.
const ONE_OF: usize = 1000;

impl Terrain {
    /// Exact errors of patch (`x`, `y`) at each level, 0 to the finest, in height units, rounded up: the largest
    /// vertical distance between the level's surface and the finest. The last is 0.
    ///
    /// Cost: generating the patch at its finest level, and about a nanosecond per point and level.
    ///
    /// # Errors
    /// If there is no such patch.
    pub fn patch_errors(&self, x: i64, y: i64, scratch: &mut Scratch) -> Result<Vec<u32>, TerrainError> {
        let n = self.parameters.finest_level;
        let mut heights = Vec::new();
        self.patch_into(x, y, n, scratch, &mut heights)?;
        Ok(errors(&heights, n))
    }

    /// Errors of terrain without features at each level, 0 to the finest, in height units: in each of the random
    /// squares measured, at most one point in a thousand is farther from the finest surface. Erosion is ignored; it
    /// smooths. For terrain that features make rougher, see [`Self::rough_places`] and [`Self::patch_errors`].
    ///
    /// The largest distances are about 1.6 times as large, because offsets add up like a Gaussian.
    ///
    /// Cost: some 300,000 points are generated and measured, 10 ms; deterministic.
    #[must_use]
    pub fn level_errors(&self) -> Vec<u32> {
        let plain = self.uneroded(Vec::new());
        let edge = 1_i64 << (self.parameters.extent_log2 + self.parameters.finest_level);
        plain.measured(|levels| {
            let mut random = Random::new(u64::from(levels));
            let samples = (SAMPLES << (2 * (SAMPLE_LEVELS - levels))).min(MAX_SAMPLES);
            // 2^32 points per axis in the largest world, more than `usize` holds on 32-bit machines.
            let mut place = move || random.below_u64(2 * edge.unsigned_abs()).cast_signed() - edge;
            (0..samples).map(|_| [place(), place()]).collect()
        })
    }

    /// The terrain without erosion and height overrides, and with these stamps.
    pub(super) fn uneroded(&self, stamps: Vec<Stamp>) -> Self {
        let parameters = Parameters { erosion: Erosion::default(), ..self.parameters };
        Self { parameters, noise: self.noise.clone(), stamps, patches: Default::default() }
    }

    /// Errors of all levels in squares around places of the finest grid; `places` takes the number of levels of a
    /// square.
    pub(super) fn measured(&self, places: impl Fn(u8) -> Vec<Position>) -> Vec<u32> {
        let n = self.parameters.finest_level;
        // Levels 0 to `coarse` are measured against level `coarse`, the rest against the finest; the sums of the two
        // bound the total.
        let coarse = n.saturating_sub(SAMPLE_LEVELS);
        let rest = self.sampled(n, n - coarse, &places(n - coarse));
        let mut errors = self.sampled(coarse, coarse, &places(coarse));
        errors.pop();
        errors.iter_mut().for_each(|error| *error = error.saturating_add(rest[0]));
        errors.extend(rest);
        // Errors are monotone, whatever was sampled.
        for level in (0..errors.len() - 1).rev() {
            errors[level] = errors[level].max(errors[level + 1]);
        }
        errors
    }

    /// Errors of the levels `to` - `levels` to `to` against level `to`, the maximum over squares of one coarsest cell
    /// around places.
    fn sampled(&self, to: u8, levels: u8, places: &[Position]) -> Vec<u32> {
        let edge = 1_i64 << (self.parameters.extent_log2 + to);
        let shift = self.parameters.finest_level - to;
        let mut worst = vec![0; usize::from(levels) + 1];
        let (mut scratch, mut heights, mut tally) = (Scratch::new(), Vec::new(), Histogram::default());
        let cells = 1_i64 << levels;
        for place in places {
            let [x, y] = place.map(|x| (x >> (shift + levels) << levels).clamp(-edge, edge - cells));
            let side = index(cells) + 1;
            if self.window(signed(to), x, y, side, side, &mut scratch, &mut heights).is_ok() {
                for (level, worst) in (0..levels).zip(&mut worst) {
                    tally.clear();
                    distances(&heights, side, u32::from(levels - level), |distance| tally.add(distance));
                    *worst = tally.quantile(tally.count / ONE_OF).max(*worst);
                }
            }
        }
        worst
    }
}

/// A histogram by magnitude with eight classes per octave, so that a quantile is at most an eighth too large.
struct Histogram {
    classes: [u32; 8 * 30],
    count: usize,
}

impl Default for Histogram {
    fn default() -> Self {
        Self { classes: [0; 8 * 30], count: 0 }
    }
}

impl Histogram {
    fn clear(&mut self) {
        *self = Self::default();
    }

    fn add(&mut self, value: u32) {
        // 0 to 7 have their own classes; then the leading bit and the three after it.
        let class = match value.checked_ilog2() {
            None | Some(0..=2) => value as usize,
            Some(log) => 8 * (log as usize - 2) + ((value >> (log - 3)) & 7) as usize,
        };
        self.classes[class] += 1;
        self.count += 1;
    }

    /// A number that all but at most `few` of the counted ones do not exceed.
    fn quantile(&self, few: usize) -> u32 {
        let mut above = 0;
        for (class, &count) in self.classes.iter().enumerate().rev() {
            above += count as usize;
            if above > few {
                // The largest number of the class.
                let log = class / 8 + 2;
                return if class < 8 {
                    id32(class)
                } else {
                    let first = (8 + class % 8) as u64 + 1;
                    u32::try_from((first << (log - 3)) - 1).unwrap_or(u32::MAX)
                };
            }
        }
        0
    }
}

/// Errors of levels 0 to `levels` of a square of 2^`levels` + 1 points per side.
fn errors(heights: &[i32], levels: u8) -> Vec<u32> {
    let side = (1_usize << levels) + 1;
    let level_error = |level: u8| {
        let mut worst = 0;
        distances(heights, side, u32::from(levels - level), |distance| worst = worst.max(distance));
        worst
    };
    (0..=levels).map(level_error).collect()
}

/// The distance of every point to the surface through every 2^`shift`th one, in height units, rounded up.
fn distances(heights: &[i32], side: usize, shift: u32, mut each: impl FnMut(u32)) {
    let step = 1_usize << shift;
    let mut whole = |times_step: i64| {
        each(u32::try_from(times_step.unsigned_abs().div_ceil(step as u64)).unwrap_or(u32::MAX));
    };
    for top in (0..side - 1).step_by(step) {
        for row in top..top + step + usize::from(top + step + 1 == side) {
            let v = span(row - top);
            for left in (0..side - 1).step_by(step) {
                let at = |x: usize, y: usize| i64::from(heights[y * side + x]);
                let [a, b] = [at(left, top), at(left + step, top)];
                let [c, d] = [at(left, top + step), at(left + step, top + step)];
                // 2^shift times the surface along the row: below the diagonal, then above.
                let lower = (a << shift) + v * (c - a);
                let upper = (a << shift) + v * (d - b);
                let line = &heights[row * side + left..][..=step];
                let (first, second) = line.split_at(index(v));
                for (u, &height) in (0_i64..).zip(first) {
                    whole((i64::from(height) << shift) - lower - u * (d - c));
                }
                for (u, &height) in (v..).zip(second) {
                    whole((i64::from(height) << shift) - upper - u * (b - a));
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distances_are_to_the_triangles() {
        // A plane has no error at any level.
        let plane: Vec<i32> = (0..81).map(|i| 3 * (i % 9) - 7 * (i / 9)).collect();
        assert_eq!(errors(&plane, 3), [0, 0, 0, 0]);
        // One raised point: that error at every level without it.
        let mut peak = plane.clone();
        peak[5 * 9 + 3] += 1000;
        assert_eq!(errors(&peak, 3), [1000, 1000, 1000, 0]);
        // A fold along the diagonal from (0, 0) is on the triangles' edges, one across it is not.
        let fold: Vec<i32> = (0..81).map(|i: i32| (i % 9 - i / 9).abs()).collect();
        assert_eq!(errors(&fold, 3), [0, 0, 0, 0]);
        let across: Vec<i32> = (0..81).map(|i: i32| (i % 9 + i / 9 - 8).abs()).collect();
        assert_eq!(errors(&across, 3), [8, 4, 2, 0]);
    }

    #[test]
    fn histogram_quantiles_are_exact_to_an_eighth() {
        let mut tally = Histogram::default();
        for value in 0..10_000_u32 {
            tally.add(value * value);
        }
        for few in [0, 1, 10, 999, 9_000] {
            let exact = (9_999 - few as u32).pow(2);
            let got = tally.quantile(few);
            assert!(got >= exact && u64::from(got) <= u64::from(exact) * 9 / 8 + 1, "{few}: {got}, {exact}");
        }
        assert_eq!(tally.quantile(10_000), 0);
        let mut one = Histogram::default();
        one.add(u32::MAX);
        assert_eq!(one.quantile(0), u32::MAX);
    }

    /// Share of a patch's points that are farther than `bound` from the finest surface.
    fn share_beyond(heights: &[i32], levels: u8, level: u8, bound: u32) -> f64 {
        let (mut beyond, mut all) = (0, 0);
        distances(heights, (1 << levels) + 1, u32::from(levels - level), |distance| {
            all += 1;
            beyond += u32::from(distance > bound);
        });
        f64::from(beyond) / f64::from(all)
    }

    #[test]
    fn errors_hold_for_patches_that_were_not_measured() {
        for (finest_level, patches) in [(5, 200), (10, 3)] {
            let parameters = Parameters { finest_level, extent_log2: 10, ..Parameters::default() };
            let terrain = Terrain::new(parameters).unwrap();
            let bounds = terrain.level_errors();
            let mut beyond = vec![0.0; bounds.len()];
            for i in 0..patches {
                let (x, y) = (i * 5 - 99, 50 - i);
                let heights = terrain.patch(x, y, finest_level).unwrap();
                let worst = errors(&heights, finest_level);
                for (level, beyond) in (0..finest_level).zip(&mut beyond) {
                    let bound = bounds[usize::from(level)];
                    let share = share_beyond(&heights, finest_level, level, bound);
                    assert!(share < 0.03, "level {level} of patch {x}, {y}: {share} beyond {bound}");
                    *beyond += share / patches as f64;
                    let worst = worst[usize::from(level)];
                    assert!(2 * worst < 5 * bound, "level {level} of patch {x}, {y}: {worst}, not {bound}");
                }
            }
            assert!(beyond.iter().all(|&share| share < 0.002), "{beyond:?}");
            assert_eq!(bounds.last(), Some(&0));
            assert!(bounds.is_sorted_by(|a, b| a >= b), "{bounds:?}");
        }
    }
}
