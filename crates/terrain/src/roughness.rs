//! Places where stamps make the terrain rougher, so that it needs finer levels.

use super::numbers::{real, truncated};
use super::stamp::{Position, Stamp};
use super::world::Terrain;

/// Most places measured, those of the steepest stamps first.
const MAX_PLACES: usize = 64;
/// Most stamp segments around a place that are included.
const MAX_SEGMENTS_AROUND: usize = 32;
/// Half width of the separately measured strip along a line, since profiles bend at a crest. Stamps with little more
/// reach are one place.
const CREST: i64 = 8;

/// A rougher place: the points within `radius` of a segment.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RoughPlace {
    /// One end of the segment, on the finest grid.
    pub from: Position,
    /// The other.
    pub to: Position,
    /// In finest grid units.
    pub radius: i64,
    /// Errors at each level, 0 to the finest, as in [`Terrain::level_errors`].
    pub errors: Vec<u32>,
}

impl Terrain {
    /// Places around stamps with their level errors: along their lines, and their whole reach. Many are no rougher
    /// than the rest.
    ///
    /// A stamp is measured together with the stamps that overlap it: a fixed one may be a deep cut through hills but
    /// a shallow one through a valley that another stamp has made. If these have more than 32 segments, it is
    /// measured alone. The steepest stamps come first, 64 places at most; the rest is assumed to be no rougher than
    /// the terrain. Cost: 0.7 ms per place, 1.6 ms with 30 segments around it, 0.1 s at most.
    #[must_use]
    pub fn rough_places(&self) -> Vec<RoughPlace> {
        let mut stamps: Vec<&Stamp> = self.stamps.iter().collect();
        stamps.sort_by_cached_key(|stamp| std::cmp::Reverse(stamp.steepness()));
        let parts = stamps.into_iter().flat_map(|stamp| {
            let measured = self.uneroded(self.around(stamp));
            parts(stamp).into_iter().map(move |(from, to, radius, places)| {
                let errors = measured.measured(|_| places.clone());
                RoughPlace { from, to, radius, errors }
            })
        });
        parts.take(MAX_PLACES).collect()
    }

    /// A stamp with the stamps that overlap it, in order; alone if these are too many.
    fn around(&self, stamp: &Stamp) -> Vec<Stamp> {
        let meets = |other: &&Stamp| {
            let [a, b] = [stamp.footprint(), other.footprint()];
            let overlap = |a: [i64; 2], b: [i64; 2]| a[0] <= b[1] && b[0] <= a[1];
            overlap(a.0, b.0) && overlap(a.1, b.1)
        };
        let mut around = Vec::new();
        let mut segments = 0;
        for other in self.stamps.iter().filter(meets) {
            segments += other.segments();
            if segments > MAX_SEGMENTS_AROUND {
                return vec![stamp.clone()];
            }
            around.push(other.clone());
        }
        around
    }
}

/// Parts of a stamp to measure: segment, radius, and sample positions.
fn parts(stamp: &Stamp) -> Vec<(Position, Position, i64, Vec<Position>)> {
    let (line, reach) = (stamp.line(), stamp.reach());
    let alone = [[line[0], line[0]]];
    let pairs: Vec<[Position; 2]> = line.windows(2).map(|pair| [pair[0], pair[1]]).collect();
    let pairs = if pairs.is_empty() { &alone[..] } else { &pairs[..] };
    let middle = |[a, b]: [Position; 2]| [0, 1].map(|i| (a[i] + b[i]) / 2);
    let mut parts = Vec::new();
    for &pair in pairs {
        let (from, away) = (middle(pair), sideways(pair));
        let at = |eighths: i64| [0, 1].map(|i| from[i] + truncated(away[i] * real(reach)) * eighths / 8);
        let along = [from, pair[0], pair[1]];
        let mut across = [2, 4, 6, 8].map(at).to_vec();
        if reach <= 4 * CREST || pair[0] == pair[1] {
            across.extend(along);
        } else {
            parts.push((pair[0], pair[1], CREST, along.to_vec()));
        }
        parts.push((pair[0], pair[1], reach, across));
    }
    parts
}

/// Unit vector perpendicular to a segment.
fn sideways([a, b]: [Position; 2]) -> [f64; 2] {
    let [dx, dy] = [0, 1].map(|i| real(b[i] - a[i]));
    let length = (dx * dx + dy * dy).sqrt();
    if length > 0.0 { [-dy / length, dx / length] } else { [0.0, 1.0] }
}

#[cfg(test)]
mod tests {
    use super::super::{Mode, Parameters, Scratch, Shape};
    use super::*;

    #[test]
    fn a_crest_is_rougher_than_its_slopes_and_flat_ground_is_not() {
        let parameters =
            Parameters { finest_level: 9, extent_log2: 4, amplitude: 9000, ..Default::default() };
        let from = [-900, 300];
        let ridge = Shape::Ridge { from, to: [1500, 700], half_width: 800, height: 60_000 };
        let lawn = Shape::Plateau { centre: [-3000, -900], radius: 400, falloff: 900, height: 300 };
        let stamps = [ridge, lawn].map(|shape| Stamp { mode: Mode::Additive, shape });
        let terrain = Terrain::with_stamps(parameters, stamps.to_vec()).unwrap();
        let ground = terrain.level_errors();
        let places = terrain.rough_places();
        assert_eq!(places.len(), 3);
        let rougher =
            |place: &RoughPlace, level: usize| place.errors[level] as f64 / f64::from(ground[level]);
        let [crest, slopes, lawn] = [&places[0], &places[1], &places[2]];
        assert_eq!((crest.from, crest.to, crest.radius, slopes.radius), (from, [1500, 700], CREST, 800));
        // The crest bends by twice 2 · 60000 / 800 per grid unit.
        for level in 3..9 {
            assert!(rougher(crest, level) > 2.0, "level {level}: {}", rougher(crest, level));
        }
        assert!(rougher(slopes, 8) < 1.5 && rougher(lawn, 8) < 1.5 && rougher(lawn, 4) < 1.5);
        assert!(crest.errors.last() == Some(&0));

        // The errors measured at three places of the crest hold for a fourth.
        let mut scratch = Scratch::new();
        let patch = terrain.patch_errors(1, 1, &mut scratch).unwrap();
        assert!((3..9).all(|level| patch[level] < 2 * crest.errors[level]), "{patch:?} {:?}", crest.errors);
    }

    /// A river bed that cuts down to a fixed height is shallow where a valley exists already.
    #[test]
    fn a_river_bed_in_a_valley_has_the_error_of_its_remaining_depth() {
        let parameters =
            Parameters { finest_level: 9, extent_log2: 4, amplitude: 9000, ..Default::default() };
        let line = vec![[-700, -300], [-100, 60], [500, 40]];
        let bed = Stamp {
            mode: Mode::Fixed,
            shape: Shape::RiverBed { line: line.clone(), half_width: 40, depth: 20_000 },
        };
        let valley = Stamp {
            mode: Mode::Fixed,
            shape: Shape::Plateau { centre: [-100, 0], radius: 1100, falloff: 700, height: -19_000 },
        };
        let banks = |stamps: Vec<Stamp>| {
            let terrain = Terrain::with_stamps(parameters, stamps).unwrap();
            let places = terrain.rough_places();
            places.into_iter().find(|place| place.radius == 40).unwrap().errors
        };
        let (alone, within) = (banks(vec![bed.clone()]), banks(vec![valley.clone(), bed.clone()]));
        let levels = 5..9;
        assert!(levels.clone().all(|level| 5 * within[level] < alone[level]), "{alone:?} {within:?}");

        // With more stamps it is measured alone.
        let mut many = vec![valley; MAX_SEGMENTS_AROUND - 2];
        many.push(bed.clone());
        assert!(levels.clone().all(|level| 5 * banks(many.clone())[level] < alone[level]));
        many.insert(0, bed);
        assert_eq!(banks(many), alone);
    }

    #[test]
    fn measuring_ends_however_many_stamps_there_are() {
        let parameters = Parameters { finest_level: 8, extent_log2: 6, ..Default::default() };
        let line: Vec<Position> = (0..16).map(|k| [k * 20 - 100, k * 37 % 90]).collect();
        let stamp = |i| {
            let shape = Shape::RiverBed { line: line.clone(), half_width: 1 << 20, depth: i };
            Stamp { mode: Mode::Additive, shape }
        };
        let terrain = Terrain::with_stamps(parameters, (0..1024).map(stamp).collect()).unwrap();
        assert_eq!(terrain.rough_places().len(), MAX_PLACES);
    }
}
