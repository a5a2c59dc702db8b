//! Guesses at a number, of which one is taken: the most trusted, or where that is said another.
//!
//! A guess is trusted by how near it was lately, which a decoder knows as well as the encoder. In what is round the
//! most trusted is taken and nothing is said. In what is built of straight, flat parts a number mostly is one that is
//! there already (a height, a row's beginning, the edge across a seam), and saying which costs less than the
//! difference to any one of them.

use crate::codec::model::MOST_CHOICES;
use crate::codec::residual::quarter_octaves;
use crate::entropy::range_coder::Coder;
use crate::mesh::vec3::{Vec3, cross, dot, length, sub};
use crate::numbers::floored;

/// Parts of a quarter octave, the unit of sizes.
const PARTS: i32 = 16;
/// A size follows the newest error by a share of 1 to this.
const FOLLOW: i32 = 4;
/// Values of an axis that are remembered.
pub(super) const NEWEST: usize = 8;

/// How far each of `K` guesses at a number was off lately, in quarter octaves × [`PARTS`].
pub(super) struct Trust<const K: usize> {
    /// Of all times.
    all: [i32; K],
    /// Of those when it was chosen.
    chosen: [i32; K],
}

/// A guess to choose.
#[derive(Clone, Copy)]
pub(super) struct Choice {
    guess: usize,
    /// What it says.
    pub(super) value: i32,
    /// Size that its error is expected to have, in quarter octaves.
    pub(super) size: i32,
}

impl<const K: usize> Trust<K> {
    /// Trust that expects errors of so many quarter octaves.
    pub(super) fn new(all: [i32; K], chosen: [i32; K]) -> Self {
        Self { all: all.map(|size| size * PARTS), chosen: chosen.map(|size| size * PARTS) }
    }

    /// One of the guesses: the most trusted one, or where that is said any. There must be some.
    pub(super) fn choose<C: Coder>(
        &self,
        coder: &mut C,
        context: usize,
        guesses: [Option<i32>; K],
        choosing: bool,
        actual: Option<i32>,
    ) -> Choice {
        let choices = Choices::new(self, guesses, choosing);
        let wanted = actual.filter(|_| choosing).map(|actual| choices.clone().cheapest(actual));
        let mut taken = Choice { guess: 0, value: 0, size: 0 };
        for (place, choice) in choices.enumerate() {
            taken = choice;
            // The last place needs no word.
            if !choosing || place + 1 < MOST_CHOICES && coder.bit(context + place, wanted == Some(place)) {
                break;
            }
        }
        taken
    }

    /// Takes note of how far each was off.
    pub(super) fn follow(&mut self, guesses: [Option<i32>; K], choice: Choice, actual: i32) {
        for (k, guess) in guesses.into_iter().enumerate() {
            let Some(guess) = guess else { continue };
            let off = size_of(actual, guess) * PARTS;
            self.all[k] += (off - self.all[k]) / FOLLOW;
            if k == choice.guess {
                self.chosen[k] += (off - self.chosen[k]) / FOLLOW;
            }
        }
    }
}

/// Guesses to choose of, the most trusted first, of like trust the first; of those that say the same only that one.
#[derive(Clone)]
struct Choices<'a, const K: usize> {
    /// Sizes that errors are expected to have, × [`PARTS`].
    sizes: &'a [i32; K],
    values: [i32; K],
    /// Size of each guess × 2^[`GUESS_BITS`] + its number, or [`GONE`]: so the least is found without a branch.
    keys: [i32; K],
    given: [i32; MOST_CHOICES],
    count: usize,
}

/// Bits of a key that say whose it is.
const GUESS_BITS: u32 = 5;
/// Key of a guess that there is not, or that was given.
const GONE: i32 = i32::MAX;

impl<'a, const K: usize> Choices<'a, K> {
    fn new(trust: &'a Trust<K>, guesses: [Option<i32>; K], choosing: bool) -> Self {
        const { assert!(K <= 1 << GUESS_BITS, "a guess has no key") };
        let mut keys = [GONE; K];
        for (((key, guess), &size), k) in keys.iter_mut().zip(&guesses).zip(&trust.all).zip(0..) {
            if guess.is_some() {
                *key = size << GUESS_BITS | k;
            }
        }
        let sizes = if choosing { &trust.chosen } else { &trust.all };
        let values = guesses.map(Option::unwrap_or_default);
        Self { sizes, values, keys, given: [0; MOST_CHOICES], count: 0 }
    }

    /// The place of the choice that an encoder makes: the cheapest, about. A place down the list costs half a bit.
    fn cheapest(self, actual: i32) -> usize {
        let costs = self.zip(0..).map(|(choice, place)| 2 * place + size_of(actual, choice.value));
        costs.enumerate().min_by_key(|&(_, cost)| cost).map_or(0, |(place, _)| place)
    }
}

impl<const K: usize> Iterator for Choices<'_, K> {
    type Item = Choice;

    fn next(&mut self) -> Option<Choice> {
        while self.count < MOST_CHOICES {
            let key = self.keys.iter().copied().min().filter(|&key| key != GONE)?;
            let guess = (key & ((1 << GUESS_BITS) - 1)).unsigned_abs() as usize;
            self.keys[guess] = GONE;
            let value = self.values[guess];
            if !self.given[..self.count].contains(&value) {
                self.given[self.count] = value;
                self.count += 1;
                return Some(Choice { guess, value, size: self.sizes[guess].div_euclid(PARTS) });
            }
        }
        None
    }
}

/// Size of an error, in quarter octaves.
fn size_of(actual: i32, guess: i32) -> i32 {
    quarter_octaves(f64::from(actual.abs_diff(guess)) + 0.25)
}

/// Different values that came last, the newest first.
#[derive(Default)]
pub(super) struct Newest([Option<i32>; NEWEST]);

impl Newest {
    pub(super) fn values(&self) -> &[Option<i32>; NEWEST] {
        &self.0
    }

    /// Takes note of a value.
    pub(super) fn follow(&mut self, value: i32) {
        let at = self.0.iter().position(|&v| v == Some(value)).unwrap_or(NEWEST - 1);
        self.0[..=at].rotate_right(1);
        self.0[0] = Some(value);
    }
}

/// Corners of a triangle in space, and where textures are there.
pub(super) struct Chart {
    pub(super) at: [Vec3; 3],
    pub(super) uv: [[i32; 2]; 3],
}

impl Chart {
    /// Where the triangle's map takes another point of its plane: affine, so exact for what is flat, and a
    /// parallelogram where the four points are one.
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

    /// Where textures are at the third corner by the other two, if the map keeps angles, to either side of them
    /// (Isenburg and Snoeyink, Compressing texture coordinates with selective linear predictions, 2003). `ratio` is a
    /// cell's height over its width. `None` if the two are one.
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

/// The nearest integer, within far more than any grid has.
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

    /// Notes what is said; says what it was told to instead, where it was told something.
    #[derive(Default)]
    struct Notes {
        said: Vec<(usize, bool)>,
        told: VecDeque<bool>,
    }

    impl Coder for Notes {
        fn bit(&mut self, context: usize, value: bool) -> bool {
            let bit = self.told.pop_front().unwrap_or(value);
            self.said.push((context, bit));
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
    fn choices_come_by_trust_then_by_number_and_each_value_once() {
        const K: usize = 21;
        let (mut random, mut cut) = (Random::new(7), 0);
        for _ in 0..2000 {
            // Few sizes and values, of which many are alike.
            let mut size = || [(); K].map(|()| i32::try_from(random.below(7)).unwrap() * 9 - 30);
            let trust = Trust { all: size(), chosen: size() };
            let guesses =
                [(); K].map(|()| (random.below(5) > 0).then(|| i32::try_from(random.below(16)).unwrap()));
            let mut order: Vec<usize> = (0..K).filter(|&k| guesses[k].is_some()).collect();
            order.sort_by_key(|&k| trust.all[k]);
            let mut values = Vec::new();
            order.retain(|&k| {
                values.push(guesses[k]);
                values.iter().filter(|value| **value == guesses[k]).count() == 1
            });
            cut += usize::from(order.len() > MOST_CHOICES);
            order.truncate(MOST_CHOICES);
            for (choosing, sizes) in [(false, &trust.all), (true, &trust.chosen)] {
                let expected = order.iter().map(|&k| (k, guesses[k].unwrap(), sizes[k].div_euclid(PARTS)));
                let choices = Choices::new(&trust, guesses, choosing).map(|c| (c.guess, c.value, c.size));
                assert!(choices.eq(expected), "{:?} {guesses:?}", trust.all);
            }
        }
        assert!(cut > 50, "{cut} lists were longer than what may be chosen of");
    }

    /// Twenty guesses, 1000 apart, the first the most trusted.
    fn ladder() -> (Trust<20>, [Option<i32>; 20]) {
        let numbers = std::array::from_fn(|k| i32::try_from(k).unwrap());
        (Trust { all: numbers, chosen: [5 * PARTS; 20] }, numbers.map(|k| Some(1000 * k)))
    }

    #[test]
    fn a_choice_is_said_place_by_place_and_the_last_place_needs_no_word() {
        let (trust, guesses) = ladder();
        for place in 0..MOST_CHOICES {
            let value = guesses[place].unwrap();
            let mut notes = Notes::default();
            let choice = trust.choose(&mut notes, 70, guesses, true, Some(value));
            assert_eq!((choice.guess, choice.value, choice.size), (place, value, 5));
            let words = (0..=place).filter(|&k| k + 1 < MOST_CHOICES).map(|k| (70 + k, k == place));
            assert!(notes.said.iter().copied().eq(words), "{:?}", notes.said);
            // A decoder takes the same.
            let told = notes.said.iter().map(|&(_, bit)| bit).collect();
            let mut decoder = Notes { told, ..Notes::default() };
            let same = trust.choose(&mut decoder, 70, guesses, true, None);
            assert_eq!((same.guess, same.value, same.size), (place, value, 5));
            assert!(decoder.said == notes.said && decoder.told.is_empty());
        }
    }

    #[test]
    fn who_does_not_choose_says_nothing_and_takes_the_most_trusted() {
        let (trust, mut guesses) = ladder();
        guesses[0] = None;
        let mut notes = Notes::default();
        let choice = trust.choose(&mut notes, 70, guesses, false, Some(7000));
        assert_eq!((choice.guess, choice.value, choice.size), (1, 1000, 0));
        assert!(notes.said.is_empty());
    }

    #[test]
    fn of_fewer_guesses_than_may_be_chosen_of_the_last_is_taken_when_all_are_denied() {
        let trust = Trust { all: [3, 2, 1], chosen: [0; 3] };
        let mut decoder = Notes { told: [false, false].into(), ..Notes::default() };
        let choice = trust.choose(&mut decoder, 0, [Some(4), None, Some(5)], true, None);
        assert_eq!((choice.guess, decoder.said.len()), (0, 2));
    }

    #[test]
    fn an_encoder_takes_the_nearest_unless_a_nearer_place_is_as_cheap() {
        let trust = Trust { all: [0, 1], chosen: [0; 2] };
        let place = |values: [i32; 2]| Choices::new(&trust, values.map(Some), true).cheapest(100);
        // Sizes of 4, 3 and 2 off are 8, 6 and 4; a place costs 2.
        assert_eq!([[104, 98], [103, 98], [97, 102], [96, 104]].map(place), [1, 0, 0, 0]);
        assert_eq!([[101, 100], [100, 100], [100, 99]].map(place), [1, 0, 0]);
        // What lies far down the list must be much nearer.
        let (trust, guesses) = ladder();
        let place = |actual| Choices::new(&trust, guesses, true).cheapest(actual);
        assert_eq!([3000, 3001, 15_000].map(place), [3, 3, 0]);
    }

    #[test]
    fn trust_follows_what_was_there_and_trust_in_choices_what_was_chosen() {
        let mut trust = Trust::new([16; 3], [0; 3]);
        assert_eq!((trust.all, trust.chosen), ([16 * PARTS; 3], [0; 3]));
        let choice = Choice { guess: 1, value: 12, size: 0 };
        // Off by nothing is a size of -8, by 2 one of 4; a fourth of the way.
        trust.follow([Some(10), Some(12), None], choice, 10);
        assert_eq!(trust.all, [(16 - 6) * PARTS, (16 - 3) * PARTS, 16 * PARTS]);
        assert_eq!(trust.chosen, [0, PARTS, 0]);
    }

    #[test]
    fn the_newest_values_are_different_and_the_oldest_goes() {
        let mut newest = Newest::default();
        let values = |newest: &Newest| newest.values().iter().map_while(|value| *value).collect::<Vec<_>>();
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
    fn a_chart_goes_on_in_its_plane_as_it_is() {
        let at = [[0.0, 0.0, 1.0], [4.0, 0.0, 1.0], [1.0, 4.0, 1.0]];
        // Two texels a unit along x, three down along y.
        let uv = [[10, 90], [18, 90], [12, 78]];
        let chart = Chart { at, uv };
        for (point, there) in [([5.0, 4.0], [20, 78]), ([-3.0, 7.0], [4, 69]), ([2.0, 1.0], [14, 87])] {
            assert_eq!(chart.affine([point[0], point[1], 1.0]), there);
            // Above or below the plane is where its foot is.
            assert_eq!(chart.affine([point[0], point[1], -8.0]), there);
        }
        // A triangle of no area has no plane: the parallelogram of its texture coordinates is all there is.
        let flat = Chart { at: [at[0], at[1], [8.0, 0.0, 1.0]], uv };
        assert_eq!(flat.affine([5.0, 4.0, 1.0]), [10 + 18 - 12, 90 + 90 - 78]);
    }

    #[test]
    fn a_triangle_keeps_its_angles_to_either_side_of_an_edge() {
        let at = [[3.0, 0.0, 0.0], [3.0, 4.0, 0.0], [3.0, 1.0, 2.0]];
        let similar = |from, to, ratio| Chart { at, uv: [from, to, [0; 2]] }.similar(ratio);
        assert_eq!(similar([100, 100], [108, 100], 1.0), Some([[102, 104], [102, 96]]));
        // A cell twice as high as wide: as many units are half as many cells up.
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
