//! How far a level's surface is from the finest: the error of drawing with it.
//!
//! A level's surface is linear on triangles, each cell split from (x, y) to (x + 1, y + 1). Triangles of a
//! level lie within those of the one before, so the largest vertical distance between two levels' surfaces
//! is at a point of the finer.

use super::stamp::Shape;
use super::{Mode, Parameters, Scratch, Terrain, TerrainError};
use crate::random::Random;

/// Levels that are measured at once: squares of 257 x 257 points.
const SAMPLE_LEVELS: u8 = 8;
/// Squares of that size measured for each such group of levels, and four times as many of half the size.
const SAMPLES: usize = 16;
/// Most squares measured.
const MOST_SAMPLES: usize = 1024;
/// Places that were not measured may be this much worse, in quarters.
const SAFETY_QUARTERS: u64 = 6;

impl Terrain {
    /// The exact errors of drawing patch (`x`, `y`) at each level, 0 to the finest, in height units, rounded
    /// up: the largest vertical distance between the level's surface and the finest. The last is 0.
    ///
    /// Cost: the patch at its finest, and about a nanosecond for each of its points and levels.
    ///
    /// # Errors
    /// If there is no such patch.
    pub fn patch_errors(&self, x: i64, y: i64, scratch: &mut Scratch) -> Result<Vec<u32>, TerrainError> {
        let n = self.parameters.finest_level;
        let mut heights = Vec::new();
        self.patch_into(x, y, n, scratch, &mut heights)?;
        Ok(errors(&heights, n))
    }

    /// Errors of drawing at each level, 0 to the finest, that hold nearly everywhere: those of patches without
    /// features, times 1.5 for what was not measured, plus what stamps and listed points can add. Where
    /// [`Self::has_features`], [`Self::patch_errors`] tells far less.
    #[must_use]
    pub fn level_errors(&self) -> Vec<u32> {
        let plain = self.plain_errors();
        let n = self.parameters.finest_level;
        let points = self.patches.values().fold((0, 0), |(low, high), patch| {
            let (patch_low, patch_high) = patch.range();
            (patch_low.min(low), patch_high.max(high))
        });
        let points = (points.1 - points.0) as u64;
        let add = |(level, plain): (u8, u32)| {
            let spacing = 1_u64 << (n - level);
            let stamps: u64 = self.stamps.iter().map(|stamp| self.stamp_error(stamp, spacing)).sum();
            let features = if level == n { 0 } else { stamps.saturating_add(points) };
            u32::try_from(u64::from(plain).saturating_add(features)).unwrap_or(u32::MAX)
        };
        (0..=n).zip(plain).map(add).collect()
    }

    /// As [`Self::level_errors`], for patches without features.
    ///
    /// Cost: one or two million points are made and measured, some ten milliseconds; the same for every call.
    #[must_use]
    pub fn plain_errors(&self) -> Vec<u32> {
        let n = self.parameters.finest_level;
        let Ok(plain) = Self::new(self.parameters) else { return vec![0; usize::from(n) + 1] };
        // Levels 0 to `coarse` are measured against level `coarse`, the rest against the finest, and sums of
        // the two bound what lies between.
        let coarse = n.saturating_sub(SAMPLE_LEVELS);
        let rest = plain.sampled(n, n - coarse);
        let mut errors: Vec<u64> = plain.sampled(coarse, coarse);
        errors.pop();
        errors.iter_mut().for_each(|error| *error += rest[0]);
        errors.extend(rest);
        let safe = |error: u64| u32::try_from(error * SAFETY_QUARTERS / 4).unwrap_or(u32::MAX);
        errors.into_iter().map(safe).collect()
    }

    /// An error that holds as nearly everywhere for the levels below 0: that of level 0, and as much as patch
    /// corners can differ.
    #[must_use]
    pub fn sparse_error(&self) -> u32 {
        let Parameters { amplitude, distribution, .. } = self.parameters;
        let corners = 2 * u64::from(amplitude) * distribution.reach();
        let level_0 = self.level_errors().first().copied().unwrap_or(0);
        u32::try_from(corners + u64::from(level_0)).unwrap_or(u32::MAX)
    }

    /// Errors of the levels `to` - `levels` to `to` against level `to`, the largest of sampled squares.
    fn sampled(&self, to: u8, levels: u8) -> Vec<u64> {
        let edge = 1_i64 << (u32::from(self.parameters.extent_log2) + u32::from(to - levels));
        let mut random = Random::new(u64::from(to) << 8 | u64::from(levels));
        let mut worst = vec![0; usize::from(levels) + 1];
        let (mut scratch, mut heights) = (Scratch::new(), Vec::new());
        let side = (1 << levels) + 1;
        let samples = (SAMPLES << (2 * (SAMPLE_LEVELS - levels))).min(MOST_SAMPLES);
        for _ in 0..samples {
            let mut place = || (random.below(2 * edge as usize) as i64 - edge) << levels;
            let (x, y) = (place(), place());
            if self.window(to as i8, x, y, side, side, &mut scratch, &mut heights).is_ok() {
                for (worst, error) in worst.iter_mut().zip(errors(&heights, levels)) {
                    *worst = u64::from(error).max(*worst);
                }
            }
        }
        worst
    }

    /// What a stamp adds at most to the error of a level whose points are `spacing` apart.
    fn stamp_error(&self, stamp: &super::Stamp, spacing: u64) -> u64 {
        let (change, width) = match stamp.shape {
            Shape::Ridge { half_width, height, .. } => (height.unsigned_abs(), half_width),
            Shape::Valley { half_width, depth, .. } => (depth.unsigned_abs(), half_width),
            // The banks take half the width.
            Shape::RiverBed { half_width, depth, .. } => (depth.unsigned_abs(), half_width / 2),
            Shape::Crater { radius, depth, rim, .. } => {
                (depth.unsigned_abs().saturating_add(rim.unsigned_abs()), radius)
            }
            Shape::Plateau { falloff, height, .. } => (height.unsigned_abs(), falloff),
        };
        let change = u64::from(change)
            + match stamp.mode {
                Mode::Additive => 0,
                // What it replaces may be as far from the base as heights go.
                Mode::Fixed => self.parameters.worst_height(),
            };
        // No profile is steeper than twice its change over its width, and a triangle's corners are at most
        // 1.5 spacings from a place in it.
        let slope = u128::from(change) * 3 * u128::from(spacing) / u128::from(width.max(1));
        u64::try_from(slope).unwrap_or(u64::MAX).min(change)
    }
}

/// The errors of levels 0 to `levels` of a square of 2^`levels` + 1 points a side.
fn errors(heights: &[i32], levels: u8) -> Vec<u32> {
    let side = (1_usize << levels) + 1;
    (0..=levels).map(|level| level_error(heights, side, u32::from(levels - level))).collect()
}

/// The largest distance to the surface through every 2^`shift`th point.
fn level_error(heights: &[i32], side: usize, shift: u32) -> u32 {
    let step = 1_usize << shift;
    let mut worst = 0;
    for top in (0..side - 1).step_by(step) {
        for row in top..top + step + usize::from(top + step + 1 == side) {
            let v = (row - top) as i64;
            for left in (0..side - 1).step_by(step) {
                let at = |x: usize, y: usize| i64::from(heights[y * side + x]);
                let [a, b] = [at(left, top), at(left + step, top)];
                let [c, d] = [at(left, top + step), at(left + step, top + step)];
                // 2^shift times the surface, along the row: below the diagonal, then above.
                let lower = (a << shift) + v * (c - a);
                let upper = (a << shift) + v * (d - b);
                let line = &heights[row * side + left..][..=step];
                let (first, second) = line.split_at(v as usize);
                for (u, &height) in (0_i64..).zip(first) {
                    worst = worst.max(((i64::from(height) << shift) - lower - u * (d - c)).abs());
                }
                for (u, &height) in (v..).zip(second) {
                    worst = worst.max(((i64::from(height) << shift) - upper - u * (b - a)).abs());
                }
            }
        }
    }
    u32::try_from((worst as u64).div_ceil(step as u64)).unwrap_or(u32::MAX)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distances_are_to_the_triangles() {
        // A plane has no error at any level.
        let plane: Vec<i32> = (0..81).map(|i| 3 * (i % 9) - 7 * (i / 9)).collect();
        assert_eq!(errors(&plane, 3), [0, 0, 0, 0]);
        // One point up: that much at every level that lacks it.
        let mut peak = plane.clone();
        peak[5 * 9 + 3] += 1000;
        assert_eq!(errors(&peak, 3), [1000, 1000, 1000, 0]);
        // A fold along the diagonal from (0, 0) is on the triangles' edge, one across it is not.
        let fold: Vec<i32> = (0..81).map(|i: i32| (i % 9 - i / 9).abs()).collect();
        assert_eq!(errors(&fold, 3), [0, 0, 0, 0]);
        let across: Vec<i32> = (0..81).map(|i: i32| (i % 9 + i / 9 - 8).abs()).collect();
        assert_eq!(errors(&across, 3), [8, 4, 2, 0]);
    }

    #[test]
    fn sampled_errors_hold_for_patches_that_were_not_sampled() {
        for finest_level in [5, 10] {
            let parameters = Parameters { finest_level, extent_log2: 10, ..Parameters::default() };
            let terrain = Terrain::new(parameters).unwrap();
            let bounds = terrain.level_errors();
            let mut scratch = Scratch::new();
            for i in 0..if finest_level == 5 { 200 } else { 4 } {
                let errors = terrain.patch_errors(i * 5 - 99, 50 - i, &mut scratch).unwrap();
                for (level, (error, bound)) in errors.iter().zip(&bounds).enumerate() {
                    assert!(error <= bound, "level {level} of patch {i}: {error}, at most {bound}");
                }
            }
            assert_eq!(bounds.last(), Some(&0));
            assert!(bounds[0] < 4 * 65536, "{bounds:?}");
        }
    }
}
