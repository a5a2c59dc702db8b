//! Vertex layout: 52 bytes per wedge slot.

use bytemuck::{Pod, Zeroable};
pub use lodestream_geometry::base::MAX_PARTS;

const LEVEL_BITS: u32 = 8;
const MAX_LEVEL: u32 = (1 << LEVEL_BITS) - 1;
/// `NUMBERED` of `attributes.wgsl`: the number is that of attributes beside the vertex.
const NUMBERED: u32 = 1 << 31;
/// Most such numbers of an asset's vertices.
pub(crate) const MAX_NUMBERED: u32 = 1 << 23;

/// One wedge of an asset, ready for the GPU.
///
/// All wedges of one vertex must carry the same `position`, `morph_from` and `birth_s`, or the
/// surface would open along seams while it morphs.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct PackedVertex {
    /// Position relative to the asset's origin, in the asset's units.
    pub position: [f32; 3],
    /// Time at which the vertex appeared, in seconds of the clock of [`crate::Frame::time_s`].
    pub birth_s: f32,
    /// Position from which the vertex morphs after its birth; equal to `position` if it does not move.
    pub morph_from: [f32; 3],
    /// Part that the vertex belongs to or, with the highest bit, number of attributes that are not here, shifted by 8 bits,
    /// and the level of refinement that brought it; see [`PackedVertex::of_part`] and [`PackedVertex::at_level`].
    pub part_and_level: u32,
    /// Texture coordinates, `v` up as in OBJ.
    pub uv: [f32; 2],
    /// Unit normal as signed 16-bit fractions. The fourth is not 0 if all wedges of the vertex have this normal, so
    /// that no crease runs through it ([`PackedVertex::smooth`]).
    pub normal: [i16; 4],
    /// Colour, sRGB-encoded, with opacity; multiplies the material's.
    pub colour: [u8; 4],
}

impl PackedVertex {
    /// A white vertex without morph: `morph_from = position`, born at time 0, level 0, part 0.
    #[must_use]
    pub fn new(position: [f32; 3], normal: [f32; 3], uv: [f32; 2]) -> Self {
        let (normal, colour) = (pack_normal(normal), [255; 4]);
        Self { position, morph_from: position, normal, uv, colour, ..Self::default() }
    }

    /// The same vertex, moving from `from` to its position after `birth_s`.
    #[must_use]
    pub fn morphing(self, from: [f32; 3], birth_s: f32) -> Self {
        Self { morph_from: from, birth_s, ..self }
    }

    /// The same vertex in another colour, sRGB-encoded.
    #[must_use]
    pub fn coloured(self, colour: [u8; 4]) -> Self {
        Self { colour, ..self }
    }

    /// The same vertex, marked as smooth: every wedge of it has this normal. PN triangles bend at smooth
    /// vertices only; marking only some wedges of a vertex opens the surface along the crease.
    #[must_use]
    pub fn smooth(mut self) -> Self {
        self.normal[3] = i16::MAX;
        self
    }

    /// The same vertex, marked with a level of refinement (0 = base mesh, at most 255), for
    /// [`crate::DebugView::Level`].
    #[must_use]
    pub fn at_level(self, level: u32) -> Self {
        Self { part_and_level: self.part_and_level & !MAX_LEVEL | level.min(MAX_LEVEL), ..self }
    }

    /// The same vertex, in a part of its asset below [`crate::MAX_PARTS`]. All corners of a face must have the same.
    #[must_use]
    pub fn of_part(self, part: u32) -> Self {
        Self { part_and_level: self.level() | part.min(MAX_PARTS - 1) << LEVEL_BITS, ..self }
    }

    /// The same vertex with the number of attributes that are not here, among them its part.
    #[must_use]
    pub(crate) fn numbered(self, number: u32) -> Self {
        let number = number.min(MAX_NUMBERED - 1);
        Self { part_and_level: self.level() | number << LEVEL_BITS | NUMBERED, ..self }
    }

    /// Level of refinement that brought the vertex.
    #[must_use]
    pub const fn level(&self) -> u32 {
        self.part_and_level & MAX_LEVEL
    }

    /// Part that the vertex belongs to, unless it has a number of attributes.
    #[must_use]
    pub const fn part(&self) -> u32 {
        if self.part_and_level & NUMBERED == 0 { self.part_and_level >> LEVEL_BITS } else { 0 }
    }
}

/// Vertices and faces of a mesh.
pub type HostMesh = (Vec<PackedVertex>, Vec<[u32; 3]>);

#[cfg(any(test, feature = "methods"))]
/// Marks all smooth vertices of a mesh: those whose coincident vertices, with equal `morph_from`, have equal normals.
/// Cost: one sort.
pub fn mark_smooth(vertices: &mut [PackedVertex]) {
    // Compare by value: −0 equals 0.
    let place = |v: &PackedVertex| [v.position, v.morph_from].map(|p| p.map(|x| (x + 0.0).to_bits()));
    let normal = |v: &PackedVertex| [v.normal[0], v.normal[1], v.normal[2]];
    vertices.iter_mut().for_each(|vertex| vertex.normal[3] = 0);
    let mut order: Vec<usize> = (0..vertices.len()).collect();
    order.sort_by_key(|&i| place(&vertices[i]));
    let mut rest = order.as_slice();
    while let Some(&first) = rest.first() {
        let here = place(&vertices[first]);
        let (alike, others) = rest.split_at(rest.partition_point(|&i| place(&vertices[i]) <= here));
        rest = others;
        if alike.iter().all(|&i| normal(&vertices[i]) == normal(&vertices[first])) {
            alike.iter().for_each(|&i| vertices[i] = vertices[i].smooth());
        }
    }
}

/// Packs a normal into signed 16-bit fractions, with an error of about 0.002°. Components that are not finite become
/// 0, which the shader reads as "facing the eye".
#[must_use]
pub(crate) fn pack_normal(n: [f32; 3]) -> [i16; 4] {
    // `as` saturates and maps NaN to 0.
    let q = |x: f32| (x.clamp(-1.0, 1.0) * 32767.0).round() as i16;
    [q(n[0]), q(n[1]), q(n[2]), 0]
}

/// Layout of [`PackedVertex`] at shader locations 0 to 6.
pub(crate) const VERTEX_ATTRIBUTES: [wgpu::VertexAttribute; 7] = wgpu::vertex_attr_array![
    0 => Float32x3, 1 => Float32, 2 => Float32x3, 3 => Uint32, 4 => Float32x2, 5 => Snorm16x4, 6 => Unorm8x4
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn layout_matches_the_struct() {
        assert_eq!(size_of::<PackedVertex>(), 52);
        let offsets: Vec<u64> = VERTEX_ATTRIBUTES.iter().map(|a| a.offset).collect();
        assert_eq!(offsets, [0, 12, 16, 28, 32, 40, 48]);
    }

    #[test]
    fn part_and_level_are_independent() {
        let vertex = PackedVertex::default().at_level(300).of_part(MAX_PARTS - 1);
        assert_eq!((vertex.level(), vertex.part()), (255, MAX_PARTS - 1));
        let vertex = vertex.at_level(7);
        assert_eq!((vertex.level(), vertex.part()), (7, MAX_PARTS - 1));
        let vertex = vertex.of_part(3);
        assert_eq!((vertex.level(), vertex.part()), (7, 3));
        assert_eq!(vertex.of_part(u32::MAX).part(), MAX_PARTS - 1);
        let numbered = vertex.numbered(MAX_NUMBERED - 1);
        assert_eq!((numbered.level(), numbered.part(), numbered.part_and_level), (7, 0, 0xffff_ff07));
        assert_eq!(numbered.of_part(3), vertex);
    }

    #[test]
    fn a_vertex_is_smooth_where_all_that_lie_there_have_its_normal() {
        let at = |x: f32, normal| PackedVertex::new([x, 0.0, 0.0], normal, [x; 2]);
        let (up, side) = ([0.0, 1.0, 0.0], [1.0, 0.0, 0.0]);
        let mut vertices = [at(0.0, up), at(1.0, up), at(-0.0, up), at(1.0, side), at(2.0, side)];
        mark_smooth(&mut vertices);
        assert_eq!(vertices.map(|v| v.normal[3] != 0), [true, false, true, false, true]);
        assert_eq!(vertices[4], at(2.0, side).smooth());
    }

    #[test]
    fn normals_survive_packing() {
        assert_eq!(pack_normal([0.0, 1.0, -1.0]), [0, 32767, -32767, 0]);
        assert_eq!(pack_normal([f32::NAN, f32::INFINITY, 0.5]), [0, 32767, 16384, 0]);
    }
}
