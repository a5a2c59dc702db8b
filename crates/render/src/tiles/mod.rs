//! Terrain on the client: which tiles a view needs, and their heights. No GPU, socket or clock here.
//!
//! A *tile* is a square of [`TILE_CELLS`]² cells of one *spacing* (2^s grid units between neighbouring points),
//! whatever patches it lies in. Its heights are sampled twice as densely, for normals. Tiles of all spacings form a
//! quadtree over the world. A view draws tiles of spacing s up to a distance [`Ranges`] gives for s, and each tile's odd
//! points slide onto the next coarser surface before that distance is reached (continuous distance-dependent level of
//! detail, Strugar 2009), so tiles of different spacings meet without cracks, T-junctions or skirts, and the picture is
//! a function of the pose alone.

mod generator;
mod placed_terrain;
mod ranges;
mod regions;
mod select;
mod store;
mod tile;

pub use generator::{Tile, TileGenerator};
pub use placed_terrain::{COARSER, GroundView, OUT_OF_VIEW, PlacedTerrain, TileRegion, Tiles};
pub use ranges::{Ranges, clearance_distance};
pub use regions::{FALLOFF, MAX_REGIONS, Reaches, Region, grown, worthwhile};
pub use select::{Eye, SelectedTile, select};
pub use store::TileStore;
pub use tile::{CELL_SAMPLES, TILE_CELLS, TILE_MARGIN, TILE_SAMPLES, TileId};
