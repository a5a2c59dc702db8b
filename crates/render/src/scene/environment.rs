//! Environment of a frame: sun, sky and haze.

use glam::{DVec3, Vec3};

/// Light, sky and haze.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Environment {
    /// Direction towards the sun, world space; need not be normalised.
    pub to_sun: DVec3,
    /// Up direction of the scene, for the sky; need not be normalised.
    pub up: DVec3,
    /// Sky and sun.
    pub sky: Sky,
    /// Haze, if any.
    pub haze: Option<Haze>,
}

impl Default for Environment {
    fn default() -> Self {
        Self {
            to_sun: DVec3::new(0.55, 0.75, 0.45),
            up: DVec3::Y,
            sky: Sky::Atmosphere(Atmosphere::default()),
            haze: None,
        }
    }
}

/// Sky and sun.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Sky {
    /// A physical atmosphere. Its tables are computed on the CPU when it, the sun's height or the presence of
    /// [`Environment::haze`] change (milliseconds; `docs/benchmarks/drawing.md`).
    Atmosphere(Atmosphere),
    /// Given colours.
    Plain(GradientSky),
    /// A photographer's studio for single objects.
    Studio(Studio),
}

/// A studio: a grey background without a horizon, soft boxes around the objects, and a key light where the sun would
/// be. Its lights stand as the sun does: turning [`Environment::to_sun`] about [`Environment::up`] turns them all.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Studio {
    /// Irradiance of the key light on a surface that faces it, divided by π. The other lights and the background are
    /// white, and brighten with its luminance; they stay if it is 0.
    pub key: Vec3,
    /// Whether there is ground under the lowest point of the objects. Only their shadow on it is seen, if
    /// [`crate::Settings::shadows`] are on, and nothing from below. A frame over a host's picture has none.
    pub ground: bool,
}

impl Default for Studio {
    fn default() -> Self {
        Self { key: Vec3::ONE, ground: true }
    }
}

/// Clear-sky atmosphere of the Earth (Hillaire 2020).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Atmosphere {
    /// Aerosol as a multiple of that of very clear air (optical depth 0.005), 0 to 100. More aerosol whitens and
    /// brightens the sky around the sun, and lights shadows more.
    pub aerosol: f32,
    /// Albedo of the ground in red, green and blue, 0 to 1.
    pub ground: Vec3,
    /// Radiance of a white diffuse surface that faces the sun, from sun and sky together. Exposure follows a low sun,
    /// down to a sixteenth of the light without an atmosphere.
    pub brightness: f32,
    /// Chromatic adaptation of ambient light, 0 (as photographs show it) to 1 (white is white in shadow).
    pub adaptation: f32,
}

impl Default for Atmosphere {
    fn default() -> Self {
        Self { aerosol: 16.0, ground: Vec3::new(0.22, 0.20, 0.17), brightness: 1.05, adaptation: 0.7 }
    }
}

/// A sky of three colours, linear.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GradientSky {
    /// Irradiance of the sun on a surface that faces it, divided by π (so 1 shows a white diffuse
    /// surface as 1).
    pub sun: Vec3,
    /// Radiance overhead.
    pub zenith: Vec3,
    /// Radiance at the horizon.
    pub horizon: Vec3,
    /// Radiance from below.
    pub ground: Vec3,
}

impl Default for GradientSky {
    fn default() -> Self {
        Self {
            sun: Vec3::new(0.80, 0.75, 0.66),
            zenith: Vec3::new(0.14, 0.22, 0.38),
            horizon: Vec3::new(0.42, 0.47, 0.52),
            ground: Vec3::new(0.13, 0.12, 0.105),
        }
    }
}

/// Homogeneous haze.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Haze {
    /// Meteorological optical range in world units, above 0: distance at which 5 % of a surface's contrast to the sky
    /// remains. 2,000 m is mist, 10 km haze, 50 km clear.
    pub visibility: f64,
}

impl Haze {
    /// Extinction per world unit (WMO No. 8: −ln 0.05 over the range); 0 for invalid ranges.
    pub(crate) fn extinction(&self) -> f64 {
        // Beyond these, f32 distances lose all precision.
        if self.visibility > 0.0 { (-0.05f64.ln() / self.visibility).clamp(1e-30, 1e30) } else { 0.0 }
    }
}

impl Sky {
    /// Clamps all values to finite ranges.
    pub(crate) fn finite(&self) -> Self {
        let number = |x: f32, or: f32, [least, most]: [f32; 2]| {
            if x.is_nan() { or } else { x.clamp(least, most) }
        };
        match self {
            Self::Atmosphere(air) => {
                let default = Atmosphere::default();
                let share = |x| number(x, 0.0, [0.0, 1.0]);
                Self::Atmosphere(Atmosphere {
                    aerosol: number(air.aerosol, default.aerosol, [0.0, 100.0]),
                    ground: Vec3::from(air.ground.to_array().map(share)),
                    brightness: number(air.brightness, default.brightness, [0.0, 1e3]),
                    adaptation: share(air.adaptation),
                })
            }
            Self::Plain(plain) => {
                let colour = |c: Vec3| Vec3::from(c.to_array().map(|x| number(x, 0.0, [0.0, 6e4])));
                Self::Plain(GradientSky {
                    sun: colour(plain.sun),
                    zenith: colour(plain.zenith),
                    horizon: colour(plain.horizon),
                    ground: colour(plain.ground),
                })
            }
            Self::Studio(studio) => {
                let key = Vec3::from(studio.key.to_array().map(|x| number(x, 0.0, [0.0, 1e3])));
                Self::Studio(Studio { key, ..*studio })
            }
        }
    }
}
