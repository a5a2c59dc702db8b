//! Sunlight scattered in an atmosphere (Hillaire, "A Scalable and Production Ready Sky and Atmosphere Rendering
//! Technique", EGSR 2020), in f64.
//!
//! Spherical shells around a planet hold air (Rayleigh), aerosol (Mie) and ozone. Single scattering is marched along a
//! ray; all further orders are taken to scatter evenly and to see the same light everywhere around, so that they sum up
//! as a geometric series (Hillaire's equations 5 to 10). Lengths are kilometres; the sun's irradiance above the
//! atmosphere is π in each channel, so 1 is what a white surface shows in it.

use std::f64::consts::PI;

use glam::DVec3;

use super::table::Table;

/// Radius of the planet.
pub(crate) const GROUND_KM: f64 = 6360.0;
/// Where the atmosphere ends.
pub(crate) const TOP_KM: f64 = 6460.0;
/// Angular radius of the sun, radians.
pub(crate) const SUN_RADIUS: f64 = 0.004_65;

/// Scattering by air at the ground, per km, at 680, 550 and 440 nm (Bruneton and Neyret 2008).
const RAYLEIGH: DVec3 = DVec3::new(5.802e-3, 13.558e-3, 33.1e-3);
const RAYLEIGH_HEIGHT_KM: f64 = 8.0;
/// Scattering and extinction by very clear air's aerosol at the ground, per km (Bruneton and Neyret's tables: a tenth is
/// absorbed; the paper's own table reads as if half were, its program has these).
const MIE: [f64; 2] = [3.996e-3, 4.440e-3];
const MIE_HEIGHT_KM: f64 = 1.2;
/// Mean cosine of scattering by aerosol.
const MIE_G: f64 = 0.8;
/// Absorption by ozone where it is densest, 25 km up; none 15 km above and below.
const OZONE: DVec3 = DVec3::new(0.650e-3, 1.881e-3, 0.085e-3);

/// Steps of optical depths, from the lowest point of a ray outwards.
const DEPTH_STEPS: u32 = 24;
/// Steps of scattering along a ray that is seen, and of one that lights a point of it.
const SEEN_STEPS: u32 = 24;
const LIGHT_STEPS: u32 = 10;

/// Coefficients of the medium at a height, per km.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Medium {
    /// Scattering by air.
    pub(crate) rayleigh: DVec3,
    /// Scattering by aerosol.
    pub(crate) mie: f64,
    /// Scattering and absorption.
    pub(crate) extinction: DVec3,
}

/// In-scattered light of a ray by kind, before phase functions: those change fast with direction, the sums slowly.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Scattered {
    pub(crate) rayleigh: DVec3,
    pub(crate) mie: DVec3,
    /// Second and further orders, phase included.
    pub(crate) multiple: DVec3,
}

impl Scattered {
    /// Radiance where the ray and the direction to the sun have this cosine between them.
    pub(crate) fn radiance(&self, cosine: f64) -> DVec3 {
        self.rayleigh * rayleigh_phase(cosine) + self.mie * mie_phase(cosine) + self.multiple
    }
}

/// An atmosphere with tables that are independent of the sun.
#[derive(Clone, Debug)]
pub(crate) struct AtmosphereTables {
    /// Aerosol as a multiple of that of clear air.
    aerosol: f64,
    /// Albedo of the ground.
    pub(crate) albedo: DVec3,
    /// Up to the atmosphere's end, over Bruneton's (2008) coordinates of height and angle.
    transmittance: Table,
    /// Light of the second and further orders per unit of scattering, over the sun's cosine and height.
    multiple: Table,
}

impl AtmosphereTables {
    pub(crate) fn new(aerosol: f64, albedo: DVec3) -> Self {
        let mut new = Self { aerosol, albedo, transmittance: Table::default(), multiple: Table::default() };
        new.transmittance = Table::new(64, 32, |x, y| {
            let (radius, cosine) = from_bruneton(x, y);
            (-new.optical_depth(radius, cosine)).exp()
        });
        new.multiple = Table::new(24, 10, |x, y| {
            let height = (TOP_KM - GROUND_KM) * y * y;
            new.multiple_scattering(GROUND_KM + height.max(1e-3), 2.0 * x - 1.0)
        });
        new
    }

    pub(crate) fn medium(&self, height_km: f64) -> Medium {
        let height = height_km.max(0.0);
        let rayleigh = RAYLEIGH * (-height / RAYLEIGH_HEIGHT_KM).exp();
        let aerosol = self.aerosol * (-height / MIE_HEIGHT_KM).exp();
        let ozone = OZONE * (1.0 - (height - 25.0).abs() / 15.0).max(0.0);
        Medium {
            rayleigh,
            mie: MIE[0] * aerosol,
            extinction: rayleigh + DVec3::splat(MIE[1] * aerosol) + ozone,
        }
    }

    /// Optical depth of a ray that leaves the atmosphere, through the planet if need be (where air is as on its ground).
    fn optical_depth(&self, radius: f64, cosine: f64) -> DVec3 {
        let outwards = |lowest: f64, length: f64| {
            // Ever longer steps: air gets thinner.
            steps(length, DEPTH_STEPS)
                .map(|(at, step)| self.medium(lowest.hypot(at) - GROUND_KM).extinction * step)
                .sum::<DVec3>()
        };
        let (along, lowest) = (radius * cosine, radius * (1.0 - cosine * cosine).max(0.0).sqrt());
        let to_top = (TOP_KM * TOP_KM - lowest * lowest).max(0.0).sqrt();
        if cosine < 0.0 {
            outwards(lowest, -along) + outwards(lowest, to_top)
        } else {
            steps(to_top - along, DEPTH_STEPS)
                .map(|(at, step)| {
                    let height = lowest.hypot(along + at) - GROUND_KM;
                    self.medium(height).extinction * step
                })
                .sum()
        }
    }

    /// Share of the sun's light that arrives at a radius where the sun's zenith angle has this cosine. The planet hides
    /// the sun's disc gradually.
    pub(crate) fn sunlight(&self, radius: f64, cosine: f64) -> DVec3 {
        let sine = GROUND_KM / radius.max(GROUND_KM);
        let horizon = -(1.0 - sine * sine).max(0.0).sqrt();
        let soft = sine * SUN_RADIUS;
        let up = ((cosine - horizon + soft) / (2.0 * soft)).clamp(0.0, 1.0);
        if up <= 0.0 {
            return DVec3::ZERO;
        }
        let (x, y) = to_bruneton(radius, cosine.max(horizon));
        self.transmittance.at(x, y) * (up * up * (3.0 - 2.0 * up))
    }

    /// In-scattered light of a ray from a radius: `cosine` above the horizon, with the sun's cosine `sun` and the
    /// cosine `between` ray and sun.
    pub(crate) fn scattered(&self, radius: f64, cosine: f64, sun: f64, between: f64) -> Scattered {
        let mut sums = Scattered { rayleigh: DVec3::ZERO, mie: DVec3::ZERO, multiple: DVec3::ZERO };
        let mut left = DVec3::ONE;
        for (at, step) in steps(ray_length(radius, cosine).0, SEEN_STEPS) {
            let (here, sun_here) = place(radius, cosine, sun, between, at);
            let medium = self.medium(here - GROUND_KM);
            let light = self.sunlight(here, sun_here);
            let (passed, weight) = through(&medium, left, step);
            sums.rayleigh += weight * medium.rayleigh * light * PI;
            sums.mie += weight * medium.mie * light * PI;
            sums.multiple += weight * (medium.rayleigh + medium.mie) * self.multiple_at(here, sun_here);
            left = passed;
        }
        sums
    }

    fn multiple_at(&self, radius: f64, sun: f64) -> DVec3 {
        let height = ((radius - GROUND_KM) / (TOP_KM - GROUND_KM)).clamp(0.0, 1.0);
        self.multiple.at(0.5 + 0.5 * sun, height.sqrt())
    }

    /// Hillaire's Ψ, by 36 directions of which half mirror the others.
    fn multiple_scattering(&self, radius: f64, sun: f64) -> DVec3 {
        const ROWS: u32 = 6;
        const COLUMNS: u32 = 3;
        let sun_sine = (1.0 - sun * sun).max(0.0).sqrt();
        let (mut second, mut again) = (DVec3::ZERO, DVec3::ZERO);
        for i in 0..ROWS * COLUMNS {
            let cosine = (f64::from(i / COLUMNS) + 0.5) * 2.0 / f64::from(ROWS) - 1.0;
            let azimuth = (f64::from(i % COLUMNS) + 0.5) * PI / f64::from(COLUMNS);
            let between = sun * cosine + sun_sine * (1.0 - cosine * cosine).sqrt() * azimuth.cos();
            let (length, ground) = ray_length(radius, cosine);
            let mut left = DVec3::ONE;
            for (at, step) in steps(length, LIGHT_STEPS) {
                let (here, sun_here) = place(radius, cosine, sun, between, at);
                let medium = self.medium(here - GROUND_KM);
                let (passed, weight) = through(&medium, left, step);
                let scattering = weight * (medium.rayleigh + medium.mie);
                // Evenly: π of irradiance over 4π.
                second += scattering * self.sunlight(here, sun_here) * 0.25;
                again += scattering;
                left = passed;
            }
            if ground {
                let (_, sun_there) = place(radius, cosine, sun, between, length);
                second += left * self.albedo * sun_there.max(0.0) * self.sunlight(GROUND_KM, sun_there);
            }
        }
        let count = f64::from(ROWS * COLUMNS);
        (second / count) / (DVec3::ONE - again / count)
    }
}

/// Length of a ray to the ground or the atmosphere's end, and whether it meets the ground.
pub(crate) fn ray_length(radius: f64, cosine: f64) -> (f64, bool) {
    let lowest2 = radius * radius * (1.0 - cosine * cosine);
    if cosine < 0.0 && lowest2 <= GROUND_KM * GROUND_KM {
        return ((-radius * cosine - (GROUND_KM * GROUND_KM - lowest2).sqrt()).max(0.0), true);
    }
    (-radius * cosine + (TOP_KM * TOP_KM - lowest2).max(0.0).sqrt(), false)
}

/// Radius and the sun's cosine at a place along a ray.
pub(crate) fn place(radius: f64, cosine: f64, sun: f64, between: f64, at: f64) -> (f64, f64) {
    let here = (radius * radius + at * at + 2.0 * radius * cosine * at).max(0.0).sqrt();
    (here.clamp(GROUND_KM, TOP_KM), ((radius * sun + at * between) / here).clamp(-1.0, 1.0))
}

/// Middles and lengths of steps that grow along a ray.
fn steps(length: f64, count: u32) -> impl Iterator<Item = (f64, f64)> {
    let at = move |i: u32| {
        let share = f64::from(i) / f64::from(count);
        length * share * share
    };
    (0..count).map(move |i| (0.5 * (at(i) + at(i + 1)), at(i + 1) - at(i)))
}

/// Transmittance after a step, and the weight of light scattered in it (Hillaire 2015: exact in a homogeneous medium).
fn through(medium: &Medium, left: DVec3, step: f64) -> (DVec3, DVec3) {
    let passed = left * (-medium.extinction * step).exp();
    (passed, (left - passed) / medium.extinction.max(DVec3::splat(1e-12)))
}

/// Per steradian.
pub(crate) fn rayleigh_phase(cosine: f64) -> f64 {
    3.0 / (16.0 * PI) * (1.0 + cosine * cosine)
}

/// Per steradian (Cornette and Shanks 1992).
pub(crate) fn mie_phase(cosine: f64) -> f64 {
    let g2 = MIE_G * MIE_G;
    3.0 / (8.0 * PI) * (1.0 - g2) * (1.0 + cosine * cosine)
        / ((2.0 + g2) * (1.0 + g2 - 2.0 * MIE_G * cosine).powf(1.5))
}

/// Table coordinates of a radius and a zenith angle's cosine (Bruneton and Neyret 2008, improved 2017): resolved where
/// transmittance changes, at the horizon.
fn to_bruneton(radius: f64, cosine: f64) -> (f64, f64) {
    let longest = (TOP_KM * TOP_KM - GROUND_KM * GROUND_KM).sqrt();
    let rho = (radius * radius - GROUND_KM * GROUND_KM).max(0.0).sqrt();
    let lowest2 = radius * radius * (1.0 - cosine * cosine);
    let length = -radius * cosine + (TOP_KM * TOP_KM - lowest2).max(0.0).sqrt();
    let (least, most) = (TOP_KM - radius, rho + longest);
    (((length - least) / (most - least)).clamp(0.0, 1.0), rho / longest)
}

fn from_bruneton(x: f64, y: f64) -> (f64, f64) {
    let longest = (TOP_KM * TOP_KM - GROUND_KM * GROUND_KM).sqrt();
    let rho = y * longest;
    let radius = rho.hypot(GROUND_KM);
    let (least, most) = (TOP_KM - radius, rho + longest);
    let length = least + x * (most - least);
    let cosine = if length <= 0.0 {
        1.0
    } else {
        (longest * longest - rho * rho - length * length) / (2.0 * radius * length)
    };
    (radius, cosine.clamp(-1.0, 1.0))
}

#[cfg(test)]
#[path = "reference.rs"]
mod reference;
