//! Sky maps without a device, computable on any thread.

use std::sync::{Arc, OnceLock};

use glam::DVec3;

use super::atmosphere::AtmosphereTables;
use super::map::SkyMap;
use crate::scene::environment::{Atmosphere, Environment, Sky};

/// Inputs of the maps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Key {
    sky: Sky,
    sun_height: f64,
    haze: bool,
}

impl Key {
    pub(super) fn new(environment: &Environment) -> Self {
        let haze = environment.haze.is_some_and(|haze| haze.extinction() > 0.0);
        Self { sky: environment.sky.finite(), sun_height: SunPlace::new(environment).height, haze }
    }

    /// Whether both keys have equal maps: only those of an atmosphere depend on the sun's height.
    fn shows_what(&self, other: &Self) -> bool {
        let height = !matches!(self.sky, Sky::Atmosphere(_)) || self.sun_height == other.sun_height;
        self.sky == other.sky && self.haze == other.haze && height
    }
}

/// Position of the sun.
#[derive(Clone, Copy, Debug)]
pub(super) struct SunPlace {
    /// Unit vectors: to the sun, up, and horizontally towards the sun.
    pub(super) to_sun: DVec3,
    pub(super) up: DVec3,
    pub(super) side: DVec3,
    /// Sine of its height over the horizon.
    pub(super) height: f64,
}

impl SunPlace {
    pub(super) fn new(environment: &Environment) -> Self {
        let unit = |d: DVec3, or| if d.is_finite() { d.try_normalize().unwrap_or(or) } else { or };
        let up = unit(environment.up, DVec3::Y);
        let to_sun = unit(environment.to_sun, up);
        let height = to_sun.dot(up).clamp(-1.0, 1.0);
        // With the sun overhead, any horizontal direction is valid.
        let side = unit(to_sun - up * height, up.any_orthonormal_vector());
        let side = unit(side - up * side.dot(up), up.any_orthonormal_vector());
        Self { to_sun, up, side, height }
    }
}

/// Maps of an environment's sky: radiance, irradiance and prefiltered reflections.
///
/// Computing them takes some hundredths of a second and no device, so a program may do it on another thread before the
/// first frame ([`crate::Frame::sky`]). A frame without maps of its environment computes them itself.
#[derive(Clone, Debug)]
pub struct SkyMaps {
    key: Key,
    map: Arc<SkyMap>,
}

impl SkyMaps {
    /// Computes the maps.
    #[must_use]
    pub fn new(environment: &Environment) -> Self {
        Self::of(Key::new(environment), &mut None)
    }

    /// Computes the maps, reusing the tables of the last atmosphere.
    pub(super) fn of(key: Key, last: &mut Option<(Atmosphere, AtmosphereTables)>) -> Self {
        let map = match &key.sky {
            Sky::Plain(plain) => SkyMap::plain(plain, key.haze),
            Sky::Studio(studio) => SkyMap::studio(studio),
            Sky::Atmosphere(air) if is_same(air, &Atmosphere::default()) => {
                SkyMap::of_air(air, default_atmosphere(), key.sun_height, key.haze)
            }
            Sky::Atmosphere(air) => {
                let known = last.take().filter(|(of, _)| is_same(of, air));
                let (_, atmosphere) = last.insert(known.unwrap_or_else(|| (*air, atmosphere(air))));
                SkyMap::of_air(air, atmosphere, key.sun_height, key.haze)
            }
        };
        Self { key, map: Arc::new(map) }
    }

    /// Whether the maps belong to a key.
    pub(super) fn are_of(&self, key: &Key) -> bool {
        self.key.shows_what(key)
    }

    pub(super) fn map(&self) -> &SkyMap {
        &self.map
    }
}

/// Whether two atmospheres have equal tables.
fn is_same(one: &Atmosphere, other: &Atmosphere) -> bool {
    one.aerosol == other.aerosol && one.ground == other.ground
}

fn atmosphere(air: &Atmosphere) -> AtmosphereTables {
    AtmosphereTables::new(f64::from(air.aerosol), air.ground.as_dvec3())
}

/// Tables of the default atmosphere, computed once per process.
pub(super) fn default_atmosphere() -> &'static AtmosphereTables {
    static DEFAULT: OnceLock<AtmosphereTables> = OnceLock::new();
    DEFAULT.get_or_init(|| atmosphere(&Atmosphere::default()))
}
