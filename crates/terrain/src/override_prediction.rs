//! Foretells a listed height from those already known: several linear predictors, each weighted by how well
//! it did nearby (Seemann and Tischer, "Generalized locally adaptive DPCM", Data Compression Conference 1997).
//!
//! Valleys and ridges wind, so a row of heights is the row above, shifted; the predictors include such shifts,
//! and weights between two of them are a fraction of a point. Integers only, so both sides agree.

use lodestream_geometry::numbers::low32;

/// Predictors.
const COUNT: usize = 10;
/// Columns that are looked at on both sides.
const BESIDE: usize = 3;
/// Largest magnitude of an error that is kept.
const MOST: u32 = 1 << 20;

/// A known point of a row.
#[derive(Clone, Copy, Debug, Default)]
struct Known {
    listed: bool,
    value: i64,
    /// What was coded beyond the prediction, as a magnitude.
    residual: u32,
    /// Of each predictor, as a magnitude.
    errors: [u32; COUNT],
}

/// What is foretold.
#[derive(Clone, Copy, Debug)]
pub(super) struct Prediction {
    /// The height.
    pub(super) value: i32,
    /// How wrong it may be: 0 to 11, about the bits of half the residuals around, twice.
    pub(super) doubt: usize,
    guesses: [i64; COUNT],
}

/// The rows around the point in question.
#[derive(Clone, Debug)]
pub(super) struct Predictor {
    /// The row itself, the one above, and the one above that.
    rows: [Vec<Known>; 3],
    row: u32,
    /// What unlisted points count as; the last value if nothing better is known.
    unlisted: Option<i32>,
    last: i64,
}

impl Predictor {
    /// For rows of so many columns. `unlisted` is what points have that are not listed, if that is known.
    pub(super) fn new(columns: usize, unlisted: Option<i32>) -> Self {
        let rows = std::array::from_fn(|_| vec![Known::default(); columns + 2 * BESIDE]);
        Self { rows, row: 0, unlisted, last: i64::from(unlisted.unwrap_or(0)) }
    }

    /// Goes on to a row, never back.
    pub(super) fn advance(&mut self, row: u32) {
        for _ in 0..(row - self.row).min(3) {
            self.rows.rotate_right(1);
            self.rows[0].fill(Known::default());
        }
        self.row = row;
    }

    /// Foretells the value of a column.
    pub(super) fn predict(&self, column: usize) -> Prediction {
        let x = column + BESIDE;
        let [row, above, top] = &self.rows;
        let fallback = match self.unlisted {
            Some(value) => i64::from(value),
            None if row[x - 1].listed => row[x - 1].value,
            None if above[x].listed => above[x].value,
            None => self.last,
        };
        let of = |known: &Known| if known.listed { known.value } else { fallback };
        let (w, ww, www) = (of(&row[x - 1]), of(&row[x - 2]), of(&row[x - 3]));
        let [n3, n2, n1, n, e1, e2] = [x - 3, x - 2, x - 1, x, x + 1, x + 2].map(|i| of(&above[i]));
        let guesses = [
            w,
            n,
            // The row above, shifted: what it does from one column to the next.
            w + n2 - n3,
            w + n1 - n2,
            w + n - n1,
            w + e1 - n,
            w + e2 - e1,
            2 * w - ww,
            3 * (w - ww) + www,
            2 * n - of(&top[x]),
        ];
        let around = [&row[x - 1], &row[x - 2], &above[x - 1], &above[x], &above[x + 1]];
        let (mut sum, mut weights) = (0, 0);
        for (i, guess) in guesses.iter().enumerate() {
            let error: u64 = around.iter().map(|known| u64::from(known.errors[i])).sum();
            let weight = ((1 << 40) / (1 + error * error)).max(1).cast_signed();
            sum += i128::from(weight) * i128::from(*guess);
            weights += i128::from(weight);
        }
        let residuals = 2 * (u64::from(row[x - 1].residual) + u64::from(above[x].residual))
            + u64::from(above[x + 1].residual);
        // Bits of the square, so that there are two steps for each doubling.
        let doubt = 128 - (u128::from(residuals) * u128::from(residuals)).leading_zeros();
        let value = low32((2 * sum + weights).div_euclid(2 * weights));
        Prediction { value, doubt: (doubt as usize).min(11), guesses }
    }

    /// Learns the value of the column that was foretold.
    pub(super) fn learn(&mut self, column: usize, prediction: &Prediction, value: i32) {
        let value_of = i64::from(value);
        self.last = value_of;
        self.rows[0][column + BESIDE] = Known {
            listed: true,
            value: value_of,
            residual: value.wrapping_sub(prediction.value).unsigned_abs().min(MOST),
            errors: prediction.guesses.map(|guess| {
                u32::try_from((guess - value_of).unsigned_abs()).map_or(MOST, |error| error.min(MOST))
            }),
        };
    }
}
