//! Prediction of a number from several candidates.
//!
//! Candidates are ranked by their recent errors, which encoder and decoder both know. For round shapes the
//! best-ranked candidate is used and nothing is transmitted. In meshes of straight, flat parts a number usually
//! equals an earlier one (a height, the start of a row, an edge across a seam), and coding which candidate to use
//! costs less than the difference to the best-ranked one.

use crate::codec::model::MAX_CHOICES;
use crate::codec::residual::quarter_octaves;
use crate::entropy::range_coder::Coder;
use crate::mesh::vec3::{Vec3, cross, dot, length, sub};
use crate::numbers::floored;

/// Fixed-point fraction of quarter octaves, the unit of error sizes.
const PARTS: i32 = 16;
/// Adaptation rate: a size moves by 1/this towards the newest error.
const FOLLOW: i32 = 4;
/// Recent values remembered per axis.
pub(super) const RECENT_VALUES: usize = 8;

/// Recent error sizes of each of `K` candidates, in quarter octaves × [`PARTS`].
pub(super) struct CandidateErrors<const K: usize> {
    /// Over all numbers.
    all: [i32; K],
    /// Over the numbers for which the candidate was chosen.
    chosen: [i32; K],
}

/// A candidate to predict from.
#[derive(Clone, Copy)]
pub(super) struct Choice {
    candidate: usize,
    /// The predicted value.
    pub(super) value: i32,
    /// Expected size of the residual, in quarter octaves.
    pub(super) size: i32,
}

impl<const K: usize> CandidateErrors<K> {
    /// Initial error sizes, in quarter octaves.
    pub(super) fn new(all: [i32; K], chosen: [i32; K]) -> Self {
        Self { all: all.map(|size| size * PARTS), chosen: chosen.map(|size| size * PARTS) }
    }

    /// Selects a candidate: the best-ranked one, or with `choosing` the one that is coded. At least one must be
    /// given.
    pub(super) fn choose<C: Coder>(
        &self,
        coder: &mut C,
        context: usize,
        candidates: [Option<i32>; K],
        choosing: bool,
        actual: Option<i32>,
    ) -> Choice {
        let choices = Choices::new(self, candidates, choosing);
        let wanted = actual.filter(|_| choosing).map(|actual| choices.clone().cheapest(actual));
        let mut taken = Choice { candidate: 0, value: 0, size: 0 };
        for (place, choice) in choices.enumerate() {
            taken = choice;
            // The last place is implied.
            if !choosing || place + 1 < MAX_CHOICES && coder.bit(context + place, wanted == Some(place)) {
                break;
            }
        }
        taken
    }

    /// Updates the error sizes with the actual value.
    pub(super) fn follow(&mut self, candidates: [Option<i32>; K], choice: Choice, actual: i32) {
        for (k, candidate) in candidates.into_iter().enumerate() {
            let Some(candidate) = candidate else { continue };
            let off = size_of(actual, candidate) * PARTS;
            self.all[k] += (off - self.all[k]) / FOLLOW;
            if k == choice.candidate {
                self.chosen[k] += (off - self.chosen[k]) / FOLLOW;
            }
        }
    }
}

/// Iterates over candidates by rank, then by number; each value once.
#[derive(Clone)]
struct Choices<'a, const K: usize> {
    /// Expected error sizes, × [`PARTS`].
    sizes: &'a [i32; K],
    values: [i32; K],
    /// Per candidate: size × 2^[`CANDIDATE_BITS`] + its number, or [`UNAVAILABLE`], so the minimum needs no branch.
    keys: [i32; K],
    given: [i32; MAX_CHOICES],
    count: usize,
}

/// Low bits of a key, which hold the candidate's number.
const CANDIDATE_BITS: u32 = 5;
/// Key of a candidate that is not given or was returned.
const UNAVAILABLE: i32 = i32::MAX;

impl<'a, const K: usize> Choices<'a, K> {
    fn new(errors: &'a CandidateErrors<K>, candidates: [Option<i32>; K], choosing: bool) -> Self {
        const { assert!(K <= 1 << CANDIDATE_BITS, "a candidate has no key") };
        let mut keys = [UNAVAILABLE; K];
        for (((key, candidate), &size), k) in keys.iter_mut().zip(&candidates).zip(&errors.all).zip(0..) {
            if candidate.is_some() {
                *key = size << CANDIDATE_BITS | k;
            }
        }
        let sizes = if choosing { &errors.chosen } else { &errors.all };
        let values = candidates.map(Option::unwrap_or_default);
        Self { sizes, values, keys, given: [0; MAX_CHOICES], count: 0 }
    }

    /// The place with the lowest estimated cost for the encoder: a place further down costs half a bit.
    fn cheapest(self, actual: i32) -> usize {
        let costs = self.zip(0..).map(|(choice, place)| 2 * place + size_of(actual, choice.value));
        costs.enumerate().min_by_key(|&(_, cost)| cost).map_or(0, |(place, _)| place)
    }
}

impl<const K: usize> Iterator for Choices<'_, K> {
    type Item = Choice;

    fn next(&mut self) -> Option<Choice> {
        while self.count < MAX_CHOICES {
            let key = self.keys.iter().copied().min().filter(|&key| key != UNAVAILABLE)?;
            let candidate = (key & ((1 << CANDIDATE_BITS) - 1)).unsigned_abs() as usize;
            self.keys[candidate] = UNAVAILABLE;
            let value = self.values[candidate];
            if !self.given[..self.count].contains(&value) {
                self.given[self.count] = value;
                self.count += 1;
                return Some(Choice { candidate, value, size: self.sizes[candidate].div_euclid(PARTS) });
            }
        }
        None
    }
}

/// Size of an error, in quarter octaves.
fn size_of(actual: i32, candidate: i32) -> i32 {
    quarter_octaves(f64::from(actual.abs_diff(candidate)) + 0.25)
}

/// The most recent distinct values, newest first.
#[derive(Default)]
pub(super) struct RecentValues([Option<i32>; RECENT_VALUES]);

impl RecentValues {
    pub(super) fn values(&self) -> &[Option<i32>; RECENT_VALUES] {
        &self.0
    }

    /// Adds a value.
    pub(super) fn follow(&mut self, value: i32) {
        let at = self.0.iter().position(|&v| v == Some(value)).unwrap_or(RECENT_VALUES - 1);
        self.0[..=at].rotate_right(1);
        self.0[0] = Some(value);
    }
}

/// A triangle in space with its texture coordinates.
pub(super) struct Chart {
    pub(super) at: [Vec3; 3],
    pub(super) uv: [[i32; 2]; 3],
}

impl Chart {
    /// Maps another point by the triangle's affine map: exact for flat charts; a parallelogram rule if the triangle
    /// has no area.
    pub(super) fn affine(&self, point: Vec3) -> [i32; 2] {
        let [e, f, d] = [self.at[1], self.at[2], point].map(|p| sub(p, self.at[0]));
        let (ee, ef, ff) = (dot(e, e), dot(e, f), dot(f, f));
        let area = ee * ff - ef * ef;
        let (s, t) = if area > 0.0 {
            let (de, df) = (dot(d, e), dot(d, f));
            ((de * ff - df * ef) / area, (df * ee - de * ef) / area)
        } else {
            (1.0, -1.0)
        };
        [0, 1].map(|k| {
            let [a, b, c] = self.uv.map(|uv| f64::from(uv[k]));
            rounded(a + s * (b - a) + t * (c - a))
        })
    }

    /// The third corner's texture coordinates from the other two, on either side of them, if the map preserves angles
    /// (Isenburg and Snoeyink, Compressing texture coordinates with selective linear predictions, 2003). `ratio` is a
    /// cell's height over its width. `None` if the two corners coincide.
    pub(super) fn similar(&self, ratio: f64) -> Option<[[i32; 2]; 2]> {
        let [e, d] = [self.at[1], self.at[2]].map(|p| sub(p, self.at[0]));
        let square = dot(e, e);
        if square <= 0.0 || self.uv[0] == self.uv[1] {
            return None;
        }
        let (along, across) = (dot(d, e) / square, length(cross(e, d)) / square);
        let [a, b] = [0, 1].map(|k| self.uv[k].map(f64::from));
        let [du, dv] = [b[0] - a[0], b[1] - a[1]];
        Some([across, -across].map(|y| {
            [rounded(a[0] + along * du - y * dv * ratio), rounded(a[1] + along * dv + y * du / ratio)]
        }))
    }
}

/// Rounds to the nearest integer, bounded.
pub(super) fn rounded(x: f64) -> i32 {
    const MOST: f64 = 1e8;
    floored((x + 0.5).clamp(-MOST, MOST))
}

#[cfg(test)]
mod tests {
    use std::collections::VecDeque;

    use super::*;
    use crate::error::DecodeError;
    use crate::random::Random;

    /// Records coded bits; returns the scripted bits first, if any.
    #[derive(Default)]
    struct ScriptedCoder {
        coded: Vec<(usize, bool)>,
        script: VecDeque<bool>,
    }

    impl Coder for ScriptedCoder {
        fn bit(&mut self, context: usize, value: bool) -> bool {
            let bit = self.script.pop_front().unwrap_or(value);
            self.coded.push((context, bit));
            bit
        }
        fn mix<const N: usize>(&mut self, _: [usize; N], _: usize, _: bool) -> bool {
            unreachable!("choices are not mixed")
        }
        fn raw(&mut self, _: u32, _: u32) -> u32 {
            unreachable!("choices have contexts")
        }
        fn check(&self) -> Result<(), DecodeError> {
            Ok(())
        }
    }

    #[test]
    fn candidates_come_by_rank_then_number_each_value_once() {
        const K: usize = 21;
        let (mut random, mut cut) = (Random::new(7), 0);
        for _ in 0..2000 {
            // Few sizes and values, so many coincide.
            let mut size = || [(); K].map(|()| i32::try_from(random.below(7)).unwrap() * 9 - 30);
            let errors = CandidateErrors { all: size(), chosen: size() };
            let candidates =
                [(); K].map(|()| (random.below(5) > 0).then(|| i32::try_from(random.below(16)).unwrap()));
            let mut order: Vec<usize> = (0..K).filter(|&k| candidates[k].is_some()).collect();
            order.sort_by_key(|&k| errors.all[k]);
            let mut values = Vec::new();
            order.retain(|&k| {
                values.push(candidates[k]);
                values.iter().filter(|value| **value == candidates[k]).count() == 1
            });
            cut += usize::from(order.len() > MAX_CHOICES);
            order.truncate(MAX_CHOICES);
            for (choosing, sizes) in [(false, &errors.all), (true, &errors.chosen)] {
                let expected = order.iter().map(|&k| (k, candidates[k].unwrap(), sizes[k].div_euclid(PARTS)));
                let choices =
                    Choices::new(&errors, candidates, choosing).map(|c| (c.candidate, c.value, c.size));
                assert!(choices.eq(expected), "{:?} {candidates:?}", errors.all);
            }
        }
        assert!(cut > 50, "{cut} lists were longer than what may be chosen of");
    }

    /// Twenty candidates, 1000 apart, the first ranked best.
    fn ladder() -> (CandidateErrors<20>, [Option<i32>; 20]) {
        let numbers = std::array::from_fn(|k| i32::try_from(k).unwrap());
        (CandidateErrors { all: numbers, chosen: [5 * PARTS; 20] }, numbers.map(|k| Some(1000 * k)))
    }

    #[test]
    fn a_choice_is_coded_in_unary_with_the_last_place_implied() {
        let (errors, candidates) = ladder();
        for place in 0..MAX_CHOICES {
            let value = candidates[place].unwrap();
            let mut notes = ScriptedCoder::default();
            let choice = errors.choose(&mut notes, 70, candidates, true, Some(value));
            assert_eq!((choice.candidate, choice.value, choice.size), (place, value, 5));
            let words = (0..=place).filter(|&k| k + 1 < MAX_CHOICES).map(|k| (70 + k, k == place));
            assert!(notes.coded.iter().copied().eq(words), "{:?}", notes.coded);
            // A decoder takes the same choice.
            let script = notes.coded.iter().map(|&(_, bit)| bit).collect();
            let mut decoder = ScriptedCoder { script, ..ScriptedCoder::default() };
            let same = errors.choose(&mut decoder, 70, candidates, true, None);
            assert_eq!((same.candidate, same.value, same.size), (place, value, 5));
            assert!(decoder.coded == notes.coded && decoder.script.is_empty());
        }
    }

    #[test]
    fn without_choosing_the_best_ranked_candidate_is_used() {
        let (errors, mut candidates) = ladder();
        candidates[0] = None;
        let mut notes = ScriptedCoder::default();
        let choice = errors.choose(&mut notes, 70, candidates, false, Some(7000));
        assert_eq!((choice.candidate, choice.value, choice.size), (1, 1000, 0));
        assert!(notes.coded.is_empty());
    }

    #[test]
    fn the_last_candidate_is_taken_when_all_others_are_denied() {
        let errors = CandidateErrors { all: [3, 2, 1], chosen: [0; 3] };
        let mut decoder = ScriptedCoder { script: [false, false].into(), ..ScriptedCoder::default() };
        let choice = errors.choose(&mut decoder, 0, [Some(4), None, Some(5)], true, None);
        assert_eq!((choice.candidate, decoder.coded.len()), (0, 2));
    }

    #[test]
    fn an_encoder_takes_the_cheapest_place() {
        let errors = CandidateErrors { all: [0, 1], chosen: [0; 2] };
        let place = |values: [i32; 2]| Choices::new(&errors, values.map(Some), true).cheapest(100);
        // Sizes of errors 4, 3 and 2 are 8, 6 and 4; a place costs 2.
        assert_eq!([[104, 98], [103, 98], [97, 102], [96, 104]].map(place), [1, 0, 0, 0]);
        assert_eq!([[101, 100], [100, 100], [100, 99]].map(place), [1, 0, 0]);
        // A candidate far down the list must be much closer.
        let (errors, candidates) = ladder();
        let place = |actual| Choices::new(&errors, candidates, true).cheapest(actual);
        assert_eq!([3000, 3001, 15_000].map(place), [3, 3, 0]);
    }

    #[test]
    fn error_sizes_adapt_to_all_and_to_chosen_candidates() {
        let mut errors = CandidateErrors::new([16; 3], [0; 3]);
        assert_eq!((errors.all, errors.chosen), ([16 * PARTS; 3], [0; 3]));
        let choice = Choice { candidate: 1, value: 12, size: 0 };
        // An error of 0 has size -8, of 2 size 4; sizes move by a quarter of the difference.
        errors.follow([Some(10), Some(12), None], choice, 10);
        assert_eq!(errors.all, [(16 - 6) * PARTS, (16 - 3) * PARTS, 16 * PARTS]);
        assert_eq!(errors.chosen, [0, PARTS, 0]);
    }

    #[test]
    fn recent_values_are_distinct_and_the_oldest_is_dropped() {
        let mut newest = RecentValues::default();
        let values =
            |newest: &RecentValues| newest.values().iter().map_while(|value| *value).collect::<Vec<_>>();
        for (value, then) in [(5, vec![5]), (6, vec![6, 5]), (6, vec![6, 5]), (5, vec![5, 6])] {
            newest.follow(value);
            assert_eq!(values(&newest), then);
        }
        (10..16).for_each(|value| newest.follow(value));
        assert_eq!(values(&newest), [15, 14, 13, 12, 11, 10, 5, 6]);
        newest.follow(11);
        assert_eq!(values(&newest), [11, 15, 14, 13, 12, 10, 5, 6]);
        newest.follow(9);
        assert_eq!(values(&newest), [9, 11, 15, 14, 13, 12, 10, 5]);
    }

    #[test]
    fn an_affine_chart_extends_its_plane() {
        let at = [[0.0, 0.0, 1.0], [4.0, 0.0, 1.0], [1.0, 4.0, 1.0]];
        // Two texels per unit along x, three down along y.
        let uv = [[10, 90], [18, 90], [12, 78]];
        let chart = Chart { at, uv };
        for (point, there) in [([5.0, 4.0], [20, 78]), ([-3.0, 7.0], [4, 69]), ([2.0, 1.0], [14, 87])] {
            assert_eq!(chart.affine([point[0], point[1], 1.0]), there);
            // A point off the plane maps as its projection.
            assert_eq!(chart.affine([point[0], point[1], -8.0]), there);
        }
        // A triangle without area has no plane: the parallelogram rule applies to texture coordinates.
        let flat = Chart { at: [at[0], at[1], [8.0, 0.0, 1.0]], uv };
        assert_eq!(flat.affine([5.0, 4.0, 1.0]), [10 + 18 - 12, 90 + 90 - 78]);
    }

    #[test]
    fn similar_triangles_lie_on_either_side_of_an_edge() {
        let at = [[3.0, 0.0, 0.0], [3.0, 4.0, 0.0], [3.0, 1.0, 2.0]];
        let similar = |from, to, ratio| Chart { at, uv: [from, to, [0; 2]] }.similar(ratio);
        assert_eq!(similar([100, 100], [108, 100], 1.0), Some([[102, 104], [102, 96]]));
        // Cells twice as high as wide: the same length is half as many cells vertically.
        assert_eq!(similar([100, 100], [108, 100], 2.0), Some([[102, 102], [102, 98]]));
        assert_eq!(similar([100, 100], [100, 108], 2.0), Some([[92, 102], [108, 102]]));
        assert_eq!(similar([100, 100], [100, 100], 1.0), None);
        let point = Chart { at: [at[0], at[0], at[2]], uv: [[1, 2], [3, 4], [0; 2]] };
        assert_eq!(point.similar(1.0), None);
    }

    #[test]
    fn numbers_are_rounded_half_up_and_bounded() {
        let numbers = [0.5, -0.5, 1.49, -1.51, 1e30, -f64::INFINITY, f64::NAN];
        assert_eq!(numbers.map(rounded), [1, 0, 1, -2, 100_000_000, -100_000_000, 0]);
    }
}
