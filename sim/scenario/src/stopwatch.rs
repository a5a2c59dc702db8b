//! Timing of repeated work, and its statistics.

use std::time::Instant;

use serde::Serialize;

/// Runs some work; returns its result and the seconds that it took.
pub fn timed<T>(work: impl FnOnce() -> T) -> (T, f64) {
    let start = Instant::now();
    let result = work();
    (result, start.elapsed().as_secs_f64())
}

/// The median; the upper of the two middle values for an even count.
///
/// # Panics
/// If the list is empty.
#[must_use]
pub fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

/// The median of the ratios between values and their partners: for work done in turn, load on the machine affects both.
///
/// # Panics
/// If the list is empty.
#[must_use]
pub fn paired_ratio(values: &[f64], partners: &[f64]) -> f64 {
    median(values.iter().zip(partners).map(|(value, partner)| value / partner).collect())
}

/// Rounds to `places` decimals.
#[must_use]
pub fn rounded(value: f64, places: i32) -> f64 {
    let unit = 10_f64.powi(places);
    (value * unit).round() / unit
}

/// Least, mean and greatest of some times, in milliseconds, to a tenth of a microsecond.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Spread {
    /// Least.
    pub min_ms: f64,
    /// Mean.
    pub mean_ms: f64,
    /// Greatest.
    pub max_ms: f64,
}

impl Spread {
    /// From at least one time in seconds.
    #[must_use]
    pub fn of(seconds: &[f64]) -> Self {
        let mean = seconds.iter().sum::<f64>() / seconds.len() as f64;
        let least = seconds.iter().copied().fold(f64::INFINITY, f64::min);
        let most = seconds.iter().copied().fold(0.0, f64::max);
        let [min_ms, mean_ms, max_ms] = [least, mean, most].map(|seconds| rounded(seconds * 1e3, 4));
        Self { min_ms, mean_ms, max_ms }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn least_mean_greatest_and_median() {
        let seconds = [0.004, 0.001, 0.0025];
        assert_eq!(Spread::of(&seconds), Spread { min_ms: 1.0, mean_ms: 2.5, max_ms: 4.0 });
        assert_eq!(median(seconds.to_vec()), 0.0025);
        assert_eq!(median(vec![1.0, 2.0]), 2.0);
        assert_eq!(paired_ratio(&[2.0, 9.0, 8.0], &[1.0, 1.0, 2.0]), 4.0);
        assert_eq!((rounded(1.23456, 2), rounded(-0.5, 3)), (1.23, -0.5));
    }
}
