//! Terrain on the GPU: the tile atlas, the tiles of a frame and their pipelines.

mod atlas;
mod grid;
pub(crate) mod layers;
mod list;
mod pipeline;
mod regions;
mod slopes;
mod tile_raw;

pub use atlas::{MAX_DRAWN_HEIGHT, TERRAIN_SLOTS, TerrainAppearance, TerrainFrame, TerrainGpu, TerrainPart};
pub(crate) use list::{TileList, receivers};
pub(crate) use pipeline::TerrainPipelines;
#[cfg(any(test, feature = "reference"))]
pub(crate) use regions::shader_morph;

/// Computes the ground textures, which all terrains share.
pub(crate) fn compute_textures() {
    layers::texels();
}
pub(crate) use tile_raw::TileRaw;
