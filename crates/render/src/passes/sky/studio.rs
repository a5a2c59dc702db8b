//! Light and background of a studio, in axes with z up and x towards the key light's azimuth, for a key light of
//! luminance 1. Both are symmetric in y, as the maps are.

use glam::DVec3;

use super::luminance::luminance;
use crate::scene::environment::Studio;

/// Radiance of a white diffuse surface that faces the key light, from all lights.
#[cfg(any(test, feature = "client"))]
const WHITE: f64 = 1.675;

/// A soft box: direction of its middle, cosines at which it begins to fade and has faded, radiance.
struct SoftBox([f64; 3], [f64; 2], f64);

/// Overhead, which lights tops and rims; on the key light's side; at both sides of it, for edges of metal; behind.
const BOXES: [SoftBox; 4] = [
    SoftBox([0.15, 0.0, 0.988_7], [0.94, 0.74], 1.0),
    SoftBox([0.80, 0.0, 0.60], [0.97, 0.86], 1.3),
    SoftBox([0.1, 0.975, 0.2], [0.98, 0.91], 1.0),
    SoftBox([-0.92, 0.0, 0.392], [0.97, 0.88], 1.0),
];

/// Factor on the studio's lights: luminance of its key light, or 1 without one.
pub(super) fn scale(studio: &Studio) -> f64 {
    let key = luminance(studio.key.as_dvec3());
    if key > 0.0 { key } else { 1.0 }
}

/// Radiance of a white diffuse surface that faces the key light.
#[cfg(any(test, feature = "client"))]
pub(crate) fn white(studio: &Studio) -> f32 {
    (WHITE * scale(studio)) as f32
}

/// Radiance that objects reflect: walls, brighter above, ground, and soft boxes.
pub(super) fn light(direction: DVec3) -> f64 {
    let walls = 0.08 + 0.14 * smooth(-0.3, 1.0, direction.z);
    let ground = 0.14 * smooth(0.0, -0.5, direction.z);
    let boxes = BOXES.iter().map(|SoftBox(middle, [begins, ends], radiance)| {
        let mirrored = direction.with_y(direction.y.abs());
        radiance * smooth(*ends, *begins, mirrored.dot(DVec3::from(*middle)))
    });
    walls + ground + boxes.sum::<f64>()
}

/// Radiance of the background: darker upwards, without a horizon.
/// Takes the direction's part along the axis up.
pub(crate) fn background(up: f64) -> f64 {
    let (low, high) = (0.56, 0.20);
    low + (high - low) * smooth(-0.9, 0.9, up)
}

/// Hermite's step between two values.
fn smooth(from: f64, to: f64, x: f64) -> f64 {
    let t = ((x - from) / (to - from)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}
