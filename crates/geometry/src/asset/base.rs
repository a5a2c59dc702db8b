//! The base blob: everything a client needs to draw an asset coarsely and to request more.

use crate::asset::index::Sphere;
use crate::entropy::Codec;
pub use crate::mesh::MAX_PARTS;
use crate::mesh::skin::Skin;
use crate::mesh::{Face, Grid, Kinds, UvGrid, Wedge};

/// Version of the base blob, of index pages and of chunk payloads.
pub const FORMAT_VERSION: u8 = 5;
/// Most faces of a base mesh: bounds a decoder's memory.
pub const MAX_BASE_FACES: usize = 1 << 20;
/// Most chunks per asset.
pub const MAX_CHUNKS: u32 = 1 << 22;
/// Most bytes of an asset's description.
pub const MAX_DESCRIPTION_BYTES: usize = 512 * 1024;

/// Sizes of the fully refined asset.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Totals {
    /// Vertices.
    pub vertices: u64,
    /// Wedges.
    pub wedges: u64,
    /// Faces.
    pub faces: u64,
}

/// The base mesh of an asset with the asset's metadata.
#[derive(Clone, Debug, PartialEq)]
pub struct Base {
    /// Grid of the positions.
    pub grid: Grid,
    /// Grid of the texture coordinates.
    pub uv_grid: UvGrid,
    /// Grid of the second set of texture coordinates.
    pub second_uv_grid: UvGrid,
    /// Bounding sphere of the input, relative to [`Grid::origin`].
    pub sphere: Sphere,
    /// Length of the bounding box's diagonal, in the asset's units.
    pub diagonal: f32,
    /// Geometric error of the base mesh, in the asset's units.
    pub geometric_error: f32,
    /// Chunks of the asset.
    pub chunk_count: u32,
    /// Levels above the base.
    pub level_count: u8,
    /// Number of low position bits that the grids leave out: of the base mesh, then of each level; descending to 0.
    /// Vertices with more bits are those that no later chunk moves.
    pub shifts: Vec<u8>,
    /// Materials that faces may name.
    pub material_count: u16,
    /// Parts that vertices may name: at least 1, at most [`MAX_PARTS`].
    pub part_count: u32,
    /// Codec of the chunks, and of the base mesh unless [`Base::encode_as`] is used.
    pub codec: Codec,
    /// Whether wedges have colours.
    pub colors: bool,
    /// Whether wedges may have explicit normals.
    pub normals: bool,
    /// Whether joints move vertices.
    pub skinned: bool,
    /// Sizes of the fully refined asset.
    pub totals: Totals,
    /// Materials and textures as the scene crate encodes them; opaque in this crate.
    pub description: Vec<u8>,
    /// Positions of the base mesh.
    pub positions: Vec<[i32; 3]>,
    /// Its wedges.
    pub wedges: Vec<Wedge>,
    /// Its faces.
    pub faces: Vec<Face>,
    /// Part of each of its vertices; empty if the asset is one part.
    pub parts: Vec<u32>,
    /// Skin of each of its vertices; empty unless [`Base::skinned`].
    pub skins: Vec<Skin>,
}

/// A base blob with its mesh in each codec. The container must state which is used ([`Base::decode_as`]).
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BaseBlobs {
    /// Coded with [`Codec::Range`].
    pub range: Vec<u8>,
    /// Coded with [`Codec::Zstd`].
    pub zstd: Vec<u8>,
}

impl Base {
    /// Attributes of its wedges.
    pub(crate) fn kinds(&self) -> Kinds {
        Kinds {
            uv_bits: self.uv_grid.bits,
            second_uv_bits: self.second_uv_grid.bits,
            colors: self.colors,
            normals: self.normals,
            skins: self.skinned,
        }
    }
}
