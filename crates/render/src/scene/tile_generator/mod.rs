//! Generates terrain tiles apart from drawing.

#[cfg(target_family = "wasm")]
mod deferred;
#[cfg(not(target_family = "wasm"))]
mod thread;

use lodestream_terrain::tiles::TileId;

#[cfg(target_family = "wasm")]
pub(crate) use deferred::TileGenerator;
#[cfg(not(target_family = "wasm"))]
pub(crate) use thread::TileGenerator;

/// A tile's heights, in rows of [`TILE_SAMPLES`].
///
/// [`TILE_SAMPLES`]: lodestream_terrain::tiles::TILE_SAMPLES
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct GeneratedTile {
    /// The tile.
    pub id: TileId,
    /// Heights in height units, margin included.
    pub heights: Vec<i32>,
    /// Version of the terrain from which it was generated: see [`TileGenerator::request`].
    pub version: u64,
}
