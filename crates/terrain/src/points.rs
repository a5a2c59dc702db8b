//! The height overrides of one patch.

use super::error::TerrainError;
use super::mode::Mode;

/// Most height overrides per patch: as many as a patch of level 10 has points.
pub const MAX_PATCH_POINTS: usize = 1025 * 1025;

/// A height override of one point of a patch.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct HeightOverride {
    /// Column in the patch, 0 to 2^n.
    pub x: u16,
    /// Row in the patch, 0 to 2^n.
    pub y: u16,
    /// Whether the height is set or added to.
    pub mode: Mode,
    /// The height, or the change.
    pub height: i32,
}

/// The height overrides of one patch, borders included, sorted by row and then column, without duplicates.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct HeightOverrides {
    points: Vec<HeightOverride>,
}

impl HeightOverrides {
    /// Overrides of a patch of `finest_level`, in any order.
    ///
    /// # Errors
    /// If a point is outside the patch or occurs twice, or there are more than [`MAX_PATCH_POINTS`].
    pub fn new(finest_level: u8, mut points: Vec<HeightOverride>) -> Result<Self, TerrainError> {
        if points.len() > MAX_PATCH_POINTS {
            let (count, limit) = (points.len(), MAX_PATCH_POINTS);
            return Err(TerrainError::TooMany { what: "points of one patch", count, limit });
        }
        let side = 1_u16 << finest_level.min(15);
        if let Some(p) = points.iter().find(|p| p.x > side || p.y > side) {
            return Err(TerrainError::BadPoint { x: p.x, y: p.y, why: "is outside the patch" });
        }
        points.sort_unstable_by_key(|p| (p.y, p.x));
        if let Some(pair) = points.windows(2).find(|pair| (pair[0].x, pair[0].y) == (pair[1].x, pair[1].y)) {
            return Err(TerrainError::BadPoint { x: pair[0].x, y: pair[0].y, why: "is given twice" });
        }
        Ok(Self { points })
    }

    /// The overrides, by row and then column.
    #[must_use]
    pub fn as_slice(&self) -> &[HeightOverride] {
        &self.points
    }

    /// Number of overrides.
    #[must_use]
    pub fn len(&self) -> usize {
        self.points.len()
    }

    /// Whether there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.points.is_empty()
    }
}
