//! Screen error: the one formula by which server, viewer and simulator judge a chunk.
//!
//! `magnification = scale / depth` pixels per world unit, where `scale = height_px / (2 tan(fov_y / 2))`
//! and `depth` is the distance along the view axis; `screen error = geometric error × magnification`
//! (DESIGN of the project: ARCHITECTURE.md, "Errors").

/// Smallest depth, as a fraction of the error's own length, at which the formula is evaluated:
/// nearer than this the answer is "huge" either way, and division by zero is excluded.
const MIN_DEPTH_PER_ERROR: f64 = 1e-6;

/// Pixels per radian-like unit: `height_px / (2 tan(fov_y / 2))`.
///
/// `fov_y` is the vertical field of view in radians, in (0, π).
#[must_use]
pub fn scale_px(height_px: f64, fov_y: f64) -> f64 {
    height_px / (2.0 * (fov_y * 0.5).tan())
}

/// Screen error in pixels of a geometric error (world units) whose nearest point has the view depth
/// `depth` (world units). Depths at or behind the eye are clamped, so the answer is finite and large.
#[must_use]
pub fn screen_error_px(error: f64, depth: f64, scale_px: f64) -> f64 {
    if error <= 0.0 {
        return 0.0;
    }
    error * scale_px / depth.max(error * MIN_DEPTH_PER_ERROR)
}
