//! Data of a refined mesh for a renderer.

use crate::mesh::Wedge;
use crate::mesh::corner::{self, face_of, side_of};
use crate::mesh::octahedral;
use crate::mesh::skin::Skin;
use crate::mesh::vec3::{Vec3, add, length, triangle_normal};
use crate::numbers::{id32, nearest_f32};
use crate::refine::active::ActiveMesh;

/// The render data of one wedge.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RenderVertex {
    /// Position relative to [`crate::mesh::Grid::origin`], in the asset's units.
    pub position: [f32; 3],
    /// Unit normal; zero if the faces around have no area.
    pub normal: [f32; 3],
    /// Texture coordinates, `v` up.
    pub uv: [f32; 2],
    /// The second set of texture coordinates, `v` up; 0 unless [`ActiveMesh::has_second_uvs`].
    pub second_uv: [f32; 2],
    /// Colour; see [`crate::mesh::Attributes::color`].
    pub color: [u8; 4],
    /// Position before [`ActiveMesh::wedge_chunk`] was applied, relative like `position`.
    pub morph_from: [f32; 3],
    /// Whether all wedges of the vertex have this normal, so no crease runs through it.
    pub smooth: bool,
    /// The part that the vertex belongs to, below [`ActiveMesh::part_count`].
    pub part: u32,
    /// Which joints move the vertex; the default in an asset without skins.
    pub skin: Skin,
}

impl ActiveMesh {
    /// One more than the highest wedge slot in use.
    #[must_use]
    pub fn wedge_slots(&self) -> u32 {
        id32(self.wedges.len())
    }

    /// The number of materials.
    #[must_use]
    pub fn material_count(&self) -> u16 {
        u16::try_from(self.indices.len()).unwrap_or(u16::MAX)
    }

    /// The index list of a material: three wedge slots per face; unused entries are `[0, 0, 0]`. Empty for an unknown
    /// material.
    #[must_use]
    pub fn indices(&self, material: u16) -> &[[u32; 3]] {
        self.indices.get(usize::from(material)).map_or(&[], Vec::as_slice)
    }

    /// The chunk that added or last moved the vertex of a wedge slot; `None` for the base mesh.
    #[must_use]
    pub fn wedge_chunk(&self, slot: u32) -> Option<u32> {
        let vertex = self.wedges[slot as usize].vertex;
        self.vertex_mover[vertex as usize].checked_sub(1)
    }

    /// The bare surface: positions by vertex slot, relative to [`crate::mesh::Grid::origin`], and three position
    /// indices per face. Cost: one pass over vertices and faces.
    #[must_use]
    pub fn surface(&self) -> (Vec<[f32; 3]>, Vec<[u32; 3]>) {
        let step = self.grid.step;
        let positions = self.positions.iter().map(|q| q.map(|x| nearest_f32(f64::from(x) * step))).collect();
        let drawn = self.indices.iter().flatten().filter(|face| **face != [0; 3]);
        let faces = drawn.map(|face| face.map(|wedge| self.wedges[wedge as usize].vertex)).collect();
        (positions, faces)
    }

    /// The data of a wedge slot.
    ///
    /// The normal is the wedge's explicit one, else the area-weighted sum of the face normals over the corners at the
    /// vertex that share its normal group. Cost: at most one pass over the vertex's star.
    ///
    /// # Panics
    /// If the slot is not below [`Self::wedge_slots`].
    #[must_use]
    pub fn render_vertex(&self, slot: u32) -> RenderVertex {
        let wedge = self.wedges[slot as usize];
        let step = self.grid.step;
        let place = |q: [i32; 3]| q.map(|x| nearest_f32(f64::from(x) * step));
        let uv = self.uv_grid.uv(wedge.attributes.uv);
        let second_uv = self.second_uv_grid.uv(wedge.attributes.second_uv.map(i32::from));
        let (normal, smooth) = self.normal(wedge);
        RenderVertex {
            position: place(self.positions[wedge.vertex as usize]),
            normal: normal.map(nearest_f32),
            smooth,
            uv: uv.map(nearest_f32),
            second_uv: second_uv.map(nearest_f32),
            color: wedge.attributes.color,
            morph_from: place(self.morph_from[wedge.vertex as usize]),
            part: self.part(wedge.vertex),
            skin: self.skin(wedge.vertex).unwrap_or_default(),
        }
    }

    /// The unit normal of a wedge, or zero, and whether all wedges of its vertex have the same.
    fn normal(&self, wedge: Wedge) -> (Vec3, bool) {
        let mut smooth = true;
        if let Some(explicit) = wedge.attributes.normal {
            for corner in self.stars.corners(wedge.vertex) {
                let other = self.wedges[corner::at(&self.faces, corner) as usize];
                smooth &= other.attributes.normal == Some(explicit);
            }
            return (octahedral::decode(explicit), smooth);
        }
        let mut normal = [0.0; 3];
        for corner in self.stars.corners(wedge.vertex) {
            let face = self.faces[face_of(corner) as usize];
            let other = self.wedges[face[side_of(corner)] as usize].attributes;
            if other.group == wedge.attributes.group {
                let [a, b, c] = face.map(|w| self.cell(w));
                normal = add(normal, triangle_normal(a, b, c));
            }
            smooth &= other.group == wedge.attributes.group && other.normal.is_none();
        }
        let size = length(normal);
        (if size > 0.0 { normal.map(|x| x / size) } else { [0.0; 3] }, smooth)
    }

    /// Position of a wedge in grid cells.
    fn cell(&self, wedge: u32) -> Vec3 {
        self.positions[self.wedges[wedge as usize].vertex as usize].map(f64::from)
    }
}
