//! A factor on the ground's heights that goes to a target over a time.

use thiserror::Error;

/// Most that heights are multiplied by.
pub const MAX_VERTICAL_EXAGGERATION: f64 = 100.0;
/// What 0 is drawn as: cover follows heights, and flat ground would have one cover. A mountain is a centimetre high then.
pub(crate) const LEAST_HEIGHT_FACTOR: f64 = 1e-6;

/// Why heights cannot go there.
#[derive(Clone, Copy, Debug, Error, PartialEq)]
pub enum VerticalExaggerationError {
    /// The factor.
    #[error("heights of the ground can be multiplied by 0 to {MAX_VERTICAL_EXAGGERATION}, not by {0}")]
    Factor(f64),
    /// The time.
    #[error("heights of the ground can move for 0 seconds or longer, not for {0}")]
    Duration(f64),
}

/// A factor on heights, as a function of time: it leaves and arrives at rest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VerticalExaggeration {
    from: f64,
    to: f64,
    begun_s: f64,
    lasts_s: f64,
}

impl Default for VerticalExaggeration {
    /// Heights as the scene has them.
    fn default() -> Self {
        Self { from: 1.0, to: 1.0, begun_s: 0.0, lasts_s: 0.0 }
    }
}

impl VerticalExaggeration {
    /// From where it is at `now_s` to a target within so many seconds; at once where these are 0.
    ///
    /// # Errors
    /// A target that is not within 0 to [`MAX_VERTICAL_EXAGGERATION`], or a time that is not finite or below 0.
    pub fn towards(&self, to: f64, lasts_s: f64, now_s: f64) -> Result<Self, VerticalExaggerationError> {
        if !(0.0..=MAX_VERTICAL_EXAGGERATION).contains(&to) {
            return Err(VerticalExaggerationError::Factor(to));
        }
        if !(0.0..f64::INFINITY).contains(&lasts_s) {
            return Err(VerticalExaggerationError::Duration(lasts_s));
        }
        Ok(Self { from: self.at(now_s), to, begun_s: now_s, lasts_s })
    }

    /// The factor at a time; the target itself from the end on.
    #[must_use]
    pub fn at(&self, now_s: f64) -> f64 {
        let way = (now_s - self.begun_s) / self.lasts_s;
        if self.lasts_s == 0.0 || way.is_nan() || way >= 1.0 || self.from == self.to {
            return self.to;
        }
        let way = way.max(0.0);
        self.from + (self.to - self.from) * (way * way * (3.0 - 2.0 * way))
    }

    /// Whether it is on its way.
    #[must_use]
    pub fn is_moving(&self, now_s: f64) -> bool {
        self.from != self.to && now_s - self.begun_s < self.lasts_s
    }

    /// Where it goes.
    #[must_use]
    pub fn target(&self) -> f64 {
        self.to
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_is_half_way_after_half_the_time_and_there_at_the_end() {
        let risen = VerticalExaggeration::default().towards(4.0, 2.0, 10.0).unwrap();
        assert_eq!([9.0, 10.0, 11.0, 12.0, 1e9].map(|now| risen.at(now)), [1.0, 1.0, 2.5, 4.0, 4.0]);
        assert_eq!([10.0, 11.9, 12.0].map(|now| risen.is_moving(now)), [true, true, false]);
        let way: Vec<f64> = (0..=20).map(|i| risen.at(10.0 + 0.1 * f64::from(i))).collect();
        assert!(way.is_sorted() && way[1] - way[0] < 0.25 * (way[11] - way[10]), "{way:?}");
        // Another target on the way: it goes on from where it is.
        let back = risen.towards(0.0, 1.0, 11.0).unwrap();
        assert_eq!([11.0, 11.5, 12.0].map(|now| back.at(now)), [2.5, 1.25, 0.0]);
    }

    #[test]
    fn without_a_time_it_is_there_at_once() {
        let now = VerticalExaggeration::default().towards(3.0, 0.0, 5.0).unwrap();
        assert_eq!([0.0, 5.0, 6.0].map(|at| now.at(at)), [3.0; 3]);
        assert!(!now.is_moving(5.0) && !VerticalExaggeration::default().is_moving(0.0));
        assert_eq!(VerticalExaggeration::default().at(f64::NAN), 1.0);
    }

    #[test]
    fn what_is_no_factor_or_no_time_is_refused_by_name() {
        let one = VerticalExaggeration::default();
        for wrong in [f64::NAN, -0.5, 100.5, f64::INFINITY] {
            let said = one.towards(wrong, 1.0, 0.0).unwrap_err().to_string();
            assert!(said.contains("multiplied by 0 to 100, not by"), "{said}");
        }
        for wrong in [f64::NAN, -1.0, f64::INFINITY] {
            let said = one.towards(2.0, wrong, 0.0).unwrap_err().to_string();
            assert!(said.contains("for 0 seconds or longer, not for"), "{said}");
        }
        assert!(one.towards(0.0, 0.0, 0.0).is_ok() && one.towards(100.0, 1e9, 0.0).is_ok());
    }
}
