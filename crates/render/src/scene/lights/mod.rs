//! Punctual lights and their culling.

mod cull;
mod list;

pub(crate) use cull::PunctualLightPass;
pub(crate) use list::PunctualLightList;
#[cfg(test)]
pub(crate) use list::lights;

/// Most punctual lights in one picture; beyond, the farthest are omitted.
pub const MAX_LIGHTS: usize = 65_535;
/// Least and largest tile side in pixels.
pub const LIGHT_TILES: [u32; 2] = [4, 64];

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
