//! Lookups in the sky maps: `sky.wgsl`.

use glam::DVec3;

pub(crate) use crate::passes::sky::{Octahedral, split_sum};
use crate::passes::sky::{SPLIT_SUM_SIDE, ambient};

/// The shader's sky inputs.
#[derive(Clone, Debug)]
pub(crate) struct Sky<'a> {
    /// Unit vectors: up, across it towards where the sun stands, and to the sun.
    pub(crate) up: DVec3,
    /// See `up`.
    pub(crate) side: DVec3,
    /// See `up`.
    pub(crate) to_sun: DVec3,
    /// Radiance of the sun's disc.
    pub(crate) disc: DVec3,
    /// Angular radius of the disc, radians.
    pub(crate) disc_radius: f64,
    /// Radiance without the disc.
    pub(crate) seen: &'a Octahedral,
    /// Prefiltered reflections, smoothest first.
    pub(crate) layers: &'a [Octahedral],
    /// Spherical-harmonic coefficients of the irradiance.
    pub(crate) irradiance: [DVec3; 9],
    /// Extinction by haze, per world unit.
    pub(crate) haze: f64,
}

impl Sky<'_> {
    fn axes(&self, direction: DVec3) -> DVec3 {
        DVec3::new(direction.dot(self.side), direction.dot(self.up.cross(self.side)), direction.dot(self.up))
    }

    /// Radiance seen in a direction.
    pub(crate) fn sky(&self, direction: DVec3) -> DVec3 {
        let away = direction.distance(self.to_sun) / self.disc_radius;
        let t = ((away - 0.95) / 0.1).clamp(0.0, 1.0);
        let disc = if direction.dot(self.up) >= 0.0 { 1.0 - t * t * (3.0 - 2.0 * t) } else { 0.0 };
        self.seen.at(self.axes(direction)) + self.disc * disc
    }

    /// Irradiance over π.
    pub(crate) fn ambient(&self, normal: DVec3) -> DVec3 {
        ambient(&self.irradiance, self.axes(normal))
    }

    /// Mean radiance in a lobe.
    pub(crate) fn reflected(&self, direction: DVec3, roughness: f64) -> DVec3 {
        let last = self.layers.len() - 1;
        let layer = roughness.clamp(0.0, 1.0) * last as f64;
        let low = layer.floor() as usize;
        let axes = self.axes(direction);
        self.layers[low].at(axes).lerp(self.layers[(low + 1).min(last)].at(axes), layer - low as f64)
    }

    /// Radiance after a distance in haze.
    pub(crate) fn hazed(&self, radiance: DVec3, ray: DVec3, distance: f64) -> DVec3 {
        self.seen.at(self.axes(ray)).lerp(radiance, (-self.haze * distance).exp())
    }
}

/// Bilinear lookup in the split-sum table.
pub(crate) fn environment_brdf(table: &[[f64; 2]], cosine: f64, roughness: f64) -> [f64; 2] {
    let split = |share: f64| {
        let at = share.clamp(0.0, 1.0) * (SPLIT_SUM_SIDE - 1) as f64;
        let low = (at as usize).min(SPLIT_SUM_SIDE - 2);
        (low, at - low as f64)
    };
    let ((i, u), (j, v)) = (split(cosine.max(0.0).sqrt()), split(roughness));
    let first = j * SPLIT_SUM_SIDE + i;
    let mix = |a: f64, b: f64, t: f64| a + (b - a) * t;
    [0, 1].map(|k| {
        let [a, b, c, d] = [0, 1, SPLIT_SUM_SIDE, SPLIT_SUM_SIDE + 1].map(|offset| table[first + offset][k]);
        mix(mix(a, b, u), mix(c, d, u), v)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::passes::sky::environment_brdf_exact;

    #[test]
    fn the_table_of_the_split_sum_is_near_its_integral() {
        let table = split_sum();
        let (mut worst, mut fit_worst, mut squares, mut count) = ([0.0f64; 2], [0.0f64; 2], 0.0f64, 0.0);
        for i in 0..40 {
            for j in 0..40 {
                let (cosine, roughness) = ((f64::from(i) + 0.5) / 40.0, (f64::from(j) + 0.5) / 40.0);
                let [a, b] = environment_brdf_exact(cosine, roughness, 4000);
                let [c, d] = environment_brdf(&table, cosine, roughness);
                // The analytic fit that the table replaces (Karis, "Physically Based Shading on Mobile", 2014).
                let r = [(-1.0, 1.0), (-0.0275, 0.0425), (-0.572, 1.04), (0.022, -0.04)]
                    .map(|(a, b)| roughness * a + b);
                let fit = (r[0] * r[0]).min((-9.28 * cosine).exp2()) * r[0] + r[1];
                // The reflectance of a dielectric and of a metal.
                for (k, f0) in [0.04, 0.8].into_iter().enumerate() {
                    let difference = f0 * (c - a) + d - b;
                    worst[k] = worst[k].max(difference.abs());
                    let of_fit = f0 * (-1.04 * fit + r[2] - a) + 1.04 * fit + r[3] - b;
                    fit_worst[k] = fit_worst[k].max(of_fit.abs());
                    squares += difference * difference;
                    count += 1.0;
                }
            }
        }
        let rms = (squares / count).sqrt();
        println!(
            "split sum: worst of the table {worst:.4?}, of a fit {fit_worst:.4?}, RMS of the table {rms:.5}"
        );
        assert!(worst[0] < 0.02 && worst[1] < 0.03 && rms < 0.006, "{worst:?} {rms}");
    }
}
