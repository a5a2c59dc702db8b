//! Meshes before preparation: as imported ([`SourceMesh`]) and as quantised ([`QuantisedMesh`]).
//!
//! Topology is on vertices, attributes on *wedges* (Hoppe, "Progressive Meshes", 1996, §2): a wedge is one tuple of
//! [`Attributes`] at one vertex, and face corners refer to wedges. Faces that meet at a uv seam still share their
//! vertices, so simplification cannot tear the surface along a seam.

pub mod components;
pub(crate) mod corner;
pub mod distance;
pub(crate) mod four;
pub(crate) mod id_set;
pub mod normals;
pub mod octahedral;
pub(crate) mod orientation_class;
pub(crate) mod principal_axes;
mod ray;
pub(crate) mod rows;
pub(crate) mod shorten;
pub mod skin;
pub(crate) mod slot_map;
pub(crate) mod stars;
pub(crate) mod vec3;
pub(crate) mod wedges;
pub(crate) mod wide_bvh;

use skin::{Pose, Skin};

/// Marks a [`Corner`] attribute that the source lacks.
pub const NONE: u32 = u32::MAX;

/// Most bits per axis: differences still fit f32 exactly.
pub const MAX_POSITION_BITS: u8 = 24;

/// Most parts of a mesh.
pub const MAX_PARTS: u32 = 1 << 20;

/// Most bits per axis of the uv grid.
pub const MAX_UV_BITS: u8 = 16;

/// One corner of an imported face: indices into the arrays of its [`SourceMesh`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Corner {
    /// Index into [`SourceMesh::positions`].
    pub position: u32,
    /// Index into [`SourceMesh::uvs`], or [`NONE`].
    pub uv: u32,
    /// Index into [`SourceMesh::second_uvs`], or [`NONE`].
    pub second_uv: u32,
    /// Index into [`SourceMesh::normals`], or [`NONE`].
    pub normal: u32,
    /// Index into [`SourceMesh::colors`], or [`NONE`].
    pub color: u32,
}

impl Corner {
    /// A corner without attributes.
    #[must_use]
    pub const fn at(position: u32) -> Self {
        Self { position, uv: NONE, second_uv: NONE, normal: NONE, color: NONE }
    }
}

/// A triangle mesh as an importer delivers it, in the source's own indexing.
///
/// No cleaning is needed: [`crate::quantise::quantise`] welds equal positions and drops unused vertices and faces
/// with a repeated vertex.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SourceMesh {
    /// Positions in the asset's units.
    pub positions: Vec<[f64; 3]>,
    /// Texture coordinates, `v` up as in OBJ; may be empty.
    pub uvs: Vec<[f32; 2]>,
    /// A second set of texture coordinates, such as of lightmaps, `v` up; may be empty.
    pub second_uvs: Vec<[f32; 2]>,
    /// Unit normals; may be empty. They determine the normal groups (creases), and are stored only where they differ
    /// from the computed ones ([`crate::quantise::QuantiseSettings::normal_tolerance`]).
    pub normals: Vec<[f32; 3]>,
    /// Colours; see [`Attributes::color`]. May be empty.
    pub colors: Vec<[u8; 4]>,
    /// Triangles, counter-clockwise seen from outside.
    pub faces: Vec<[Corner; 3]>,
    /// Material index of each face; as long as `faces`.
    pub materials: Vec<u16>,
    /// Part of each face: a number that stays with the face at every level, for example that of an object that was
    /// joined with others. Faces of different parts share no vertex. Empty if the mesh is one part.
    pub parts: Vec<u32>,
    /// Which joints move each position; empty if none do. Equal positions with different skins are different vertices.
    pub skins: Vec<Skin>,
    /// Poses in which the error of skins is measured, each with a map per joint, in the asset's units; may be empty.
    pub poses: Vec<Pose>,
}

/// Which attributes an asset has.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Kinds {
    /// Bits per axis of texture coordinates, 0 for none.
    pub(crate) uv_bits: u8,
    /// Bits per axis of the second set of texture coordinates, 0 for none.
    pub(crate) second_uv_bits: u8,
    pub(crate) colors: bool,
    pub(crate) normals: bool,
    /// Whether joints move vertices.
    pub(crate) skins: bool,
}

impl Kinds {
    /// Bits per axis of a set of texture coordinates: 0 for the first, else the second.
    pub(crate) fn uv_bits_of_set(self, set: usize) -> u8 {
        if set == 0 { self.uv_bits } else { self.second_uv_bits }
    }
}

/// Bits per axis of an [`Attributes::normal`].
pub const NORMAL_BITS: u8 = 10;
/// The colour of wedges without colour: opaque white, neutral in multiplication.
pub const NO_COLOR: [u8; 4] = [255; 4];

/// The attributes of a wedge.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Attributes {
    /// Texture coordinates on the uv grid.
    pub uv: [i32; 2],
    /// Normal group, numbered within the vertex: corners of one group share a normal.
    pub group: u32,
    /// Red, green and blue in sRGB (IEC 61966-2-1), opacity linear; [`NO_COLOR`] if the source has none. Multiplies
    /// the material's colour. sRGB, because 8-bit linear values would show bands in dark colours.
    pub color: [u8; 4],
    /// The explicit normal on the octahedral map ([`crate::mesh::octahedral`]), [`NORMAL_BITS`] per axis, if it
    /// differs from the computed one; else `None`.
    pub normal: Option<[u16; 2]>,
    /// The second set of texture coordinates, on its grid; 0 if the asset has none.
    pub second_uv: [u16; 2],
}

impl Default for Attributes {
    fn default() -> Self {
        Self { uv: [0; 2], group: 0, color: NO_COLOR, normal: None, second_uv: [0; 2] }
    }
}

impl Attributes {
    /// A set of texture coordinates on its grid: 0 for the first, else the second.
    #[inline]
    pub(crate) fn uv_of_set(&self, set: usize) -> [i32; 2] {
        if set == 0 { self.uv } else { self.second_uv.map(i32::from) }
    }
}

/// One attribute tuple at a vertex.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Wedge {
    /// The vertex that the wedge belongs to.
    pub vertex: u32,
    /// Its attributes.
    pub attributes: Attributes,
}

/// A triangle: three wedges, counter-clockwise, and a material.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Face {
    /// Indices of wedges.
    pub wedges: [u32; 3],
    /// Index of the material.
    pub material: u16,
}

/// A uniform grid of positions: `position = origin + step × integer`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Grid {
    /// Position of the integer point (0, 0, 0), in the asset's units.
    pub origin: [f64; 3],
    /// Edge length of a cell, in the asset's units; the same on all axes.
    pub step: f64,
    /// Bits per axis: coordinates lie in `0..2^bits`.
    pub bits: u8,
}

impl Grid {
    /// The position of an integer point, in the asset's units.
    #[must_use]
    pub fn position(&self, q: [i32; 3]) -> [f64; 3] {
        [
            self.origin[0] + self.step * f64::from(q[0]),
            self.origin[1] + self.step * f64::from(q[1]),
            self.origin[2] + self.step * f64::from(q[2]),
        ]
    }
}

/// A grid of texture coordinates: `uv = origin + step × integer`, per axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct UvGrid {
    /// Texture coordinate of the integer point (0, 0).
    pub origin: [f64; 2],
    /// Size of a cell, per axis.
    pub step: [f64; 2],
    /// Bits per axis; 0 without texture coordinates.
    pub bits: u8,
}

impl UvGrid {
    /// The grid of an asset without texture coordinates.
    pub const NONE: Self = Self { origin: [0.0; 2], step: [0.0; 2], bits: 0 };

    /// The texture coordinate of an integer point.
    #[must_use]
    pub fn uv(&self, q: [i32; 2]) -> [f64; 2] {
        [self.origin[0] + self.step[0] * f64::from(q[0]), self.origin[1] + self.step[1] * f64::from(q[1])]
    }
}

/// A quantised mesh: the input of preparation, which a fully refined asset equals exactly.
///
/// Every vertex, wedge and position is used by at least one face; faces have three distinct vertices.
#[derive(Clone, Debug, PartialEq)]
pub struct QuantisedMesh {
    /// Grid of the positions.
    pub grid: Grid,
    /// Grid of the texture coordinates.
    pub uv_grid: UvGrid,
    /// Grid of the second set of texture coordinates.
    pub second_uv_grid: UvGrid,
    /// One integer position per vertex.
    pub positions: Vec<[i32; 3]>,
    /// Wedges; each names its vertex.
    pub wedges: Vec<Wedge>,
    /// Triangles.
    pub faces: Vec<Face>,
    /// Part of each vertex ([`SourceMesh::parts`]); empty if the mesh is one part.
    pub parts: Vec<u32>,
    /// The skin of each vertex; empty if no joints move them.
    pub skins: Vec<Skin>,
    /// [`SourceMesh::poses`], in grid cells.
    pub poses: Vec<Pose>,
}

impl QuantisedMesh {
    /// One more than the largest part; 1 if the mesh is one part.
    #[must_use]
    pub fn part_count(&self) -> u32 {
        self.parts.iter().max().map_or(1, |most| most + 1)
    }
}
