//! The refined mesh, as a structure of arrays over slots. Chunks get slots when applied, so memory is proportional to
//! the applied part; ids stay canonical (see [`Id`]).

use crate::asset::base::Base;
use crate::entropy::Codec;
use crate::mesh::Kinds;
use crate::mesh::corner::{self, face_of, side_of};
use crate::mesh::skin::Skin;
use crate::mesh::stars::Stars;
use crate::mesh::{Grid, UvGrid, Wedge};
use crate::numbers::id32;
use crate::refine::applied::{AppliedOwner, AppliedOwners, Undo, VertexState};
use crate::refine::delta::Id;
use crate::refine::dirty_slots::DirtySlots;
use crate::refine::marks::TouchMarks;
use crate::refine::slots::Slots;

/// A base mesh refined by an ancestor-closed cut of chunks; chunks without applied children may be applied up to a
/// truncation point.
///
/// Memory ([`Self::bytes`]): about 85 to 148 bytes per face with all chunks applied (eleven meshes), depending on
/// spare capacity, plus 5 bytes per vertex for its mover. Undo records take 8 bytes per moved corner and 36 per moved
/// vertex; none in a mesh that only grows.
#[derive(Clone, Debug)]
pub struct ActiveMesh {
    pub(crate) grid: Grid,
    pub(crate) uv_grid: UvGrid,
    pub(crate) second_uv_grid: UvGrid,
    pub(crate) codec: Codec,
    pub(crate) kinds: Kinds,
    pub(crate) applied: AppliedOwners,
    pub(crate) positions: Vec<[i32; 3]>,
    /// Position of a vertex before the last chunk that added or moved it. For an added vertex: the position of its
    /// oldest ancestor outside the chunk.
    pub(crate) morph_from: Vec<[i32; 3]>,
    pub(crate) vertex_owner: Vec<u32>,
    /// The owner that set a vertex's position: the one that added it, or a chunk that moved it.
    pub(crate) vertex_mover: Vec<u32>,
    /// Known number of low bits of the position that are zero.
    pub(crate) vertex_shift: Vec<u8>,
    /// Part of a vertex; empty if the asset is one part.
    pub(crate) parts: Vec<u32>,
    /// Skin of a vertex; empty if the asset has none.
    pub(crate) skins: Vec<Skin>,
    pub(crate) part_count: u32,
    /// [`Base::shifts`].
    pub(crate) shifts: Vec<u8>,
    pub(crate) wedges: Vec<Wedge>,
    pub(crate) wedge_owner: Vec<u32>,
    pub(crate) faces: Vec<[u32; 3]>,
    pub(crate) face_owner: Vec<u32>,
    pub(crate) materials: Vec<u16>,
    /// Slot of each face in the index list of its material.
    pub(crate) draw_slots: Vec<u32>,
    /// Index lists, one per material; unused entries are `[0, 0, 0]`.
    pub(crate) indices: Vec<Vec<[u32; 3]>>,
    pub(crate) stars: Stars,
    pub(crate) vertex_slots: Slots,
    pub(crate) wedge_slots: Slots,
    pub(crate) face_slots: Slots,
    pub(crate) index_slots: Vec<Slots>,
    pub(crate) live_faces: usize,
    pub(crate) live_vertices: usize,
    pub(crate) applied_chunks: usize,
    /// Whether chunks cannot be undone; no undo records are stored then.
    pub(crate) only_grows: bool,
    /// Size of the undo records, in bytes.
    pub(crate) undo_bytes: usize,
    /// Slots touched by the change in progress; empty between changes.
    pub(crate) marks: TouchMarks,
}

impl ActiveMesh {
    /// The base mesh alone. `base` must have been decoded or prepared by this crate.
    #[must_use]
    pub fn new(base: &Base) -> Self {
        let materials = usize::from(base.material_count.max(1));
        let mut mesh = Self {
            grid: base.grid,
            uv_grid: base.uv_grid,
            second_uv_grid: base.second_uv_grid,
            codec: base.codec,
            kinds: base.kinds(),
            applied: AppliedOwners::new(base.chunk_count),
            positions: Vec::new(),
            morph_from: Vec::new(),
            vertex_owner: Vec::new(),
            vertex_mover: Vec::new(),
            vertex_shift: Vec::new(),
            parts: Vec::new(),
            skins: Vec::new(),
            part_count: base.part_count.max(1),
            shifts: base.shifts.clone(),
            wedges: Vec::new(),
            wedge_owner: Vec::new(),
            faces: Vec::new(),
            face_owner: Vec::new(),
            materials: Vec::new(),
            draw_slots: Vec::new(),
            indices: vec![Vec::new(); materials],
            stars: Stars::new(0, 0),
            vertex_slots: Slots::default(),
            wedge_slots: Slots::default(),
            face_slots: Slots::default(),
            index_slots: vec![Slots::default(); materials],
            live_faces: 0,
            live_vertices: 0,
            applied_chunks: 0,
            only_grows: false,
            undo_bytes: 0,
            marks: TouchMarks::default(),
        };
        mesh.reserve(
            0,
            base.positions.len(),
            base.wedges.len(),
            &base.faces.iter().map(|f| f.material).collect::<Vec<_>>(),
        );
        for (slot, &p) in base.positions.iter().enumerate() {
            mesh.positions[slot] = p;
            mesh.vertex_shift[slot] = base.shifts[0];
            mesh.morph_from[slot] = p;
        }
        if mesh.part_count > 1 {
            mesh.parts[..base.parts.len()].copy_from_slice(&base.parts);
        }
        if base.skinned {
            mesh.skins[..base.skins.len()].copy_from_slice(&base.skins);
        }
        mesh.wedges[..base.wedges.len()].copy_from_slice(&base.wedges);
        for (slot, face) in base.faces.iter().enumerate() {
            mesh.put_face(id32(slot), face.wedges);
        }
        mesh
    }

    /// The base mesh alone, without undo records: chunks cannot be undone or raised.
    #[must_use]
    pub fn growing(base: &Base) -> Self {
        Self { only_grows: true, ..Self::new(base) }
    }

    /// Grid of the positions.
    #[must_use]
    pub fn grid(&self) -> Grid {
        self.grid
    }

    /// Codec of its chunks.
    #[must_use]
    pub fn codec(&self) -> Codec {
        self.codec
    }

    /// Whether a chunk is applied, whole or up to a truncation point.
    #[must_use]
    pub fn is_applied(&self, chunk: u32) -> bool {
        chunk.checked_add(1).is_some_and(|owner| self.applied.get(owner).is_some())
    }

    /// The truncation point that a chunk is applied up to; `None` if it is whole or not applied.
    #[must_use]
    pub fn applied_truncation(&self, chunk: u32) -> Option<u8> {
        self.applied.get(chunk.checked_add(1)?)?.truncation
    }

    /// Number of parts; 1 for an asset that is not divided.
    #[must_use]
    pub fn part_count(&self) -> u32 {
        self.part_count
    }

    /// The part of a vertex slot.
    pub(crate) fn part(&self, vertex: u32) -> u32 {
        self.parts.get(vertex as usize).copied().unwrap_or(0)
    }

    /// The skin of a vertex slot, if joints move it.
    pub(crate) fn skin(&self, vertex: u32) -> Option<Skin> {
        self.skins.get(vertex as usize).copied()
    }

    /// Whether joints move its vertices.
    #[must_use]
    pub fn skinned(&self) -> bool {
        self.kinds.skins
    }

    /// Whether its wedges have a second set of texture coordinates.
    #[must_use]
    pub fn has_second_uvs(&self) -> bool {
        self.kinds.second_uv_bits > 0
    }

    /// Current number of faces.
    #[must_use]
    pub fn face_count(&self) -> usize {
        self.live_faces
    }

    /// Current number of vertices.
    #[must_use]
    pub fn vertex_count(&self) -> usize {
        self.live_vertices
    }

    /// Number of applied chunks.
    #[must_use]
    pub fn applied_count(&self) -> usize {
        self.applied_chunks
    }

    /// Memory held, in bytes, by capacity.
    #[must_use]
    pub fn bytes(&self) -> usize {
        self.positions.capacity() * 12
            + self.morph_from.capacity() * 12
            + self.vertex_shift.capacity()
            + self.parts.capacity() * 4
            + self.skins.capacity() * size_of::<Skin>()
            + (self.vertex_owner.capacity()
                + self.vertex_mover.capacity()
                + self.wedge_owner.capacity()
                + self.face_owner.capacity())
                * 4
            + self.wedges.capacity() * size_of::<Wedge>()
            + self.faces.capacity() * 12
            + self.materials.capacity() * 2
            + self.draw_slots.capacity() * 4
            + self.indices.iter().map(|i| i.capacity() * 12).sum::<usize>()
            + self.stars.bytes()
            + self.applied.bytes()
            + self.undo_bytes
            + self.marks.bytes()
    }

    pub(crate) fn reserve(&mut self, owner: u32, vertices: usize, wedges: usize, materials: &[u16]) {
        let applied = AppliedOwner {
            vertices: self.vertex_slots.take(id32(vertices)),
            wedges: self.wedge_slots.take(id32(wedges)),
            faces: self.face_slots.take(id32(materials.len())),
            draws: Vec::new(),
            truncation: None,
            children: 0,
            needs: Vec::new(),
            undo: Undo::default(),
        };
        let (v, w, f) = (
            self.vertex_slots.high() as usize,
            self.wedge_slots.high() as usize,
            self.face_slots.high() as usize,
        );
        grow(&mut self.positions, v, [0; 3]);
        grow(&mut self.morph_from, v, [0; 3]);
        grow(&mut self.vertex_owner, v, 0);
        grow(&mut self.vertex_mover, v, 0);
        grow(&mut self.vertex_shift, v, 0);
        if self.part_count > 1 {
            grow(&mut self.parts, v, 0);
        }
        if self.kinds.skins {
            grow(&mut self.skins, v, Skin::default());
        }
        grow(&mut self.wedges, w, Wedge::default());
        grow(&mut self.wedge_owner, w, 0);
        grow(&mut self.faces, f, [0; 3]);
        grow(&mut self.face_owner, f, 0);
        grow(&mut self.materials, f, 0);
        grow(&mut self.draw_slots, f, 0);
        self.stars.grow(v, f);
        self.marks.vertices.grow(v);
        self.marks.wedges.grow(w);
        self.marks.faces.grow(f);
        for slot in applied.vertices.clone() {
            self.vertex_owner[slot as usize] = owner;
            self.vertex_mover[slot as usize] = owner;
            self.stars.clear(slot);
        }
        for slot in applied.wedges.clone() {
            self.wedge_owner[slot as usize] = owner;
        }
        let mut order: Vec<(u16, u32)> = materials.iter().copied().zip(applied.faces.clone()).collect();
        order.sort_unstable();
        let mut draws = Vec::new();
        for run in order.chunk_by(|a, b| a.0 == b.0) {
            let material = run[0].0;
            let list = usize::from(material);
            let range = self.index_slots[list].take(id32(run.len()));
            let high = self.index_slots[list].high() as usize;
            grow(&mut self.indices[list], high, [0; 3]);
            for (&(_, face), draw) in run.iter().zip(range.clone()) {
                self.draw_slots[face as usize] = draw;
                self.materials[face as usize] = material;
                self.face_owner[face as usize] = owner;
            }
            draws.push((material, range));
        }
        self.live_vertices += vertices;
        self.live_faces += materials.len();
        self.applied.insert(owner, AppliedOwner { draws, ..applied });
    }

    pub(crate) fn put_face(&mut self, slot: u32, wedges: [u32; 3]) {
        self.faces[slot as usize] = wedges;
        for (k, wedge) in wedges.into_iter().enumerate() {
            self.stars.insert(self.wedges[wedge as usize].vertex, corner::corner(slot, k));
        }
        let list = usize::from(self.materials[slot as usize]);
        self.indices[list][self.draw_slots[slot as usize] as usize] = wedges;
    }

    pub(crate) fn vertex_state(&self, slot: u32) -> VertexState {
        let at = slot as usize;
        VertexState {
            position: self.positions[at],
            morph_from: self.morph_from[at],
            shift: self.vertex_shift[at],
            mover: self.vertex_mover[at],
        }
    }

    pub(crate) fn move_vertex(&mut self, slot: u32, to: VertexState) {
        let at = slot as usize;
        self.positions[at] = to.position;
        self.morph_from[at] = to.morph_from;
        self.vertex_shift[at] = to.shift;
        self.vertex_mover[at] = to.mover;
        for corner in self.stars.corners(slot) {
            self.marks.faces.set(face_of(corner));
        }
    }

    /// The wedge at a corner (`face × 3 + k`).
    pub(crate) fn corner_wedge(&self, corner: u32) -> u32 {
        corner::at(&self.faces, corner)
    }

    pub(crate) fn move_corner(&mut self, corner: u32, to: u32) {
        let (face, k) = (face_of(corner) as usize, side_of(corner));
        let from = std::mem::replace(&mut self.faces[face][k], to);
        let (old, new) = (self.wedges[from as usize].vertex, self.wedges[to as usize].vertex);
        self.stars.remove(old, corner);
        self.stars.insert(new, corner);
        let list = usize::from(self.materials[face]);
        self.indices[list][self.draw_slots[face] as usize][k] = to;
    }

    /// The dirty slots of a change: the given index entries and those of the marked faces, and all wedges at the
    /// marked vertices and at the vertices of marked faces, since their normals may have changed.
    pub(crate) fn finish_touched(&mut self, mut draws: Vec<(u16, u32)>) -> DirtySlots {
        let TouchMarks { faces, vertices, wedges } = &mut self.marks;
        faces.drain(|face| {
            draws.push((self.materials[face as usize], self.draw_slots[face as usize]));
            for wedge in self.faces[face as usize] {
                vertices.set(self.wedges[wedge as usize].vertex);
            }
        });
        vertices.drain(|vertex| {
            // Usually all corners of a vertex have one wedge.
            let mut last = None;
            for corner in self.stars.corners(vertex) {
                let wedge = corner::at(&self.faces, corner);
                if last != Some(wedge) {
                    wedges.set(wedge);
                    last = Some(wedge);
                }
            }
        });
        let mut touched = DirtySlots { wedges: Vec::with_capacity(draws.len()), draws };
        wedges.drain(|wedge| touched.wedges.push(wedge));
        // Runs are mostly sorted, which a stable sort exploits.
        touched.draws.sort();
        touched.draws.dedup();
        touched
    }

    pub(crate) fn applied_owner(&self, owner: u32) -> Option<&AppliedOwner> {
        self.applied.get(owner)
    }

    /// The slot of a vertex; 0 if its owner is not applied.
    pub(crate) fn vertex_slot(&self, id: Id) -> u32 {
        self.applied_owner(id.owner).map_or(0, |p| p.vertices.start + id.index)
    }

    pub(crate) fn wedge_slot(&self, id: Id) -> u32 {
        self.applied_owner(id.owner).map_or(0, |p| p.wedges.start + id.index)
    }

    pub(crate) fn face_slot(&self, id: Id) -> u32 {
        self.applied_owner(id.owner).map_or(0, |p| p.faces.start + id.index)
    }

    /// Ids of slots that are in use.
    pub(crate) fn vertex_id(&self, slot: u32) -> Id {
        let owner = self.vertex_owner[slot as usize];
        Id { owner, index: slot - self.applied_owner(owner).map_or(slot, |p| p.vertices.start) }
    }

    pub(crate) fn wedge_id(&self, slot: u32) -> Id {
        let owner = self.wedge_owner[slot as usize];
        Id { owner, index: slot - self.applied_owner(owner).map_or(slot, |p| p.wedges.start) }
    }
}

fn grow<T: Clone>(list: &mut Vec<T>, count: usize, value: T) {
    if list.len() < count {
        list.resize(count, value);
    }
}
