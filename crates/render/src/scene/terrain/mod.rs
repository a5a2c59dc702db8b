//! Terrain: what of it lies in GPU memory, the tiles of a frame, and the pipelines that draw them.

mod atlas;
mod grid;
pub(crate) mod layers;
mod list;
mod pipeline;
mod regions;
mod slopes;
mod tile_raw;

#[cfg(any(test, feature = "reference"))]
pub(crate) use atlas::arrival;
pub use atlas::{MAX_DRAWN_HEIGHT, TERRAIN_SLOTS, TerrainFrame, TerrainGpu, TerrainLook, TerrainPart};
pub(crate) use list::{TileList, receivers};
pub(crate) use pipeline::TerrainPipelines;

/// Paints the ground's textures, which are the same for every terrain.
pub(crate) fn compute_textures() {
    layers::texels();
}
pub(crate) use tile_raw::TileRaw;
