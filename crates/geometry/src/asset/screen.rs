//! Screen error: the one formula that server, viewer and simulator use.
//!
//! `magnification = scale / depth` pixels per world unit, where `scale = height_px / (2 tan(fov_y / 2))`
//! and `depth` is the distance along the view axis; `screen error = visible error × magnification`, where
//! the visible error is the larger of the geometric error and the weighted attribute error
//! (docs/design/errors.md).

use crate::asset::index::{ChunkInfo, TruncationPoint};

/// Weight of an attribute error against a geometric error of the same length. One half: sliding texture moves no
/// silhouette, and shading is measured on patches as large as an input face.
pub const ATTRIBUTE_WEIGHT: f32 = 0.5;

/// Smallest depth, as a fraction of the error, at which the formula is evaluated: any closer the result is huge
/// anyway, and division by zero is excluded.
const MIN_DEPTH_PER_ERROR: f64 = 1e-6;

/// Pixels per unit of tangent: `height_px / (2 tan(fov_y / 2))`.
///
/// `fov_y` is the vertical field of view in radians, in (0, π).
#[must_use]
pub fn scale_px(height_px: f64, fov_y: f64) -> f64 {
    height_px / (2.0 * (fov_y * 0.5).tan())
}

/// Visible error while a chunk is missing, in the asset's units: the argument of [`screen_error_px`].
/// `attribute_share` (0 to 1) scales [`ATTRIBUTE_WEIGHT`]; 0 counts geometry only.
#[must_use]
pub fn visible_error(info: &ChunkInfo, attribute_share: f32) -> f32 {
    info.error.max(ATTRIBUTE_WEIGHT * attribute_share * info.attribute_error)
}

/// Visible error while a chunk is applied up to a truncation point. Attribute errors are known for whole chunks only,
/// so they count in full.
#[must_use]
pub fn visible_error_at(info: &ChunkInfo, truncation: &TruncationPoint, attribute_share: f32) -> f32 {
    truncation.error.max(ATTRIBUTE_WEIGHT * attribute_share * info.attribute_error)
}

/// Screen error in pixels of a visible error (world units) at view depth `depth` (world units). Depths at or behind
/// the eye are clamped, so the result is finite.
#[must_use]
pub fn screen_error_px(error: f64, depth: f64, scale_px: f64) -> f64 {
    if error <= 0.0 {
        return 0.0;
    }
    error * scale_px / depth.max(error * MIN_DEPTH_PER_ERROR)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn attributes_count_by_their_weight_and_share() {
        let info = ChunkInfo { error: 1.0, attribute_error: 6.0, ..ChunkInfo::default() };
        assert_eq!(visible_error(&info, 0.0), 1.0);
        assert_eq!(visible_error(&info, 1.0), 6.0 * ATTRIBUTE_WEIGHT);
        assert_eq!(visible_error(&ChunkInfo { attribute_error: 0.0, ..info }, 1.0), 1.0);
    }
}
