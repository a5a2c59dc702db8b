//! Generates terrain tiles apart from drawing.

#[cfg_attr(target_family = "wasm", path = "deferred.rs")]
#[cfg_attr(not(target_family = "wasm"), path = "thread.rs")]
mod generator;

use lodestream_terrain::tiles::TileId;

pub(crate) use generator::TileGenerator;

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
