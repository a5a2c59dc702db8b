//! What a material's uniform says of a tiled map.

use bytemuck::{Pod, Zeroable};
use lodestream_scene::asset::tiles::TILE_SIDE;

use crate::resources::texture_shape::MAX_TILED_SIDE;

/// Most levels that are tiled: those longer than a tile.
pub(super) const MAX_TILED_LEVELS: usize = (MAX_TILED_SIDE.ilog2() - TILE_SIDE.ilog2()) as usize;

/// `TiledMap` of `tiled.wgsl`. All zeros: the map is whole.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
pub(crate) struct TiledMap {
    /// Number of levels.
    pub(super) levels: u32,
    /// Number of levels that are whole.
    pub(super) whole: u32,
    /// Size of the finest level, in texels.
    pub(super) size: [u32; 2],
    /// Where the words of each tiled level begin in the page table, coarsest first.
    pub(super) tables: [u32; MAX_TILED_LEVELS],
    /// To a whole number of vectors.
    pub(super) padding: u32,
}
