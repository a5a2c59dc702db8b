//! Up to which distance each spacing is drawn.

use super::tile::TILE_CELLS;

/// Share of a range over which points slide onto the coarser surface.
const MORPH_SHARE: f64 = 0.15;

/// Distances in world units, from the errors of a terrain's levels and a view.
///
/// The distance of a point is taken in the plane, with the eye's height above the ground around it as the third
/// coordinate ([`clearance_distance`]): it then depends on nothing that a tile must be generated for.
#[derive(Clone, Debug, PartialEq)]
pub struct Ranges {
    /// Per spacing: where its points begin to slide, and where they have arrived. The last is infinite.
    steps: Vec<[f64; 2]>,
}

impl Ranges {
    /// `errors[s]` is the largest vertical error of drawing with spacing 2^s instead of 1, in world units; it grows with
    /// s. `scale_px` is the view's magnification at distance 1 at the corner of the picture, `target_px` the screen error
    /// allowed, `unit` the length of a grid unit in world units.
    ///
    /// Spacing s + 1 is enough from `errors[s + 1] · scale_px / target_px` on: from there on points of spacing s may
    /// slide. Two more things must hold, or tiles would not meet: a tile of spacing s that is begun within its range ends
    /// within that range and its diagonal, and by then no point of spacing s + 1 may have begun to slide.
    #[must_use]
    pub fn new(errors: &[f64], scale_px: f64, target_px: f64, unit: f64) -> Self {
        let mut steps = Vec::with_capacity(errors.len());
        let mut reached = 0.0_f64;
        for (spacing, _) in (0..).zip(errors) {
            let Some(next) = errors.get(spacing + 1) else {
                steps.push([f64::INFINITY; 2]);
                break;
            };
            let side = f64::from(TILE_CELLS) * unit * (1_u64 << spacing.min(62)) as f64;
            let enough = next * scale_px / target_px;
            let begin = enough.max(reached);
            let end = begin + (begin * MORPH_SHARE).max(0.5 * side);
            steps.push([begin, end]);
            reached = end + side * std::f64::consts::SQRT_2;
        }
        Self { steps }
    }

    /// Number of spacings.
    #[must_use]
    pub fn len(&self) -> usize {
        self.steps.len()
    }

    /// Whether there is no spacing at all.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.steps.is_empty()
    }

    /// Up to which distance tiles of this spacing are drawn; beyond the last spacing: infinity.
    #[must_use]
    pub fn end(&self, spacing: u8) -> f64 {
        self.steps.get(usize::from(spacing)).map_or(f64::INFINITY, |step| step[1])
    }

    /// From where points of this spacing slide onto the next coarser surface, and where they have arrived.
    #[must_use]
    pub fn morph(&self, spacing: u8) -> [f64; 2] {
        self.steps.get(usize::from(spacing)).copied().unwrap_or([f64::INFINITY; 2])
    }
}

/// Distance by which levels are chosen: of a point `across` world units from the eye in the plane, with the eye `above`
/// the highest ground around it (0 if it is not above).
#[must_use]
pub fn clearance_distance(across: f64, above: f64) -> f64 {
    across.hypot(above.max(0.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_spacing_is_used_only_from_where_it_is_enough() {
        let errors = [0.0, 0.1, 0.3, 0.8, 2.0, 4.0];
        let ranges = Ranges::new(&errors, 600.0, 2.0, 0.5);
        for s in 0..5_u8 {
            let enough = errors[usize::from(s) + 1] * 600.0 / 2.0;
            let [begin, end] = ranges.morph(s);
            assert!(begin >= enough && end > begin);
            assert_eq!(ranges.end(s), end);
        }
        assert!(ranges.end(5).is_infinite() && ranges.end(9).is_infinite());
    }

    #[test]
    fn a_coarser_tile_does_not_slide_where_a_finer_one_may_still_meet_it() {
        // Flat ground and a factor of 1 between levels are the extremes.
        for errors in [vec![0.0; 12], vec![1.0; 12], (0..12).map(|s| f64::from(1 << s)).collect()] {
            let ranges = Ranges::new(&errors, 600.0, 1.0, 1.0);
            for s in 0..10_u8 {
                let diagonal = f64::from(TILE_CELLS << s) * std::f64::consts::SQRT_2;
                assert!(ranges.morph(s + 1)[0] >= ranges.end(s) + diagonal);
            }
        }
    }
}
