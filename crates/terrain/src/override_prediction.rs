//! Prediction of an overridden height from known ones by several linear predictors, weighted by their recent accuracy
//! nearby (Seemann and Tischer, "Generalized locally adaptive DPCM", Data Compression Conference 1997).
//!
//! Valleys and ridges wind, so a row often equals the row above, shifted; the predictors include such shifts, and
//! weights between two of them give fractional shifts. Integers only, so encoder and decoder agree.

use lodestream_geometry::numbers::low32;

/// Number of predictors.
const COUNT: usize = 10;
/// Columns considered on either side.
const BESIDE: usize = 3;
/// Clamp for stored errors.
const MAX_ERROR: u32 = 1 << 20;

/// A known point of a row.
#[derive(Clone, Copy, Debug, Default)]
struct Known {
    is_override: bool,
    value: i64,
    /// Magnitude of the coded residual.
    residual: u32,
    /// Magnitude of each predictor's error.
    errors: [u32; COUNT],
}

/// A prediction.
#[derive(Clone, Copy, Debug)]
pub(super) struct Prediction {
    /// The height.
    pub(super) value: i32,
    /// Uncertainty class, 0 to 11: about twice the bits of half the residuals around.
    pub(super) uncertainty: usize,
    values: [i64; COUNT],
}

/// The rows around the current point.
#[derive(Clone, Debug)]
pub(super) struct Predictor {
    /// The current row, the one above, and the one above that.
    rows: [Vec<Known>; 3],
    row: u32,
    /// Value of points without override; `None` uses the last value.
    default_height: Option<i32>,
    last: i64,
}

impl Predictor {
    /// A predictor for rows of `columns` columns. `default_height` is the value of points without override, if known.
    pub(super) fn new(columns: usize, default_height: Option<i32>) -> Self {
        let rows = std::array::from_fn(|_| vec![Known::default(); columns + 2 * BESIDE]);
        Self { rows, row: 0, default_height, last: i64::from(default_height.unwrap_or(0)) }
    }

    /// Advances to a later row.
    pub(super) fn advance(&mut self, row: u32) {
        for _ in 0..(row - self.row).min(3) {
            self.rows.rotate_right(1);
            self.rows[0].fill(Known::default());
        }
        self.row = row;
    }

    /// Predicts the value in a column.
    pub(super) fn predict(&self, column: usize) -> Prediction {
        let x = column + BESIDE;
        let [row, above, top] = &self.rows;
        let fallback = match self.default_height {
            Some(value) => i64::from(value),
            None if row[x - 1].is_override => row[x - 1].value,
            None if above[x].is_override => above[x].value,
            None => self.last,
        };
        let of = |known: &Known| if known.is_override { known.value } else { fallback };
        let (w, ww, www) = (of(&row[x - 1]), of(&row[x - 2]), of(&row[x - 3]));
        let [n3, n2, n1, n, e1, e2] = [x - 3, x - 2, x - 1, x, x + 1, x + 2].map(|i| of(&above[i]));
        let values = [
            w,
            n,
            // The row above, shifted: its change from one column to the next.
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
        for (i, guess) in values.iter().enumerate() {
            let error: u64 = around.iter().map(|known| u64::from(known.errors[i])).sum();
            let weight = ((1 << 40) / (1 + error * error)).max(1).cast_signed();
            sum += i128::from(weight) * i128::from(*guess);
            weights += i128::from(weight);
        }
        let residuals = 2 * (u64::from(row[x - 1].residual) + u64::from(above[x].residual))
            + u64::from(above[x + 1].residual);
        // Bits of the square, to get two classes per octave.
        let uncertainty = 128 - (u128::from(residuals) * u128::from(residuals)).leading_zeros();
        let value = low32((2 * sum + weights).div_euclid(2 * weights));
        Prediction { value, uncertainty: (uncertainty as usize).min(11), values }
    }

    /// Updates with the actual value in a predicted column.
    pub(super) fn update(&mut self, column: usize, prediction: &Prediction, value: i32) {
        let value_of = i64::from(value);
        self.last = value_of;
        self.rows[0][column + BESIDE] = Known {
            is_override: true,
            value: value_of,
            residual: value.wrapping_sub(prediction.value).unsigned_abs().min(MAX_ERROR),
            errors: prediction.values.map(|guess| {
                u32::try_from((guess - value_of).unsigned_abs())
                    .map_or(MAX_ERROR, |error| error.min(MAX_ERROR))
            }),
        };
    }
}
