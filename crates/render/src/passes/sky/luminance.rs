//! Luminance of colours.

use glam::DVec3;

/// BT.709 luminance.
pub(super) fn luminance(colour: DVec3) -> f64 {
    colour.dot(DVec3::new(0.2126, 0.7152, 0.0722))
}
