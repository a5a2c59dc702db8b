//! Punctual lights: `lights.wgsl`.

use super::surface::{V3, dot, scale};

/// A punctual light, relative to the lit surface.
#[derive(Clone, Copy, Debug)]
pub struct PunctualLight {
    /// Position.
    pub position: V3,
    /// Range.
    pub range: f64,
    /// Intensity over π.
    pub colour: V3,
    /// Unit direction and the angles in radians of its cone's bright part and of all of it.
    pub spot: Option<(V3, f64, f64)>,
}

impl PunctualLight {
    /// Irradiance over π at zero on what faces the punctual light, and the unit direction to it (KHR_lights_punctual).
    #[must_use]
    pub fn at_zero(&self) -> (V3, V3) {
        let squared = dot(self.position, self.position).max(1e-6 * self.range * self.range);
        let window = (1.0 - (squared / (self.range * self.range)).powi(2)).clamp(0.0, 1.0);
        let to_punctual_light = scale(self.position, 1.0 / squared.sqrt());
        let cone = self.spot.map_or(1.0, |(direction, inner, outer)| {
            let cosine = -dot(direction, to_punctual_light);
            ((cosine - outer.cos()) / (inner.cos() - outer.cos()).max(1e-3)).clamp(0.0, 1.0).powi(2)
        });
        (scale(self.colour, window * cone / squared), to_punctual_light)
    }
}
