//! Selection of the terrain tiles that a view draws: continuous distance-dependent level of detail (CDLOD, Strugar
//! 2009).
//!
//! A *tile* is a square of [`TILE_CELLS`]² cells of one *spacing* (2^s grid units between neighbouring points); it may
//! span several patches. Its heights are sampled twice as densely, for normals. Tiles of all spacings form a quadtree
//! over the world. A view draws tiles of spacing s up to the distance that [`LodRanges`] gives for s. Before that
//! distance, each tile's odd points morph onto the next coarser surface, so tiles of different spacings meet without
//! cracks, T-junctions or skirts. The selection depends on the view alone.
//!
//! No GPU, thread, socket or clock here: a renderer holds the tiles, and a thread of the caller may generate them.

#![allow(
    clippy::cast_possible_truncation,
    clippy::cast_possible_wrap,
    clippy::cast_precision_loss,
    clippy::cast_sign_loss,
    reason = "distances and screen errors are f64; integers here are below 2^40"
)]

mod placed_terrain;
mod ranges;
mod regions;
mod select;
mod store;
mod tile;

pub use placed_terrain::{COARSER, OUT_OF_VIEW, PlacedTerrain, TerrainView, TileRegion, Tiles};
pub use ranges::{LodRanges, clearance_distance};
pub use regions::{FALLOFF, MAX_REGIONS, Region, RegionRanges, merged_regions, region_margin};
pub use select::{Eye, SelectedTile, select};
pub use store::TileStore;
pub use tile::{CELL_SAMPLES, TILE_CELLS, TILE_MARGIN, TILE_SAMPLES, TileId};
