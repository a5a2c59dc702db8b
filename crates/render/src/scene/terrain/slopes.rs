//! Slopes of a tile, for normals per pixel.
//!
//! Half floats have a relative error of 1/2048, so normals are off by at most 0.02°. Each sample also holds the slopes
//! of the next coarser tile, so that normals morph with the surface.

use half::f16;

use lodestream_terrain::tiles::{CELL_SAMPLES, TILE_CELLS, TILE_MARGIN, TILE_SAMPLES};

/// Unit of the texture's slopes in height units per sample (`SLOPE_UNIT` of `terrain.wgsl`): half floats range from
/// 6e-5 to 65,504, heights from half a unit to 2^30.
const SLOPE_UNIT: f64 = 1024.0;

/// Slopes along both axes by central differences, of the tile and of the next coarser tile, per sample; 0 in the
/// margin, which no pixel reaches.
pub(super) fn slopes(heights: &[i32]) -> Vec<[f16; 4]> {
    let samples = i64::from(TILE_SAMPLES);
    let margin = i64::from(TILE_MARGIN);
    let height = |x: i64, y: i64| f64::from(heights[((y + margin) * samples + x + margin) as usize]);
    let rise = |x: i64, y: i64, step: i64| {
        let run = 2.0 * step as f64 * SLOPE_UNIT;
        [(height(x + step, y) - height(x - step, y)) / run, (height(x, y + step) - height(x, y - step)) / run]
    };
    // Interpolated between the coarser tile's samples, like a filtered texture.
    let coarser = |x: i64, y: i64| {
        let (x0, y0, x1, y1) = (x - (x & 1), y - (y & 1), x + (x & 1), y + (y & 1));
        let four = [rise(x0, y0, 2), rise(x1, y0, 2), rise(x0, y1, 2), rise(x1, y1, 2)];
        [0, 1].map(|i| four.iter().map(|rise| rise[i]).sum::<f64>() * 0.25)
    };
    let last = i64::from(TILE_CELLS * CELL_SAMPLES);
    let mut slopes = vec![[f16::ZERO; 4]; (samples * samples) as usize];
    for y in 0..=last {
        for x in 0..=last {
            let ([a, b], [c, d]) = (rise(x, y, 1), coarser(x, y));
            slopes[((y + margin) * samples + x + margin) as usize] =
                [a, b, c, d].map(|rise| f16::from_f64(rise.clamp(-65_504.0, 65_504.0)));
        }
    }
    slopes
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cpu_reference::terrain::Tile;

    const LAST: usize = (TILE_CELLS * CELL_SAMPLES) as usize;

    /// Heights of a tile whose samples are `step` apart and begin at the origin.
    fn heights(step: i64) -> Vec<i32> {
        let (side, margin) = (i64::from(TILE_SAMPLES), i64::from(TILE_MARGIN));
        let height = |x: i64, y: i64| ((x * x * 31 + x * y * 17 + y * 7).rem_euclid(113) - 50) as i32;
        let at = |i: i64| height((i % side - margin) * step, (i / side - margin) * step);
        (0..side * side).map(at).collect()
    }

    fn at(slopes: &[[f16; 4]], x: usize, y: usize) -> [f64; 4] {
        let margin = TILE_MARGIN as usize;
        slopes[(y + margin) * TILE_SAMPLES as usize + x + margin].map(f64::from)
    }

    #[test]
    fn slopes_match_the_cpu_reference() {
        let heights = heights(1);
        let (step, height_unit) = (2.0, 0.01);
        let tile = Tile {
            heights: &heights,
            corner: [0.0; 2],
            step,
            height_unit,
            eye_height: 0.0,
            above: 0.0,
            morph: [1e9, 2e9],
            spacing: 0,
            regions: &[],
        };
        // As the shader scales them.
        let scale = SLOPE_UNIT * height_unit / (step / f64::from(CELL_SAMPLES));
        let slopes = slopes(&heights);
        for (x, y) in (0..=LAST).flat_map(|x| (0..=LAST).map(move |y| (x, y))) {
            let found = at(&slopes, x, y).map(|rise| rise * scale);
            let sample = [x as u32, y as u32];
            let even = sample.iter().all(|x| x % 2 == 0);
            let expected =
                [tile.slope(sample, 1), if even { tile.slope(sample, 2) } else { [found[2], found[3]] }];
            for (found, expected) in found.iter().zip(expected.concat()) {
                assert!(
                    (found - expected).abs() <= 1e-3 * expected.abs().max(1e-4),
                    "{sample:?}: {found}, {expected}"
                );
            }
        }
    }

    #[test]
    fn a_morphed_tile_has_the_slopes_of_the_next_coarser_one() {
        let (fine, coarse) = (slopes(&heights(1)), slopes(&heights(2)));
        for (x, y) in (0..=LAST).flat_map(|x| (0..=LAST).map(move |y| (x, y))) {
            // The coarser tile's slopes, filtered; its samples are twice as far apart.
            let (from, to) = ([x / 2, y / 2], [x.div_ceil(2), y.div_ceil(2)]);
            let four = [[from[0], from[1]], [to[0], from[1]], [from[0], to[1]], [to[0], to[1]]];
            for axis in 0..2 {
                let expected = four.iter().map(|&[x, y]| at(&coarse, x, y)[axis]).sum::<f64>() / 8.0;
                let found = at(&fine, x, y)[2 + axis];
                assert!(
                    (found - expected).abs() <= 1e-3 * expected.abs().max(1e-2),
                    "{x}, {y}: {found}, {expected}"
                );
            }
        }
    }

    #[test]
    fn heights_at_the_ends_stay_finite() {
        let cliff: Vec<i32> =
            (0..TILE_SAMPLES * TILE_SAMPLES).map(|i| if i % 2 == 0 { i32::MAX } else { i32::MIN }).collect();
        assert!(slopes(&cliff).iter().flatten().all(|rise| rise.is_finite()));
    }
}
