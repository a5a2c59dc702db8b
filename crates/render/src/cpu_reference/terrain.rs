//! CPU reference of `terrain.wgsl`: where a tile's points lie, how steep the ground is there, and what covers it.

use glam::DVec2;

use lodestream_terrain::tiles::{
    CELL_SAMPLES, FALLOFF, TILE_CELLS, TILE_MARGIN, TILE_SAMPLES, TileRegion, region_margin,
};

/// The vertex shader's input for a tile, in world units relative to the eye.
#[derive(Clone, Copy, Debug)]
pub struct Tile<'a> {
    /// Heights in height units, rows of [`TILE_SAMPLES`].
    pub heights: &'a [i32],
    /// Position of its first point in the plane.
    pub corner: [f64; 2],
    /// Distance between points; samples are half as far apart.
    pub step: f64,
    /// World units per height unit.
    pub height_unit: f64,
    /// Height of the eye, world units.
    pub eye_height: f64,
    /// Height of the eye over the ground around.
    pub above: f64,
    /// Distances at which the morph onto the coarser surface begins and ends.
    pub morph: [f64; 2],
    /// The spacing's number.
    pub spacing: u8,
    /// Rough regions, relative to the eye like the corner.
    pub regions: &'a [TileRegion],
}

impl Tile<'_> {
    fn sample(&self, p: [i64; 2]) -> f64 {
        let margin = i64::from(TILE_MARGIN);
        let [x, y] = p.map(|p| (p + margin) as usize);
        f64::from(self.heights[y * TILE_SAMPLES as usize + x]) * self.height_unit
    }

    fn height(&self, p: [i64; 2]) -> f64 {
        self.sample(p.map(|p| p * i64::from(CELL_SAMPLES)))
    }

    /// Rise per world unit along x and z, at a sample, from samples so many away.
    #[must_use]
    pub fn slope(&self, sample: [u32; 2], step: u32) -> [f64; 2] {
        let ([x, y], step) = (sample.map(i64::from), i64::from(step));
        let run = 2.0 * step as f64 * self.step / f64::from(CELL_SAMPLES);
        [
            (self.sample([x + step, y]) - self.sample([x - step, y])) / run,
            (self.sample([x, y + step]) - self.sample([x, y - step])) / run,
        ]
    }

    fn at(&self, p: [i64; 2], height: f64) -> [f64; 3] {
        let [x, z] = [0, 1].map(|i| self.corner[i] + p[i] as f64 * self.step);
        [x, height - self.eye_height, z]
    }

    /// Share of the way that a point has gone onto the coarser surface.
    #[must_use]
    pub fn morph_weight(&self, column: u32, row: u32) -> f64 {
        let across = [column, row].map(f64::from).map(|p| p * self.step);
        let at = DVec2::from(self.corner) + DVec2::from(across);
        let d = at.length().hypot(self.above);
        let unit = self.step / f64::from(1_u32 << self.spacing);
        let [begin, end] = morph_at(self.regions, self.spacing, unit, at, self.morph);
        if end.is_finite() { ((d - begin) / (end - begin)).clamp(0.0, 1.0) } else { 0.0 }
    }

    /// Position of a point: world axes, relative to the eye.
    #[must_use]
    pub fn place(&self, column: u32, row: u32) -> [f64; 3] {
        let p = [i64::from(column), i64::from(row)];
        let odd = p.map(|p| p & 1);
        let weight = self.morph_weight(column, row);
        let before = [p[0] - odd[0], p[1] - odd[1]];
        let after = [p[0] + odd[0], p[1] + odd[1]];
        let side = i64::from(TILE_CELLS);
        let on_side = p.map(|p| p == 0 || p == side);
        if weight >= 1.0 && (on_side[0] && odd[1] == 1 || on_side[1] && odd[0] == 1) {
            return self.at(before, self.height(before));
        }
        let mix = |a: f64, b: f64| a + (b - a) * weight;
        let coarse = 0.5 * (self.height(before) + self.height(after));
        self.at(p, mix(self.height(p), coarse))
    }
}

/// Distances at which a point slides, of a tile away from regions `plain`, among regions; `unit` is a grid unit in world
/// units.
#[must_use]
pub fn morph_at(regions: &[TileRegion], spacing: u8, unit: f64, at: DVec2, plain: [f64; 2]) -> [f64; 2] {
    regions.iter().fold(plain, |morph, region| {
        let (along, offset) = (region.to - region.from, at - region.from);
        let share = (offset.dot(along) / along.length_squared().max(1e-30)).clamp(0.0, 1.0);
        let beyond = (offset - share * along).length() - region.radius - region_margin(spacing) * unit;
        let own = region.morph[usize::from(spacing)];
        [0, 1].map(|i| morph[i].max(own[i] - FALLOFF * beyond.max(0.0)))
    })
}

/// Weights of sand, grass, hill and snow at a height on ground whose normal's upward part is `up`: `zones` as the shader
/// has them, the heights where grass, hill and snow begin and half the width of the borders. Their sum is 1.
#[must_use]
pub fn zone_weights(zones: [f64; 4], height: f64, up: f64) -> [f64; 4] {
    let smoothstep = |low: f64, high: f64, x: f64| {
        let t = ((x - low) / (high - low)).clamp(0.0, 1.0);
        t * t * (3.0 - 2.0 * t)
    };
    let [grass, hill, snow] = [(0, 1.0), (1, 2.5), (2, 2.5)]
        .map(|(i, wide)| smoothstep(zones[i] - wide * zones[3], zones[i] + wide * zones[3], height));
    let by_height = [1.0 - grass, grass * (1.0 - hill), grass * hill * (1.0 - snow), grass * hill * snow];
    let steep = 1.0 - smoothstep(0.72, 0.86, up);
    let mixed = [0, 1, 2, 3].map(|i| by_height[i] * (1.0 - steep) + if i == 2 { steep } else { 0.0 });
    let sum: f64 = mixed.iter().sum();
    mixed.map(|w| w / sum)
}

#[cfg(test)]
mod tests {
    use super::*;

    const ZONES: [f64; 4] = [0.0, 100.0, 250.0, 15.0];

    #[test]
    fn weights_sum_to_one_and_follow_the_zones() {
        for height in -100..400 {
            for up in 0..=20 {
                let weights = zone_weights(ZONES, f64::from(height), f64::from(up) / 20.0);
                assert!((weights.iter().sum::<f64>() - 1.0).abs() < 1e-12);
                assert!(weights.iter().all(|w| (0.0..=1.0).contains(w)));
            }
        }
        for (height, zone) in [(-50.0, 0), (50.0, 1), (180.0, 2), (300.0, 3)] {
            assert_eq!(zone_weights(ZONES, height, 1.0)[zone], 1.0);
            assert_eq!(zone_weights(ZONES, height, 0.5)[2], 1.0, "steep ground is rock");
        }
    }

    #[test]
    fn a_morphed_tile_is_the_coarser_surface() {
        let points = i64::from(TILE_SAMPLES);
        let heights: Vec<i32> = (0..points * points).map(|i| ((i * i * 31 + i * 7) % 113) as i32).collect();
        let tile = |morph| Tile {
            heights: &heights,
            corner: [100.0, 50.0],
            step: 2.0,
            height_unit: 1.0,
            eye_height: 3.0,
            above: 0.0,
            morph,
            spacing: 0,
            regions: &[],
        };
        let (own, arrived) = (tile([1e9, 2e9]), tile([1.0, 2.0]));
        for row in 0..=TILE_CELLS {
            for column in 0..=TILE_CELLS {
                let at = own.place(column, row);
                assert_eq!([at[0], at[2]], [100.0 + 2.0 * f64::from(column), 50.0 + 2.0 * f64::from(row)]);
                let even = |x: u32| x - (x & 1);
                let ends = [(even(column), even(row)), (column + (column & 1), row + (row & 1))];
                let [a, b] = ends.map(|(c, r)| own.place(c, r));
                let on_side = [column, row].map(|x| x == 0 || x == TILE_CELLS);
                let ends_there = on_side[0] && row & 1 == 1 || on_side[1] && column & 1 == 1;
                let middle = [0, 1, 2].map(|i| 0.5 * (a[i] + b[i]));
                let expected = if ends_there { a } else { middle };
                assert_eq!(arrived.place(column, row), expected);
            }
        }
    }
}
