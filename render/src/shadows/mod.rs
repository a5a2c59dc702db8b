//! Shadows of the sun: cascades of depth maps that look along its light, and the light that they leave to each pixel.

mod cascades;
mod casters;
mod maps;
mod sunlight;

use cascades::cascades;

use crate::draw::DrawList;
use crate::scene::Frame;
use crate::terrain;

pub(crate) use cascades::{Cascade, Receivers};
pub(crate) use casters::Casters;
pub(crate) use maps::{ShadowMaps, Sun};
pub(crate) use sunlight::SunlightUniform;
#[cfg(test)]
pub(crate) use sunlight::map_from_world;

/// The cascades of a frame, of which `list` holds what is in view.
pub(crate) fn of_frame(frame: &Frame<'_>, list: &DrawList<'_>, shadows: Shadows) -> Vec<Cascade> {
    let mut seen = list.receivers;
    if let Some(terrain) = &frame.terrain {
        terrain::receivers(terrain, frame.camera.eye, &mut seen);
    }
    cascades(frame.camera.eye, frame.environment.to_sun, seen, shadows.cascades as usize)
}

/// Most cascades.
pub const MAX_CASCADES: usize = 4;
/// Least and most texels along a side of a map.
pub const MAP_SIDES: [u32; 2] = [128, 8192];
/// Widest filter.
pub const MAX_FILTER: u32 = 3;

/// Shadows of the sun.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shadows {
    /// Ranges of distance with a map of their own, 1 to [`MAX_CASCADES`]; fewer are drawn where fewer suffice. Each costs
    /// the triangles that may cast shadows into it, whenever one of them changes or it moves on.
    pub cascades: u32,
    /// Texels along a side of each map, within [`MAP_SIDES`]; four bytes each. Edges of shadows are blurred by about a
    /// texel, which is one to five pixels at 720 lines and 2048 texels.
    pub map_side: u32,
    /// Texels over which an edge is blurred, less one: this many bilinear lookups squared, 1 to [`MAX_FILTER`]. The wider
    /// it is, the further from what casts them shadows begin.
    pub filter: u32,
    /// Frames for which a map may show things as they were while it stays in its place, for cameras that move on slow
    /// devices. With 0 a frame is a function of what it is made of.
    pub patience: u32,
}

impl Default for Shadows {
    fn default() -> Self {
        Self { cascades: 4, map_side: 2048, filter: 2, patience: 0 }
    }
}

impl Shadows {
    /// The same within their ranges, on a device whose textures have at most `side` texels along a side. Maps move by a
    /// sixteenth of their side, which is to be whole texels.
    pub(crate) fn clamped(self, side: u32) -> Self {
        let [least, most] = MAP_SIDES;
        Self {
            cascades: self.cascades.clamp(1, MAX_CASCADES as u32),
            map_side: self.map_side.clamp(least, most.min(side).max(least)) / 16 * 16,
            filter: self.filter.clamp(1, MAX_FILTER),
            ..self
        }
    }
}
