//! The maps of a sky apart from a device: computed wherever there is time for it.

use std::sync::{Arc, OnceLock};

use glam::DVec3;

use super::atmosphere::AtmosphereTables;
use super::map::SkyMap;
use crate::scene::environment::{Atmosphere, Environment, Sky};

/// What the maps depend on.
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

    /// Whether this one's maps are another's too: colours that a host gives do not follow the sun.
    fn shows_what(&self, other: &Self) -> bool {
        let height = matches!(self.sky, Sky::Plain(_)) || self.sun_height == other.sun_height;
        self.sky == other.sky && self.haze == other.haze && height
    }
}

/// Where the sun stands.
#[derive(Clone, Copy, Debug)]
pub(super) struct SunPlace {
    /// Unit vectors: to the sun, up, across it towards where the sun stands.
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
        // Where the sun is overhead, any way across will do.
        let side = unit(to_sun - up * height, up.any_orthonormal_vector());
        let side = unit(side - up * side.dot(up), up.any_orthonormal_vector());
        Self { to_sun, up, side, height }
    }
}

/// The maps of an environment's sky: what is seen of it, what of its light falls on surfaces, and what they reflect.
///
/// Computing them takes some hundredths of a second and no device, so a program may do it on a thread of its own before the
/// first frame ([`crate::Frame::sky`]). A frame that is handed none, or another environment's, computes them itself.
#[derive(Clone, Debug)]
pub struct SkyMaps {
    key: Key,
    map: Arc<SkyMap>,
}

impl SkyMaps {
    /// Computes them.
    #[must_use]
    pub fn new(environment: &Environment) -> Self {
        Self::of(Key::new(environment), &mut None)
    }

    /// The same, with the tables of the last air at hand, which serve all suns.
    pub(super) fn of(key: Key, last: &mut Option<(Atmosphere, AtmosphereTables)>) -> Self {
        let map = match &key.sky {
            Sky::Plain(plain) => SkyMap::plain(plain, key.haze),
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

    /// Whether they are an environment's.
    pub(super) fn are_of(&self, key: &Key) -> bool {
        self.key.shows_what(key)
    }

    pub(super) fn map(&self) -> &SkyMap {
        &self.map
    }
}

/// Whether tables of one air are those of another.
fn is_same(one: &Atmosphere, other: &Atmosphere) -> bool {
    one.aerosol == other.aerosol && one.ground == other.ground
}

fn atmosphere(air: &Atmosphere) -> AtmosphereTables {
    AtmosphereTables::new(f64::from(air.aerosol), air.ground.as_dvec3())
}

/// Of the air of most scenes. Computed once in a program, by the first who asks; the others wait for it.
pub(super) fn default_atmosphere() -> &'static AtmosphereTables {
    static DEFAULT: OnceLock<AtmosphereTables> = OnceLock::new();
    DEFAULT.get_or_init(|| atmosphere(&Atmosphere::default()))
}
