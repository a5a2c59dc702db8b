//! Maps of a sky: radiance, irradiance and prefiltered reflections.

use std::f64::consts::{FRAC_PI_2, PI};

use glam::{DVec3, Vec3};

use super::atmosphere::{AtmosphereTables, GROUND_KM, SUN_RADIUS, Scattered};
use super::luminance::luminance;
use super::octahedral::Octahedral;
use super::prefilter::{ambient, in_lobe, in_wide_lobe, irradiance, lobe};
use super::studio;
use super::table::Table;
use crate::scene::environment::{Atmosphere, GradientSky, Studio};

/// Texels along a side of the radiance map: a degree each.
pub(crate) const SEEN_SIDE: usize = 128;
/// Texels along a side of the reflection maps.
pub(crate) const LOBE_SIDE: usize = 64;
/// Reflection maps: roughness 0, 0.2, … 1.
pub(crate) const LOBES: usize = 6;
/// Samples of a lobe.
const LOBE_SAMPLES: u32 = 48;

/// Height of the eye over the ground in km: on a hill, above the thickest haze.
const EYE_KM: f64 = 0.2;
/// Grid of ray-marched points: azimuths from the sun and heights over the horizon.
const AZIMUTHS: usize = 13;
const HEIGHTS: usize = 32;
/// Optical depth between the eye and the ground below it, through which ground near the horizon is seen.
const GROUND_DEPTH: f64 = 0.02;
/// Largest brightening of the sky of a low sun, relative to a sun without an atmosphere.
const MOST_GAIN: f64 = 16.0;
/// Largest radiance of the lighting target.
const MOST_RADIANCE: f64 = 6e4;

/// Maps of a sky, in axes with z up and x towards the sun's azimuth.
#[derive(Clone, Debug)]
pub(crate) struct SkyMap {
    /// Irradiance of the sun over π on a surface that faces it.
    pub(crate) sun: DVec3,
    /// Radiance of its disc; 0 for a gradient sky.
    pub(crate) disc: DVec3,
    pub(crate) seen: Octahedral,
    /// Prefiltered reflections, smoothest first.
    pub(crate) lobes: Vec<Octahedral>,
    pub(crate) irradiance: [DVec3; 9],
}

impl SkyMap {
    /// Maps of an atmosphere; `sun_height` is the sine of the sun's elevation. With haze, only haze is seen below the
    /// horizon.
    pub(crate) fn of_air(
        air: &Atmosphere,
        atmosphere: &AtmosphereTables,
        sun_height: f64,
        haze: bool,
    ) -> Self {
        let dome = Dome::new(atmosphere, sun_height);
        let sun = atmosphere.sunlight(GROUND_KM + EYE_KM, sun_height);
        let above = |direction: DVec3| dome.radiance(direction);
        // Irradiance of the ground, from coarse texels.
        let falls = Octahedral::mirrored(16, |d| if d.z > 0.0 { above(d) * d.z } else { DVec3::ZERO });
        let on_ground = falls.parts().map(|(_, light, angle)| light * angle).sum::<DVec3>() / PI;
        let ground = atmosphere.albedo * (on_ground + sun * sun_height.max(0.0));
        let light = |direction: DVec3| {
            if direction.z >= 0.0 {
                return above(direction);
            }
            let mirrored = above(direction.with_z(-direction.z));
            mirrored.lerp(ground, (GROUND_DEPTH / direction.z).exp())
        };
        let mut map = Self::of_light(&light, haze);
        let to_sun = DVec3::new((1.0 - sun_height * sun_height).max(0.0).sqrt(), 0.0, sun_height);
        map.adapt(f64::from(air.adaptation.clamp(0.0, 1.0)));
        let lit = luminance(sun + map.ambient(to_sun));
        let brightness = f64::from(air.brightness).max(0.0);
        let gain = brightness / lit.max(1.0 / MOST_GAIN);
        map.scale(gain);
        map.sun = sun * gain;
        let solid_angle = PI * SUN_RADIUS * SUN_RADIUS;
        map.disc = (map.sun * PI / solid_angle).min(DVec3::splat(MOST_RADIANCE));
        map
    }

    /// Maps of a gradient sky.
    pub(crate) fn plain(plain: &GradientSky, haze: bool) -> Self {
        let colour = |colour: Vec3| colour.as_dvec3();
        let (zenith, horizon, ground) = (colour(plain.zenith), colour(plain.horizon), colour(plain.ground));
        let light = |direction: DVec3| {
            let above = horizon.lerp(zenith, direction.z.max(0.0).sqrt());
            let t = ((direction.z + 0.12) / 0.12).clamp(0.0, 1.0);
            ground.lerp(above, t * t * (3.0 - 2.0 * t))
        };
        Self { sun: colour(plain.sun), ..Self::of_light(&light, haze) }
    }

    /// Maps of a studio: objects reflect its lights, and are seen before its background.
    pub(crate) fn studio(studio: &Studio) -> Self {
        let scale = studio::scale(studio);
        let white = |radiance: f64| DVec3::splat(scale * radiance);
        let seen = Octahedral::mirrored(SEEN_SIDE, |direction| white(studio::background(direction.z)));
        let light = |direction: DVec3| white(studio::light(direction));
        Self { sun: studio.key.as_dvec3(), seen, ..Self::of_light(&light, false) }
    }

    /// Maps of light from all directions, without a sun.
    fn of_light(light: &impl Fn(DVec3) -> DVec3, haze: bool) -> Self {
        let all = Octahedral::mirrored(SEEN_SIDE, light);
        let half = all.halved();
        let quarter = half.halved();
        let parts: Vec<_> = quarter.parts().collect();
        let layer = |i: usize| {
            let roughness = i as f64 / (LOBES - 1) as f64;
            // Wider lobes use coarser input and output (Křivánek and Colbert 2008).
            let coarse = match i {
                0 => return half.clone(),
                1 | 2 => {
                    let lobe = lobe(roughness, LOBE_SAMPLES);
                    let side = LOBE_SIDE / i;
                    Octahedral::mirrored(side, |d| in_lobe(|d| half.at(d), d, &lobe))
                }
                _ => Octahedral::mirrored(LOBE_SIDE / 4, |d| in_wide_lobe(&parts, d, roughness)),
            };
            Octahedral::mirrored(LOBE_SIDE, |d| coarse.at(d))
        };
        Self {
            sun: DVec3::ZERO,
            disc: DVec3::ZERO,
            irradiance: irradiance(&half),
            lobes: (0..LOBES).map(layer).collect(),
            seen: if haze { Octahedral::mirrored(SEEN_SIDE, hazy(light)) } else { all },
        }
    }

    /// Irradiance over π.
    pub(crate) fn ambient(&self, normal: DVec3) -> DVec3 {
        ambient(&self.irradiance, normal)
    }

    /// Chromatic adaptation of the ambient light (von Kries; CIE 159:2004, degree of adaptation), keeping its
    /// luminance. Reflections are adapted by roughness: a mirror shows the unchanged sky.
    fn adapt(&mut self, degree: f64) {
        let from_above = self.ambient(DVec3::Z);
        let white = luminance(from_above);
        if white > 0.0 {
            let factors = |degree: f64| {
                let factor = |c: f64| if c > 0.0 { (white / c).powf(degree) } else { 1.0 };
                let factors = DVec3::from(from_above.to_array().map(factor));
                factors * (white / luminance(from_above * factors))
            };
            self.irradiance = self.irradiance.map(|c| c * factors(degree));
            let roughest = self.lobes.len().saturating_sub(1).max(1) as f64;
            for (layer, lobe) in self.lobes.iter_mut().enumerate() {
                lobe.tint(factors(degree * layer as f64 / roughest));
            }
        }
    }

    fn scale(&mut self, gain: f64) {
        for map in self.lobes.iter_mut().chain([&mut self.seen]) {
            map.scale(gain, MOST_RADIANCE);
        }
        self.irradiance = self.irradiance.map(|c| c * gain);
    }
}

/// Extends light below the horizon by haze: as bright as the horizon above it, and as the mean horizon underfoot.
fn hazy(light: &impl Fn(DVec3) -> DVec3) -> impl Fn(DVec3) -> DVec3 {
    const AROUND: u32 = 16;
    let horizon = (0..AROUND).map(|i| {
        let (y, x) = ((f64::from(i) + 0.5) * PI / f64::from(AROUND)).sin_cos();
        light(DVec3::new(x, y, 0.0))
    });
    let mean = horizon.sum::<DVec3>() / f64::from(AROUND);
    move |direction| {
        if direction.z >= 0.0 {
            return light(direction);
        }
        let level = direction.with_z(0.0).try_normalize().map_or(mean, light);
        let t = -direction.z;
        level.lerp(mean, t * t * (3.0 - 2.0 * t))
    }
}

/// The sky above the horizon, interpolated between ray-marched points.
struct Dome {
    sun: DVec3,
    rayleigh: Table,
    mie: Table,
    multiple: Table,
}

impl Dome {
    fn new(atmosphere: &AtmosphereTables, sun_height: f64) -> Self {
        let sun = DVec3::new((1.0 - sun_height * sun_height).max(0.0).sqrt(), 0.0, sun_height);
        let points: Vec<Scattered> = (0..AZIMUTHS * HEIGHTS)
            .map(|i| {
                let share = |i: usize, count: usize| i as f64 / (count - 1) as f64;
                // Denser at the horizon, where rays are long.
                let height = share(i / AZIMUTHS, HEIGHTS).powi(2) * FRAC_PI_2;
                let (sine, cosine) = (share(i % AZIMUTHS, AZIMUTHS) * PI).sin_cos();
                let direction = DVec3::new(height.cos() * cosine, height.cos() * sine, height.sin());
                atmosphere.scattered(GROUND_KM + EYE_KM, direction.z, sun_height, direction.dot(sun))
            })
            .collect();
        let table = |kind: fn(&Scattered) -> DVec3| {
            let at = |x: f64, count: usize| (x * (count - 1) as f64).round() as usize;
            Table::new(AZIMUTHS, HEIGHTS, |x, y| kind(&points[at(y, HEIGHTS) * AZIMUTHS + at(x, AZIMUTHS)]))
        };
        Self { sun, rayleigh: table(|s| s.rayleigh), mie: table(|s| s.mie), multiple: table(|s| s.multiple) }
    }

    /// Radiance from a direction that is not below the horizon.
    fn radiance(&self, direction: DVec3) -> DVec3 {
        let x = direction.y.abs().atan2(direction.x) / PI;
        let y = (direction.z.clamp(0.0, 1.0).asin() / FRAC_PI_2).sqrt();
        let at = |table: &Table| table.at(x, y);
        let scattered =
            Scattered { rayleigh: at(&self.rayleigh), mie: at(&self.mie), multiple: at(&self.multiple) };
        scattered.radiance(direction.dot(self.sun))
    }
}

#[cfg(test)]
#[path = "map_tests.rs"]
mod tests;
