//! Punctual lights: lights that stand in the scene, and which of them may reach a pixel.

mod cull;
mod list;

use glam::{DVec3, Vec3};

pub(crate) use cull::PunctualLightPass;
pub(crate) use list::PunctualLightList;
#[cfg(test)]
pub(crate) use list::lights;

/// Most punctual lights that light one picture; of more the furthest are left out.
pub const MAX_LIGHTS: usize = 65_535;
/// Sides of a tile in pixels that punctual lights may be culled in.
pub const LIGHT_TILES: [u32; 2] = [4, 64];

/// A light that stands in the scene (KHR_lights_punctual). It casts no shadow.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Light {
    /// Where, in the world.
    pub position: DVec3,
    /// Luminous intensity, linear, in candela where the sun's irradiance on a surface that faces it is π lux times
    /// [`super::GradientSky::sun`]: what it lights at distance 1 gets as many lux.
    pub intensity: Vec3,
    /// Distance at which it ends, > 0; its light falls with the square of distance, and to nothing there.
    pub range: f64,
    /// `None` shines all around.
    pub spot: Option<Spot>,
}

/// The cone of a light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spot {
    /// Whither, in the world; need not be normalised.
    pub direction: DVec3,
    /// Angle from there within which it is as bright as it gets, in radians.
    pub inner: f64,
    /// Angle at which it is dark, in radians, at most π/2.
    pub outer: f64,
}

/// How punctual lights are told from those that do not reach a pixel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LightCulling {
    /// Side of the tiles of a picture that have a list each, in pixels, within [`LIGHT_TILES`]: smaller ones are reached
    /// by fewer punctual lights and cost more to make.
    pub tile_px: u32,
    /// Tell punctual lights apart by ranges of depth too, pixel by pixel, instead of by the tile's nearest and furthest surface.
    pub clusters: bool,
    /// Most punctual lights that light a picture, up to [`MAX_LIGHTS`]: of more in view those that are brightest on the screen are
    /// kept, by their intensity over the square of their distance, or of their range where the eye is within it. What they
    /// cost goes with how many reach a pixel.
    pub most: u32,
}

impl Default for LightCulling {
    fn default() -> Self {
        Self { tile_px: 16, clusters: true, most: MAX_LIGHTS as u32 }
    }
}
