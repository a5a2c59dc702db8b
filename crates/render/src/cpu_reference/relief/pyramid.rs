//! Maximum pyramid of a height map, and traversal to the exact intersection.

use super::ray::{Ray, ReliefHit, clearance};
use super::{ReliefMap, within_patch};

/// Levels of maximum heights: level-0 cells lie between four texel centres, each further level doubles the cell.
#[derive(Clone, Debug)]
pub struct Pyramid {
    /// Finest first, row by row; sides are rounded up.
    levels: Vec<ReliefMap>,
}

/// Offset that moves a position on a cell's edge into the next cell, in cells.
const NUDGE: f64 = 1e-9;

impl Pyramid {
    /// The pyramid of a map whose sides are powers of two, else one whose cells at the border of the repeat cover more.
    #[must_use]
    pub fn new(map: &ReliefMap) -> Self {
        let (w, h) = (map.width as i64, map.height as i64);
        let patches = (0..w * h).map(|i| {
            let (x, y) = (i % w, i / w);
            let four = [map.texel(x, y), map.texel(x + 1, y), map.texel(x, y + 1), map.texel(x + 1, y + 1)];
            four.into_iter().fold(f64::NEG_INFINITY, f64::max)
        });
        let mut levels = vec![ReliefMap { width: map.width, height: map.height, texels: patches.collect() }];
        // A level whose sides are odd would not repeat with the map.
        while let Some(last) = levels.last().filter(|l| l.width % 2 == 0 && l.height % 2 == 0) {
            let (w, h) = (last.width / 2, last.height / 2);
            let cells = (0..w * h).map(|i| {
                let (x, y) = (2 * (i % w) as i64, 2 * (i / w) as i64);
                let four = [[0, 0], [1, 0], [0, 1], [1, 1]].map(|[a, b]| last.texel(x + a, y + b));
                four.into_iter().fold(f64::NEG_INFINITY, f64::max)
            });
            let next = ReliefMap { width: w, height: h, texels: cells.collect() };
            levels.push(next);
        }
        Self { levels }
    }

    /// Largest heights, finest first; of a cell at (x, y) and the next, rows from the top.
    #[must_use]
    pub fn levels(&self) -> &[ReliefMap] {
        &self.levels
    }

    /// Traverses the pyramid: skips cells that the ray passes above, descends into others, and intersects the
    /// surface's patch.
    pub(super) fn find(&self, map: &ReliefMap, ray: &Ray, steps: u32) -> ReliefHit {
        let texels = [map.width as f64, map.height as f64];
        let way = [ray.span[0] * texels[0], ray.span[1] * texels[1]];
        let start = map.to_texels(ray.start);
        let clear = |s: f64| clearance(map, ray, s);
        let (mut at, mut level, mut lookups) = (0.0_f64, self.levels.len() - 1, 1);
        if clear(0.0) <= 0.0 {
            return ReliefHit { at: 0.0, lookups };
        }
        for _ in 0..steps {
            if at >= 1.0 {
                break;
            }
            let size = f64::from(1_u32 << level.min(31));
            let place = [0, 1].map(|k| {
                let nudge = if way[k] == 0.0 { 0.0 } else { NUDGE.copysign(way[k]) };
                (start[k] + way[k] * at) / size + nudge
            });
            let cell = place.map(f64::floor);
            let exits = [0, 1].map(|k| {
                let edge = (cell[k] + f64::from(way[k] > 0.0)) * size;
                if way[k] == 0.0 { f64::INFINITY } else { (edge - start[k]) / way[k] }
            });
            let exit = exits[0].min(exits[1]).min(1.0).max(at);
            lookups += 1;
            // Lowest where it leaves.
            if 1.0 - exit > self.levels[level].texel(cell[0] as i64, cell[1] as i64) {
                at = exit;
                level = (level + 1).min(self.levels.len() - 1);
            } else if level > 0 {
                level -= 1;
            } else {
                // Four texels in one lookup, the patch's quadratic from them.
                lookups += 1;
                if let Some(hit) = within_patch(&clear, [at, exit]) {
                    return ReliefHit { at: hit, lookups };
                }
                at = exit;
                level = (level + 1).min(self.levels.len() - 1);
            }
        }
        ReliefHit { at: at.min(1.0), lookups }
    }
}
