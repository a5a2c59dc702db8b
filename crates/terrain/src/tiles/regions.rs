//! Regions that are rougher than the rest of the world, and the distances up to which each spacing is drawn there.
//!
//! A region refines itself, its surroundings by less, and never makes anything coarser. At point p, spacing s ends at
//!
//! end(s, p) = max(base end(s), max over regions r of (end(r, s) − [`FALLOFF`] · distance(s, p, r)))
//!
//! and its morph begins at the same maximum of the beginnings. distance(s, p, r) is 0 inside the region and within
//! [`region_margin`] of it, which grows by a tile's diagonal from spacing to spacing. So a region that refines a tile
//! of spacing s counts at least as much for spacing s + 1 on the whole tile, and each region's distances keep the rule
//! of [`LodRanges`]: a coarser tile does not morph where a finer one may meet it. The maxima keep the rule too: the
//! region that determines the end of the finer spacing begins the morph of the coarser one beyond that end.

use crate::RoughPlace;
use glam::DVec2;

use super::ranges::LodRanges;
use super::tile::{TILE_CELLS, TileId};

/// Most regions of a terrain: the bits of a tile's mask.
pub const MAX_REGIONS: usize = 32;
/// Slope at which a region's distances shrink with the distance from its margin. Any slope is valid; a steep one keeps
/// the effect local.
pub const FALLOFF: f64 = 64.0;
/// A region counts for a tile if its distances reach this share of the base distances. The margin absorbs the shader's
/// lower precision, which must not differ between tiles that share a point.
const NEARLY: f64 = 0.999;
/// Least ratio of a region's error to the base error for which it is kept: others are not worth their cost.
const MIN_ROUGHNESS_RATIO: f64 = 1.25;

/// A capsule (all points within a radius of a segment) and the errors of drawing it with each spacing, in grid units.
#[derive(Clone, Debug, PartialEq)]
pub struct Region {
    /// One end of the segment.
    pub from: DVec2,
    /// The other.
    pub to: DVec2,
    /// Radius around it.
    pub radius: f64,
    /// Error of drawing with spacing 2^s instead of 1.
    pub errors: Vec<f64>,
}

impl Region {
    /// The region of a rough place, with the errors per spacing in grid units.
    #[must_use]
    pub fn new(place: &RoughPlace, errors: Vec<f64>) -> Self {
        let at = |[x, y]: [i64; 2]| DVec2::new(x as f64, y as f64);
        Self { from: at(place.from), to: at(place.to), radius: place.radius as f64, errors }
    }

    /// The circumscribed disc of a rectangle.
    #[must_use]
    pub fn around(low: DVec2, high: DVec2, errors: Vec<f64>) -> Self {
        let middle = 0.5 * (low + high);
        Self { from: middle, to: middle, radius: 0.5 * (high - low).length(), errors }
    }

    /// Distance of a point from the region and its margin for a spacing; 0 inside.
    #[must_use]
    pub fn distance(&self, spacing: u8, at: DVec2) -> f64 {
        (self.segment_distance(at) - self.radius - region_margin(spacing)).max(0.0)
    }

    fn segment_distance(&self, at: DVec2) -> f64 {
        let (along, offset) = (self.to - self.from, at - self.from);
        let share = (offset.dot(along) / along.length_squared().max(1e-30)).clamp(0.0, 1.0);
        (offset - share * along).length()
    }

    /// A lower bound of [`Self::distance`] over all points of a tile.
    fn tile_distance(&self, tile: TileId) -> f64 {
        let half = 0.5 * tile.side() as f64;
        let middle = DVec2::from(tile.origin().map(|x| x as f64 + half));
        let nearest = self.segment_distance(middle) - half * std::f64::consts::SQRT_2;
        (nearest - self.radius - region_margin(tile.spacing)).max(0.0)
    }

    /// Whether the region is rough enough to be kept, given the errors elsewhere, `plain`.
    fn is_rougher(&self, plain: &[f64]) -> bool {
        self.errors.iter().zip(plain).any(|(own, plain)| *own > MIN_ROUGHNESS_RATIO * plain)
    }

    /// A capsule that contains both regions, between the two ends farthest from each other.
    fn joined(&self, other: &Self) -> Self {
        let ends = [self.from, self.to, other.from, other.to];
        let pairs = ends.iter().flat_map(|a| ends.iter().map(move |b| (*a, *b)));
        let (from, to) = pairs
            .max_by(|a, b| a.0.distance(a.1).total_cmp(&b.0.distance(b.1)))
            .unwrap_or((self.from, self.to));
        let errors = self.errors.iter().zip(&other.errors).map(|(a, b)| a.max(*b)).collect();
        let mut joined = Self { from, to, radius: 0.0, errors };
        joined.radius = [self, other]
            .iter()
            .flat_map(|part| [part.from, part.to].map(|end| joined.segment_distance(end) + part.radius))
            .fold(0.0, f64::max);
        joined
    }

    /// Estimated cost of the region, given the errors elsewhere, `plain`: summed over spacings, the tiles in the
    /// region's area, weighted by the additional area of eye positions from which they are drawn. The draw distance is
    /// proportional to the error, so that area is proportional to its square.
    fn cost(&self, plain: &[f64]) -> f64 {
        let length = self.from.distance(self.to);
        let of_spacing = |(spacing, (own, plain)): (u8, (&f64, &f64))| {
            let radius = self.radius + region_margin(spacing);
            let area = 2.0 * radius * (length + radius * std::f64::consts::FRAC_PI_2);
            let rougher = own / plain.max(f64::MIN_POSITIVE);
            (rougher * rougher - 1.0).max(0.0) * area / f64::from(spacing).exp2().powi(2)
        };
        (0..).zip(self.errors.iter().zip(plain).skip(1)).map(of_spacing).sum()
    }
}

/// Width around a region that is drawn as finely as the region itself, for a spacing: the sum of the diagonals of one
/// tile of each finer spacing.
#[must_use]
pub fn region_margin(spacing: u8) -> f64 {
    f64::from(TILE_CELLS) * std::f64::consts::SQRT_2 * ((1_u64 << spacing.min(62)) - 1) as f64
}

/// The regions that are rougher than `plain`, reduced to at most `most` by merging.
///
/// The neighbours in the list whose merging costs least are merged first. So a sharp crest is not merged with the
/// gentle slopes around it, although it lies within them.
#[must_use]
pub fn merged_regions(mut regions: Vec<Region>, plain: &[f64], most: usize) -> Vec<Region> {
    regions.retain(|region| region.is_rougher(plain));
    while regions.len() > most.max(1) {
        // Neighbours in the list are likely parts of one line.
        let growth = |i: usize| {
            let [a, b] = [&regions[i], &regions[i + 1]];
            a.joined(b).cost(plain) - a.cost(plain) - b.cost(plain)
        };
        let best = (0..regions.len() - 1).min_by(|&i, &j| growth(i).total_cmp(&growth(j))).unwrap_or(0);
        let joined = regions[best].joined(&regions[best + 1]);
        regions[best] = joined;
        regions.remove(best + 1);
    }
    regions
}

/// Draw distances at any point: the base distances and those of regions.
#[derive(Clone, Debug)]
pub struct RegionRanges {
    plain: LodRanges,
    regions: Vec<(Region, LodRanges)>,
}

impl RegionRanges {
    /// Distances for a view, in grid units ([`LodRanges::new`] explains the arguments). Regions past [`MAX_REGIONS`]
    /// are ignored.
    #[must_use]
    pub fn new(plain: &[f64], regions: &[Region], scale_px: f64, target_px: f64) -> Self {
        let ranges = |errors: &[f64]| LodRanges::new(errors, scale_px, target_px, 1.0);
        let regions = regions.iter().take(MAX_REGIONS);
        let regions: Vec<_> = regions.map(|region| (region.clone(), ranges(&region.errors))).collect();
        Self { plain: ranges(plain), regions }
    }

    /// Distance, from the eye to a tile's nearest point, up to which the tile is drawn with its spacing.
    #[must_use]
    pub fn end(&self, tile: TileId) -> f64 {
        let plain = self.plain.end(tile.spacing);
        self.regions.iter().fold(plain, |end, (region, ranges)| {
            let own = ranges.end(tile.spacing);
            if own > end { end.max(own - FALLOFF * region.tile_distance(tile)) } else { end }
        })
    }

    /// Distances at which the morph of a spacing begins and ends, away from all regions.
    #[must_use]
    pub fn plain(&self, spacing: u8) -> [f64; 2] {
        self.plain.morph(spacing)
    }

    /// The regions and the distances inside each.
    pub fn regions(&self) -> impl Iterator<Item = (&Region, &LodRanges)> {
        self.regions.iter().map(|(region, ranges)| (region, ranges))
    }

    /// Bit mask of the regions that may affect points of a tile: bit r for the r-th.
    #[must_use]
    pub fn mask(&self, tile: TileId) -> u32 {
        let plain = self.plain.morph(tile.spacing);
        if plain[1].is_infinite() {
            return 0;
        }
        let matters = |(region, ranges): &(Region, LodRanges)| {
            let away = FALLOFF * region.tile_distance(tile);
            ranges.morph(tile.spacing).iter().zip(plain).any(|(own, plain)| own - away > NEARLY * plain)
        };
        let bits = self.regions.iter().enumerate();
        bits.filter(|(_, region)| matters(region)).fold(0, |mask, (bit, _)| mask | 1 << bit)
    }

    /// Distances at which the morph of a point begins and ends.
    #[must_use]
    pub fn morph(&self, spacing: u8, at: DVec2) -> [f64; 2] {
        self.regions.iter().fold(self.plain(spacing), |[begin, end], (region, ranges)| {
            let away = FALLOFF * region.distance(spacing, at);
            let own = ranges.morph(spacing);
            [begin.max(own[0] - away), end.max(own[1] - away)]
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn region(from: [f64; 2], to: [f64; 2], radius: f64, errors: &[f64]) -> Region {
        Region { from: from.into(), to: to.into(), radius, errors: errors.to_vec() }
    }

    #[test]
    fn distances_are_from_the_capsule() {
        let region = region([0.0, 0.0], [10.0, 0.0], 2.0, &[]);
        for (at, expected) in [([5.0, 1.0], 0.0), ([5.0, 6.0], 4.0), ([13.0, 4.0], 3.0), ([-2.0, 0.0], 0.0)] {
            assert!((region.distance(0, DVec2::from(at)) - expected).abs() < 1e-12);
        }
        let tile = TileId { spacing: 1, x: 2, y: -1 };
        let nearest = region.tile_distance(tile);
        let [x, y] = tile.origin().map(|x| x as f64);
        for i in 0..=32 {
            for j in 0..=32 {
                assert!(region.distance(1, DVec2::new(x + f64::from(i), y + f64::from(j))) >= nearest);
            }
        }
    }

    #[test]
    fn merged_regions_contain_their_parts() {
        let parts: Vec<Region> = (0..40)
            .map(|i| f64::from(i) * 10.0)
            .map(|x| region([x, 0.3 * x], [x + 10.0, x], 3.0, &[0.0, 1.0 + x]))
            .collect();
        let joined = parts[0].joined(&parts[39]);
        for part in [&parts[0], &parts[39]] {
            for end in [part.from, part.to] {
                assert!(joined.segment_distance(end) + part.radius <= joined.radius + 1e-9);
            }
        }
        let few = merged_regions(parts.clone(), &[0.0, 0.1], 7);
        assert_eq!(few.len(), 7);
        for part in &parts {
            let errors = part.errors[1];
            let inside = |r: &Region| r.distance(0, part.from) <= 1e-9 && r.distance(0, part.to) <= 1e-9;
            assert!(few.iter().any(|r| inside(r) && r.errors[1] >= errors));
        }
        assert_eq!(merged_regions(parts, &[0.0, 1e3], 7), []);
    }

    #[test]
    fn a_crest_is_not_merged_with_its_slopes() {
        let plain = [0.0, 0.1, 0.2, 0.3];
        let errors = |rougher: f64| plain.map(|error| error * rougher);
        let slopes = region([0.0, 0.0], [2000.0, 0.0], 700.0, &errors(1.3));
        let crest = region([0.0, 0.0], [2000.0, 0.0], 8.0, &errors(5.0));
        let bank = |x: f64| region([x, 3000.0], [x + 200.0, 3000.0], 40.0, &errors(3.0));
        let few = merged_regions(vec![slopes.clone(), crest.clone(), bank(0.0), bank(200.0)], &plain, 3);
        assert_eq!(few, [slopes, crest, bank(0.0).joined(&bank(200.0))]);
    }

    #[test]
    fn masks_leave_out_only_regions_without_effect() {
        let mut random = lodestream_geometry::random::Random::new(21);
        let plain: Vec<f64> = (0..8).map(|s| 0.05 * f64::from(1 << s)).collect();
        let regions: Vec<Region> = (0..20)
            .map(|_| {
                let mut place = || [random.unit() * 2000.0 - 1000.0, random.unit() * 2000.0 - 1000.0];
                let (from, to) = (place(), place());
                let rougher = 0.5 + 4.0 * random.unit();
                region(from, to, 30.0, &plain.iter().map(|e| e * rougher).collect::<Vec<_>>())
            })
            .collect();
        let ranges = RegionRanges::new(&plain, &regions, 500.0, 1.0);
        let (mut left_out, mut counted) = (0, 0);
        for _ in 0..400 {
            let spacing = random.below(5) as u8;
            let number = |random: &mut lodestream_geometry::random::Random| {
                random.below(64 >> spacing) as i32 - (32 >> spacing)
            };
            let tile = TileId { spacing, x: number(&mut random), y: number(&mut random) };
            let mask = ranges.mask(tile);
            counted += mask.count_ones();
            left_out += 20 - mask.count_ones();
            let taken: Vec<Region> =
                (0..20).filter(|r| mask & (1 << r) != 0).map(|r| regions[r].clone()).collect();
            let fewer = RegionRanges::new(&plain, &taken, 500.0, 1.0);
            for _ in 0..20 {
                let at = DVec2::from(tile.origin().map(|x| x as f64 + random.unit() * tile.side() as f64));
                assert_eq!(fewer.morph(spacing, at), ranges.morph(spacing, at));
                assert!(ranges.end(tile) >= ranges.morph(spacing, at)[1]);
            }
        }
        assert!(left_out > 400 && counted > 400, "{left_out} left out, {counted} counted");
    }
}
