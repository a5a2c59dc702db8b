//! The mesh to encode, and its format.

use crate::mesh::skin::Skin;
use crate::mesh::{Face, Kinds, UvGrid, Wedge};

/// A small mesh in traversal order.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct BaseMesh {
    pub(crate) positions: Vec<[i32; 3]>,
    pub(crate) wedges: Vec<Wedge>,
    pub(crate) faces: Vec<Face>,
    /// Part of each vertex; empty if the format has one part.
    pub(crate) parts: Vec<u32>,
    /// Skin of each vertex; empty if the format has none.
    pub(crate) skins: Vec<Skin>,
}

impl BaseMesh {
    /// Vertices, wedges and faces.
    pub(super) fn elements(&self) -> u64 {
        (self.positions.len() + self.wedges.len() + self.faces.len()) as u64
    }
}

/// A base mesh in traversal order, with the original index of each element.
pub(crate) struct OrderedBase {
    pub(crate) mesh: BaseMesh,
    pub(crate) vertices: Vec<u32>,
    pub(crate) wedges: Vec<u32>,
    pub(crate) faces: Vec<u32>,
}

/// The bytes of a base mesh in each codec.
pub(crate) struct BothCodecs {
    pub(crate) range: Vec<u8>,
    pub(crate) plain: Vec<u8>,
}

/// Parameters of the coding of a base mesh besides the mesh.
#[derive(Clone, Copy, Debug)]
pub(crate) struct BaseFormat {
    /// Bits per axis of positions.
    pub(crate) bits: u8,
    pub(crate) kinds: Kinds,
    /// Number of materials.
    pub(crate) materials: u16,
    /// Number of parts.
    pub(crate) parts: u32,
    /// Height over width of a cell of each set's uv grid; 1 without texture coordinates.
    pub(crate) uv_ratios: [f64; 2],
}

impl BaseFormat {
    /// `uv_grids` are those of both sets of texture coordinates.
    pub(crate) fn new(bits: u8, kinds: Kinds, materials: u16, parts: u32, uv_grids: [&UvGrid; 2]) -> Self {
        let uv_ratios = uv_grids.map(|grid| {
            let ratio = grid.step[1] / grid.step[0];
            if ratio.is_finite() && ratio > 0.0 { ratio } else { 1.0 }
        });
        Self { bits, kinds, materials, parts, uv_ratios }
    }
}
