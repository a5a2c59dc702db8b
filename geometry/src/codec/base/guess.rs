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
use crate::numbers::truncated;

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
        let choices = || Choices { trust: self, guesses, choosing, given: [0; MOST_CHOICES], count: 0 };
        let wanted = actual.filter(|_| choosing).map(|actual| choices().cheapest(actual));
        let mut taken = Choice { guess: 0, value: 0, size: 0 };
        for (place, choice) in choices().enumerate() {
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

/// Guesses to choose of, the most trusted first; of those that say the same only that one.
pub(super) struct Choices<'a, const K: usize> {
    trust: &'a Trust<K>,
    /// Those that were not given yet.
    guesses: [Option<i32>; K],
    choosing: bool,
    given: [i32; MOST_CHOICES],
    count: usize,
}

impl<const K: usize> Choices<'_, K> {
    /// The choice that an encoder makes: the cheapest, about. A place down the list costs half a bit.
    pub(super) fn cheapest(self, actual: i32) -> usize {
        let costs = self.zip(0..).map(|(choice, place)| 2 * place + size_of(actual, choice.value));
        costs.enumerate().min_by_key(|&(_, cost)| cost).map_or(0, |(place, _)| place)
    }
}

impl<const K: usize> Iterator for Choices<'_, K> {
    type Item = Choice;

    fn next(&mut self) -> Option<Choice> {
        if self.count == MOST_CHOICES {
            return None;
        }
        loop {
            let there = self
                .guesses
                .iter()
                .zip(&self.trust.all)
                .enumerate()
                .filter(|(_, (guess, _))| guess.is_some());
            let (guess, _) = there.min_by_key(|(_, (_, size))| **size)?;
            let value = self.guesses[guess].take()?;
            if self.given[..self.count].contains(&value) {
                continue;
            }
            self.given[self.count] = value;
            self.count += 1;
            let sizes = if self.choosing { &self.trust.chosen } else { &self.trust.all };
            return Some(Choice { guess, value, size: sizes[guess].div_euclid(PARTS) });
        }
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
    truncated((x + 0.5).clamp(-MOST, MOST).floor())
}
