//! Water: `water.wgsl`.

use glam::{DVec2, DVec3};

use super::brdf::{Reflector, Specular};
use super::sky::{Sky, environment_brdf};
use crate::passes::water::WaterView;

/// As in the shader: reflectance of water looking straight at it.
pub(crate) const WATER: f64 = 0.0204;
/// As in the shader: least microfacet roughness, squared.
const CALM: f64 = 4e-4;

/// A pixel's ray in the world and its differentials to the pixels right and above; the central ray has length 1.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Ray {
    /// Through the pixel.
    pub(crate) through: DVec3,
    /// To the pixel to the right.
    pub(crate) right: DVec3,
    /// To the pixel above.
    pub(crate) up: DVec3,
}

impl WaterView {
    /// Radiance of a pixel with water over `behind`, the radiance of the surface at view depth `depth` (infinite for
    /// none). `sun` is the sun's irradiance over π after shadows, `split_sum` the table of [`super::sky::split_sum`].
    pub(crate) fn radiance(
        &self,
        ray: Ray,
        (behind, depth): (DVec3, f64),
        sky: &Sky<'_>,
        sun: DVec3,
        split_sum: &[[f64; 2]],
    ) -> DVec3 {
        let length = ray.through.length();
        let to_eye = -ray.through / length;
        let along = self.height / -ray.through.y;
        let position = ray.through * along;
        let flat = |v: DVec3| DVec2::new(v.x, v.z);
        let footprint =
            [ray.right, ray.up].map(|step| flat(step - ray.through * (step.y / ray.through.y)) * along);
        let (mut slope, mut lost) = (DVec2::ZERO, CALM);
        for wave in &self.waves {
            let spread: f64 = footprint.iter().map(|step| wave.vector.dot(*step).powi(2)).sum();
            let kept = (-0.5 * std::f64::consts::PI.powi(2) * spread).exp();
            let angle = std::f64::consts::TAU * (wave.vector.dot(flat(position)) + wave.phase);
            slope += wave.vector.normalize() * (wave.steepness * kept * angle.cos());
            lost += 0.5 * wave.steepness.powi(2) * (1.0 - kept * kept);
        }
        let normal = DVec3::new(-slope.x, 1.0, -slope.y).normalize();
        let roughness = lost.powf(0.25);
        let [factor, added] = environment_brdf(split_sum, normal.dot(to_eye).clamp(1e-3, 1.0), roughness);
        let mirrored = WATER * factor + added;
        let way = (depth - along).max(0.0) * length * (1.0 + to_eye.y);
        let left = (-self.extinction * way).exp() * (1.0 - mirrored);
        let away = 2.0 * normal.dot(to_eye) * normal - to_eye;
        let away = DVec3::new(away.x, away.y.abs(), away.z);
        let mirror = Reflector {
            albedo: [WATER; 3],
            metal: 1.0,
            roughness,
            normal: normal.to_array(),
            to_eye: to_eye.to_array(),
            specular: Specular::USUAL,
        };
        let glint =
            DVec3::from(mirror.brdf_pi(sky.to_sun.to_array())) * sun * normal.dot(sky.to_sun).max(0.0);
        let light = sky.ambient(DVec3::Y) + sun * sky.to_sun.y.max(0.0);
        let sent_back = self.scattered * light * (DVec3::splat(1.0 - mirrored) - left);
        let seen = glint + mirrored * sky.reflected(away, roughness) + sent_back;
        let clear = (-sky.haze * position.length()).exp();
        let haze = (DVec3::ONE - left) * (1.0 - clear) * sky.sky(-to_eye);
        behind * left + seen * clear + haze
    }
}
