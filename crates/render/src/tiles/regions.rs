//! Regions that are rougher than the rest of the world, and the distances up to which each spacing is drawn there.
//!
//! A region makes itself finer, its surroundings less, and never anything coarser:
//!
//! end(s, p) = max(plain end(s), max over regions r of (end(r, s) − [`FALLOFF`] · distance(s, p, r)))
//!
//! and likewise for where points begin to slide. distance(s, p, r) is 0 up to the region and the [`grown`] width around it,
//! which from spacing to spacing grows by a tile's diagonal. So a point of a tile of spacing s that is finer for a region
//! is no farther from what that region makes of spacing s + 1, and each region's own distances keep the rule of
//! [`Ranges`]: a coarser tile has not begun to slide where a finer one may still meet it. Their maxima keep it too:
//! whichever region gives the finer spacing its end gives the coarser one a beginning beyond it.

use glam::DVec2;
use lodestream_terrain::RoughPlace;

use super::ranges::Ranges;
use super::tile::{TILE_CELLS, TileId};

/// Most regions: bits of a tile's mask.
pub const MAX_REGIONS: usize = 32;
/// By how much a region's distances shrink per distance from it and what is grown. Steep: any slope will do.
pub const FALLOFF: f64 = 64.0;
/// A region counts for a tile if its distances come this close to the plain ones: what the shader computes in other precision
/// must not differ between tiles that share a point.
const NEARLY: f64 = 0.999;
/// Regions no more than this much rougher than the rest are not worth their cost.
const WORTH: f64 = 1.25;

/// What lies within a radius of a segment, and the errors of drawing it with each spacing. Grid units.
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
    /// A place of a terrain, with `errors` as spacings' errors in grid units.
    #[must_use]
    pub fn new(place: &RoughPlace, errors: Vec<f64>) -> Self {
        let at = |[x, y]: [i64; 2]| DVec2::new(x as f64, y as f64);
        Self { from: at(place.from), to: at(place.to), radius: place.radius as f64, errors }
    }

    /// A disc around a rectangle.
    #[must_use]
    pub fn around(low: DVec2, high: DVec2, errors: Vec<f64>) -> Self {
        let middle = 0.5 * (low + high);
        Self { from: middle, to: middle, radius: 0.5 * (high - low).length(), errors }
    }

    /// Distance of a place from the region grown for a spacing, 0 inside.
    #[must_use]
    pub fn distance(&self, spacing: u8, at: DVec2) -> f64 {
        (self.segment_distance(at) - self.radius - grown(spacing)).max(0.0)
    }

    fn segment_distance(&self, at: DVec2) -> f64 {
        let (along, offset) = (self.to - self.from, at - self.from);
        let share = (offset.dot(along) / along.length_squared().max(1e-30)).clamp(0.0, 1.0);
        (offset - share * along).length()
    }

    /// A distance that no place of a tile is nearer than.
    fn tile_distance(&self, tile: TileId) -> f64 {
        let half = 0.5 * tile.side() as f64;
        let middle = DVec2::from(tile.origin().map(|x| x as f64 + half));
        let nearest = self.segment_distance(middle) - half * std::f64::consts::SQRT_2;
        (nearest - self.radius - grown(tile.spacing)).max(0.0)
    }

    /// Whether it is worth being treated by itself, where the rest has the errors `plain`.
    fn is_rougher(&self, plain: &[f64]) -> bool {
        self.errors.iter().zip(plain).any(|(own, plain)| *own > WORTH * plain)
    }

    /// One region for two: around the ends farthest from each other.
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

    /// What it costs, about, where the rest has the errors `plain`. Of each spacing, the tiles that make up the area that it
    /// has for that spacing, by how many more places they are drawn from: up to a distance that grows as the next coarser
    /// spacing's error, so by its square.
    fn cost(&self, plain: &[f64]) -> f64 {
        let length = self.from.distance(self.to);
        let of_spacing = |(spacing, (own, plain)): (u8, (&f64, &f64))| {
            let radius = self.radius + grown(spacing);
            let area = 2.0 * radius * (length + radius * std::f64::consts::FRAC_PI_2);
            let rougher = own / plain.max(f64::MIN_POSITIVE);
            (rougher * rougher - 1.0).max(0.0) * area / f64::from(spacing).exp2().powi(2)
        };
        (0..).zip(self.errors.iter().zip(plain).skip(1)).map(of_spacing).sum()
    }
}

/// Width around a region that is as fine as the region itself, for a spacing: the diagonals of one tile of each finer one.
#[must_use]
pub fn grown(spacing: u8) -> f64 {
    f64::from(TILE_CELLS) * std::f64::consts::SQRT_2 * ((1_u64 << spacing.min(62)) - 1) as f64
}

/// The regions that are rougher than `plain`, `most` at most: those of which one makes least finer are joined, so a sharp
/// crest is not joined with the gentle slopes around it, although it lies within them.
#[must_use]
pub fn worthwhile(mut regions: Vec<Region>, plain: &[f64], most: usize) -> Vec<Region> {
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

/// Distances everywhere: the plain ones, and those of regions.
#[derive(Clone, Debug)]
pub struct Reaches {
    plain: Ranges,
    regions: Vec<(Region, Ranges)>,
}

impl Reaches {
    /// Distances for a view, see [`Ranges::new`]. All in grid units. At most [`MAX_REGIONS`] regions count.
    #[must_use]
    pub fn new(plain: &[f64], regions: &[Region], scale_px: f64, target_px: f64) -> Self {
        let ranges = |errors: &[f64]| Ranges::new(errors, scale_px, target_px, 1.0);
        let regions = regions.iter().take(MAX_REGIONS);
        let regions: Vec<_> = regions.map(|region| (region.clone(), ranges(&region.errors))).collect();
        Self { plain: ranges(plain), regions }
    }

    /// Up to which distance of its nearest point a tile is drawn with its spacing.
    #[must_use]
    pub fn end(&self, tile: TileId) -> f64 {
        let plain = self.plain.end(tile.spacing);
        self.regions.iter().fold(plain, |end, (region, ranges)| {
            let own = ranges.end(tile.spacing);
            if own > end { end.max(own - FALLOFF * region.tile_distance(tile)) } else { end }
        })
    }

    /// Where points of a spacing begin to slide and have arrived, away from all regions.
    #[must_use]
    pub fn plain(&self, spacing: u8) -> [f64; 2] {
        self.plain.morph(spacing)
    }

    /// The regions, with where points of each spacing begin to slide and have arrived inside.
    pub fn regions(&self) -> impl Iterator<Item = (&Region, &Ranges)> {
        self.regions.iter().map(|(region, ranges)| (region, ranges))
    }

    /// Which regions may matter to points of a tile: bit r for the r-th.
    #[must_use]
    pub fn mask(&self, tile: TileId) -> u32 {
        let plain = self.plain.morph(tile.spacing);
        if plain[1].is_infinite() {
            return 0;
        }
        let matters = |(region, ranges): &(Region, Ranges)| {
            let away = FALLOFF * region.tile_distance(tile);
            ranges.morph(tile.spacing).iter().zip(plain).any(|(own, plain)| own - away > NEARLY * plain)
        };
        let bits = self.regions.iter().enumerate();
        bits.filter(|(_, region)| matters(region)).fold(0, |mask, (bit, _)| mask | 1 << bit)
    }

    /// Where a point begins to slide and has arrived.
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
    fn joined_regions_hold_both_and_too_many_are_joined() {
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
        let few = worthwhile(parts.clone(), &[0.0, 0.1], 7);
        assert_eq!(few.len(), 7);
        for part in &parts {
            let errors = part.errors[1];
            let inside = |r: &Region| r.distance(0, part.from) <= 1e-9 && r.distance(0, part.to) <= 1e-9;
            assert!(few.iter().any(|r| inside(r) && r.errors[1] >= errors));
        }
        assert_eq!(worthwhile(parts, &[0.0, 1e3], 7), []);
    }

    #[test]
    fn a_crest_is_not_joined_with_its_slopes() {
        let plain = [0.0, 0.1, 0.2, 0.3];
        let errors = |rougher: f64| plain.map(|error| error * rougher);
        let slopes = region([0.0, 0.0], [2000.0, 0.0], 700.0, &errors(1.3));
        let crest = region([0.0, 0.0], [2000.0, 0.0], 8.0, &errors(5.0));
        let bank = |x: f64| region([x, 3000.0], [x + 200.0, 3000.0], 40.0, &errors(3.0));
        let few = worthwhile(vec![slopes.clone(), crest.clone(), bank(0.0), bank(200.0)], &plain, 3);
        assert_eq!(few, [slopes, crest, bank(0.0).joined(&bank(200.0))]);
    }

    #[test]
    fn masks_leave_out_only_what_does_not_matter() {
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
        let reaches = Reaches::new(&plain, &regions, 500.0, 1.0);
        let (mut left_out, mut counted) = (0, 0);
        for _ in 0..400 {
            let spacing = random.below(5) as u8;
            let number = |random: &mut lodestream_geometry::random::Random| {
                random.below(64 >> spacing) as i32 - (32 >> spacing)
            };
            let tile = TileId { spacing, x: number(&mut random), y: number(&mut random) };
            let mask = reaches.mask(tile);
            counted += mask.count_ones();
            left_out += 20 - mask.count_ones();
            let taken: Vec<Region> =
                (0..20).filter(|r| mask & (1 << r) != 0).map(|r| regions[r].clone()).collect();
            let fewer = Reaches::new(&plain, &taken, 500.0, 1.0);
            for _ in 0..20 {
                let at = DVec2::from(tile.origin().map(|x| x as f64 + random.unit() * tile.side() as f64));
                assert_eq!(fewer.morph(spacing, at), reaches.morph(spacing, at));
                assert!(reaches.end(tile) >= reaches.morph(spacing, at)[1]);
            }
        }
        assert!(left_out > 400 && counted > 400, "{left_out} left out, {counted} counted");
    }
}
