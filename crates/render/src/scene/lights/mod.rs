//! Punctual lights and their culling.

mod cull;
mod list;

use glam::{DVec3, Vec3};

pub(crate) use cull::PunctualLightPass;
pub(crate) use list::PunctualLightList;
#[cfg(test)]
pub(crate) use list::lights;

/// Most punctual lights in one picture; beyond, the farthest are omitted.
pub const MAX_LIGHTS: usize = 65_535;
/// Least and largest tile side in pixels.
pub const LIGHT_TILES: [u32; 2] = [4, 64];

/// A point or spot light of the scene (KHR_lights_punctual). Casts no shadow.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Light {
    /// Position in the world.
    pub position: DVec3,
    /// Luminous intensity, linear. Its unit is that of [`crate::GradientSky::sun`] over π: a light of intensity π
    /// times that value lights a surface at distance 1 as the sun does.
    pub intensity: Vec3,
    /// Range, > 0: the inverse-square falloff is windowed to 0 there.
    pub range: f64,
    /// Cone of a spot light; `None` for a point light.
    pub spot: Option<Spot>,
}

/// The cone of a light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spot {
    /// Direction in the world; need not be normalised.
    pub direction: DVec3,
    /// Angle from the axis within which it has full intensity, in radians.
    pub inner: f64,
    /// Angle from the axis at which it is dark, in radians, at most π/2.
    pub outer: f64,
}

/// Culling of punctual lights.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LightCulling {
    /// Side in pixels of the tiles that have a light list each, within [`LIGHT_TILES`]. Smaller tiles have fewer
    /// lights each and cost more to build.
    pub tile_px: u32,
    /// Clustered: tests depth bins per pixel, instead of each tile's depth range.
    pub clusters: bool,
    /// Most lights in a picture, up to [`MAX_LIGHTS`]: the brightest on the screen are kept, by intensity over the
    /// squared distance, or over the squared range where the eye is within it. The cost is proportional to the number
    /// that reach a pixel.
    pub most: u32,
}

impl Default for LightCulling {
    fn default() -> Self {
        Self { tile_px: 16, clusters: true, most: MAX_LIGHTS as u32 }
    }
}
