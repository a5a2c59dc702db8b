//! A tile as the vertex shader reads it.

use bytemuck::{Pod, Zeroable};

/// An instance of the grid: `TileIn` of `terrain.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub(crate) struct TileRaw {
    /// First grid point, from the eye's cell, in grid units.
    pub(crate) from_eye: [i32; 2],
    pub(crate) atlas: [i32; 2],
    pub(crate) morph: [f32; 2],
    pub(crate) spacing: u32,
    pub(crate) regions: u32,
}

/// Layout of [`TileRaw`].
pub(crate) const TILE_ATTRIBUTES: [wgpu::VertexAttribute; 4] =
    wgpu::vertex_attr_array![0 => Sint32x2, 1 => Sint32x2, 2 => Float32x2, 3 => Uint32x2];
