//! Vertical exaggeration: a factor on terrain heights that is animated towards a target.

use thiserror::Error;

/// Largest factor.
pub const MAX_VERTICAL_EXAGGERATION: f64 = 100.0;
/// The factor used for 0: ground cover depends on heights, so entirely flat terrain would lose it. At this factor a
/// mountain is a centimetre high.
pub(crate) const LEAST_HEIGHT_FACTOR: f64 = 1e-6;

/// Invalid target or duration.
#[derive(Clone, Copy, Debug, Error, PartialEq)]
pub enum VerticalExaggerationError {
    /// Factor out of range.
    #[error("the vertical exaggeration must be 0 to {MAX_VERTICAL_EXAGGERATION}, not {0}")]
    Factor(f64),
    /// Invalid duration.
    #[error("the duration of a change of vertical exaggeration must be 0 seconds or longer, not {0}")]
    Duration(f64),
}

/// The factor as a smooth function of time, with zero speed at both ends.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VerticalExaggeration {
    from: f64,
    to: f64,
    begun_s: f64,
    lasts_s: f64,
}

impl Default for VerticalExaggeration {
    /// The scene's own heights.
    fn default() -> Self {
        Self { from: 1.0, to: 1.0, begun_s: 0.0, lasts_s: 0.0 }
    }
}

impl VerticalExaggeration {
    /// Starts an animation from the factor at `now_s` to a target within `lasts_s` seconds; 0 jumps.
    ///
    /// # Errors
    /// A target outside 0 to [`MAX_VERTICAL_EXAGGERATION`], or a duration that is negative or not finite.
    pub fn towards(&self, to: f64, lasts_s: f64, now_s: f64) -> Result<Self, VerticalExaggerationError> {
        if !(0.0..=MAX_VERTICAL_EXAGGERATION).contains(&to) {
            return Err(VerticalExaggerationError::Factor(to));
        }
        if !(0.0..f64::INFINITY).contains(&lasts_s) {
            return Err(VerticalExaggerationError::Duration(lasts_s));
        }
        Ok(Self { from: self.at(now_s), to, begun_s: now_s, lasts_s })
    }

    /// The factor at a time; exactly the target after the end.
    #[must_use]
    pub fn at(&self, now_s: f64) -> f64 {
        let progress = (now_s - self.begun_s) / self.lasts_s;
        if self.lasts_s == 0.0 || progress.is_nan() || progress >= 1.0 || self.from == self.to {
            return self.to;
        }
        let progress = progress.max(0.0);
        self.from + (self.to - self.from) * (progress * progress * (3.0 - 2.0 * progress))
    }

    /// Whether the animation runs.
    #[must_use]
    pub fn is_moving(&self, now_s: f64) -> bool {
        self.from != self.to && now_s - self.begun_s < self.lasts_s
    }

    /// The target.
    #[must_use]
    pub fn target(&self) -> f64 {
        self.to
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_factor_is_half_way_at_half_time_and_exact_at_the_end() {
        let risen = VerticalExaggeration::default().towards(4.0, 2.0, 10.0).unwrap();
        assert_eq!([9.0, 10.0, 11.0, 12.0, 1e9].map(|now| risen.at(now)), [1.0, 1.0, 2.5, 4.0, 4.0]);
        assert_eq!([10.0, 11.9, 12.0].map(|now| risen.is_moving(now)), [true, true, false]);
        let progress: Vec<f64> = (0..=20).map(|i| risen.at(10.0 + 0.1 * f64::from(i))).collect();
        assert!(
            progress.is_sorted() && progress[1] - progress[0] < 0.25 * (progress[11] - progress[10]),
            "{progress:?}"
        );
        // A new target during the animation continues from the current factor.
        let back = risen.towards(0.0, 1.0, 11.0).unwrap();
        assert_eq!([11.0, 11.5, 12.0].map(|now| back.at(now)), [2.5, 1.25, 0.0]);
    }

    #[test]
    fn zero_duration_jumps_to_the_target() {
        let now = VerticalExaggeration::default().towards(3.0, 0.0, 5.0).unwrap();
        assert_eq!([0.0, 5.0, 6.0].map(|at| now.at(at)), [3.0; 3]);
        assert!(!now.is_moving(5.0) && !VerticalExaggeration::default().is_moving(0.0));
        assert_eq!(VerticalExaggeration::default().at(f64::NAN), 1.0);
    }

    #[test]
    fn invalid_factors_and_durations_are_errors() {
        let one = VerticalExaggeration::default();
        for wrong in [f64::NAN, -0.5, 100.5, f64::INFINITY] {
            let message = one.towards(wrong, 1.0, 0.0).unwrap_err().to_string();
            assert!(message.contains("must be 0 to 100, not"), "{message}");
        }
        for wrong in [f64::NAN, -1.0, f64::INFINITY] {
            let message = one.towards(2.0, wrong, 0.0).unwrap_err().to_string();
            assert!(message.contains("must be 0 seconds or longer, not"), "{message}");
        }
        assert!(one.towards(0.0, 0.0, 0.0).is_ok() && one.towards(100.0, 1e9, 0.0).is_ok());
    }
}
