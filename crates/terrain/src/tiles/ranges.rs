//! The distance up to which each spacing is drawn.

use super::tile::TILE_CELLS;

/// Share of a range over which points morph onto the coarser surface.
const MORPH_SHARE: f64 = 0.15;

/// Draw distances per spacing, in world units, computed from a terrain's level errors and a view.
///
/// A point's distance combines its distance in the plane with the eye's height over the ground around
/// ([`clearance_distance`]), so that it is known before any tile is generated.
#[derive(Clone, Debug, PartialEq)]
pub struct LodRanges {
    /// Per spacing: distances at which its morph begins and ends. The last is infinite.
    steps: Vec<[f64; 2]>,
}

impl LodRanges {
    /// `errors[s]` is the largest vertical error of drawing with spacing 2^s instead of 1, in world units, ascending.
    /// `scale_px` is the view's magnification at distance 1 in a corner of the picture, `target_px` the allowed screen
    /// error, `unit` the length of a grid unit in world units.
    ///
    /// Spacing s + 1 suffices from `errors[s + 1] · scale_px / target_px` on, so points of spacing s may morph from
    /// there. For tiles to meet, the morph of spacing s + 1 must begin beyond the end of spacing s plus a tile's
    /// diagonal: a tile of spacing s that begins within its range extends that far.
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

    /// Whether there is no spacing.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.steps.is_empty()
    }

    /// Distance up to which tiles of this spacing are drawn; infinite for the last spacing and beyond.
    #[must_use]
    pub fn end(&self, spacing: u8) -> f64 {
        self.steps.get(usize::from(spacing)).map_or(f64::INFINITY, |step| step[1])
    }

    /// Distances at which points of this spacing begin and end to morph onto the next coarser surface.
    #[must_use]
    pub fn morph(&self, spacing: u8) -> [f64; 2] {
        self.steps.get(usize::from(spacing)).copied().unwrap_or([f64::INFINITY; 2])
    }
}

/// Distance for level selection: of a point `across` from the eye in the plane, with the eye `above` the highest ground
/// around it. Both in one unit; a negative height counts as 0.
#[must_use]
pub fn clearance_distance(across: f64, above: f64) -> f64 {
    across.hypot(above.max(0.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_spacing_is_used_only_from_where_its_error_is_allowed() {
        let errors = [0.0, 0.1, 0.3, 0.8, 2.0, 4.0];
        let ranges = LodRanges::new(&errors, 600.0, 2.0, 0.5);
        for s in 0..5_u8 {
            let enough = errors[usize::from(s) + 1] * 600.0 / 2.0;
            let [begin, end] = ranges.morph(s);
            assert!(begin >= enough && end > begin);
            assert_eq!(ranges.end(s), end);
        }
        assert!(ranges.end(5).is_infinite() && ranges.end(9).is_infinite());
    }

    #[test]
    fn a_coarser_tile_does_not_morph_where_a_finer_one_may_meet_it() {
        // Flat ground and a factor of 1 between levels are the extremes.
        for errors in [vec![0.0; 12], vec![1.0; 12], (0..12).map(|s| f64::from(1 << s)).collect()] {
            let ranges = LodRanges::new(&errors, 600.0, 1.0, 1.0);
            for s in 0..10_u8 {
                let diagonal = f64::from(TILE_CELLS << s) * std::f64::consts::SQRT_2;
                assert!(ranges.morph(s + 1)[0] >= ranges.end(s) + diagonal);
            }
        }
    }
}
