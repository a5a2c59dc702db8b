//! Applying chunks, undoing them, and raising them to a later truncation point.
//!
//! The mesh stores an undo record per chunk ([`Undo`]): the state of moved older vertices and the wedges of moved
//! older corners. Added elements are just removed. Records refer to slots, since elements that a chunk refers to
//! cannot be removed before the chunk.

use crate::asset::index::ChunkInfo;
use crate::mesh::Wedge;
use crate::mesh::corner::{corner, face_of, side_of};
use crate::numbers::id32;
use crate::refine::active::ActiveMesh;
use crate::refine::applied::{AppliedOwner, Undo, VertexState};
use crate::refine::delta::{ChunkDelta, Id, Origin};
use crate::refine::dirty_slots::DirtySlots;
use crate::refine::error::{ChunkError, RefineError};
use crate::refine::owners::Owners;

/// The state to restore if raising a chunk fails after it was removed.
struct Redo {
    /// In the order of [`Undo::vertices`].
    vertices: Vec<VertexState>,
    /// In the order of [`Undo::corners`].
    wedges: Vec<u32>,
}

/// Result of checking a delta.
struct Checked {
    /// Owners of the parents and of all older elements that the delta refers to, ascending; without the base mesh,
    /// which is always applied.
    needs: Vec<u32>,
    /// Corners that move (`face × 3 + k`), with their current wedges.
    corners: Vec<(u32, u32)>,
}

impl ActiveMesh {
    /// Applies a decoded chunk, whole or up to a truncation point. Its parents must be applied whole. The delta is
    /// not needed afterwards: [`Self::undo`] and [`Self::raise`] take the chunk's id.
    ///
    /// # Errors
    /// See [`RefineError`]; the mesh is then unchanged.
    pub fn apply(&mut self, delta: &ChunkDelta) -> Result<DirtySlots, RefineError> {
        let checked = self.may_apply(delta)?;
        Ok(self.insert(delta, checked))
    }

    /// Checks whether [`Self::apply`] would succeed.
    pub(crate) fn would_apply(&mut self, delta: &ChunkDelta) -> Result<(), RefineError> {
        self.may_apply(delta).map(drop)
    }

    /// Undoes an applied chunk; none of its children may be applied. Slots at the end are given up at once,
    /// others by [`Self::compact`].
    ///
    /// # Errors
    /// See [`RefineError`]; the mesh is then unchanged.
    pub fn undo(&mut self, chunk: u32) -> Result<DirtySlots, RefineError> {
        let (_, applied) = self.take_applied(chunk, false)?;
        let draws = self.take_out(&applied);
        self.release(applied);
        let mut touched = self.finish_touched(draws);
        self.give_up_slots(&mut touched);
        Ok(touched)
    }

    /// Raises a chunk that is applied up to a truncation point to another one, or to the whole chunk (`None`): undoes
    /// it, decodes it from `payload` as [`Self::decode_prefix`] does, and applies the result, as one change.
    ///
    /// # Errors
    /// If the chunk is not applied, or is whole, or cannot be decoded or applied; the mesh is then unchanged. A
    /// failure may mean that the prefix applied before was corrupt as well: to be safe, undo the chunk.
    pub fn raise(
        &mut self,
        chunk: u32,
        info: &ChunkInfo,
        truncation: Option<u8>,
        payload: &[u8],
    ) -> Result<DirtySlots, ChunkError> {
        let (owner, applied) = self.take_applied(chunk, true)?;
        let redo = self.redo(&applied.undo);
        let draws = self.take_out(&applied);
        let decoded = self.decode_prefix(chunk, info, truncation, payload);
        match decoded.and_then(|delta| Ok(self.may_apply(&delta).map(|checked| (delta, checked))?)) {
            Ok((delta, checked)) => {
                self.release(applied);
                let mut touched = self.finish_touched(draws);
                touched.merge(self.insert(&delta, checked));
                self.give_up_slots(&mut touched);
                Ok(touched)
            }
            Err(why) => {
                self.put_back(owner, applied, redo);
                Err(why)
            }
        }
    }

    /// Applies a delta that [`Self::may_apply`] accepted.
    fn insert(&mut self, delta: &ChunkDelta, checked: Checked) -> DirtySlots {
        let owner = delta.chunk + 1;
        let Checked { mut needs, corners } = checked;
        let vertices = if self.only_grows { Box::default() } else { self.moved_vertex_states(delta) };
        // Not only the parents: an incomplete parent list must not leave dangling references. A chunk that moves a
        // vertex again must be undone first.
        needs.extend(vertices.iter().map(|(_, was)| was.mover).filter(|&mover| mover != 0));
        needs.sort_unstable();
        needs.dedup();
        for &need in &needs {
            if let Some(applied) = self.applied.get_mut(need) {
                applied.children += 1;
            }
        }
        let materials: Vec<u16> = delta.faces.iter().map(|f| f.material).collect();
        self.reserve(owner, delta.vertices.len(), delta.wedges.len(), &materials);
        let faces = self.place_elements(owner, delta);
        for m in &delta.moves {
            // After the added vertices, whose origin is the position before the move.
            let state = VertexState { position: m.to, morph_from: m.from, shift: m.shifts[1], mover: owner };
            self.move_vertex(self.vertex_slot(m.vertex), state);
        }
        let own =
            self.applied.get(owner).map_or((0, 0), |applied| (applied.faces.start, applied.wedges.start));
        for (slot, wedges) in (own.0..).zip(faces) {
            self.put_face(slot, wedges);
            self.marks.faces.set(slot);
        }
        for (repoint, &(corner, _)) in delta.repoints.iter().zip(&corners) {
            self.move_corner(corner, own.1 + repoint.to.index);
            self.marks.faces.set(face_of(corner));
        }
        let corners = if self.only_grows { Box::default() } else { corners.into_boxed_slice() };
        let undo = Undo { vertices, corners };
        if let Some(applied) = self.applied.get_mut(owner) {
            applied.needs = needs;
            self.undo_bytes += undo.bytes();
            applied.undo = undo;
            applied.truncation = delta.truncation;
        }
        self.applied_chunks += 1;
        self.finish_touched(Vec::with_capacity(2 * delta.faces.len()))
    }

    /// Writes the vertices and wedges of a chunk to their slots; returns the wedge slots of its faces.
    fn place_elements(&mut self, owner: u32, delta: &ChunkDelta) -> Vec<[u32; 3]> {
        let mut owners = Owners::new(&self.applied);
        let start = |first: Option<u32>| first.unwrap_or(0);
        let first = start(owners.vertex(Id { owner, index: 0 }));
        for (slot, vertex) in (first..).zip(&delta.vertices) {
            self.positions[slot as usize] = vertex.position;
            self.vertex_shift[slot as usize] = vertex.shift;
            // A parent inside this chunk has a smaller index, so its ancestor is already known.
            let part;
            (self.morph_from[slot as usize], part) = match vertex.origin {
                Origin::Split(parent) if parent.owner == owner => {
                    let parent = first + parent.index;
                    (self.morph_from[parent as usize], self.part(parent))
                }
                Origin::Split(parent) => {
                    let parent = start(owners.vertex(parent));
                    (self.positions[parent as usize], self.part(parent))
                }
                Origin::Part(part) => (vertex.position, part),
            };
            if let Some(known) = self.parts.get_mut(slot as usize) {
                *known = part;
            }
            if let Some(known) = self.skins.get_mut(slot as usize) {
                *known = vertex.skin;
            }
        }
        let first = start(owners.wedge(Id { owner, index: 0 }));
        for (slot, wedge) in (first..).zip(&delta.wedges) {
            self.wedges[slot as usize] =
                Wedge { vertex: start(owners.vertex(wedge.vertex)), attributes: wedge.attributes };
        }
        delta.faces.iter().map(|face| face.wedges.map(|wedge| start(owners.wedge(wedge)))).collect()
    }

    /// The states of older vertices that the delta moves, for the undo record.
    fn moved_vertex_states(&self, delta: &ChunkDelta) -> Box<[(u32, VertexState)]> {
        let states = delta.moves.iter().map(|m| {
            let slot = self.vertex_slot(m.vertex);
            let position = self.positions[slot as usize];
            // Undone moves do not morph: the position is final at once.
            (slot, VertexState { morph_from: position, ..self.vertex_state(slot) })
        });
        states.collect()
    }

    /// The current state of the vertices and corners that an undo record restores.
    fn redo(&self, undo: &Undo) -> Redo {
        Redo {
            vertices: undo.vertices.iter().map(|&(slot, _)| self.vertex_state(slot)).collect(),
            wedges: undo.corners.iter().map(|&(corner, _)| self.corner_wedge(corner)).collect(),
        }
    }

    /// Removes a chunk's elements and changes from the mesh; its slots and dependencies stay reserved. Marks the
    /// touched elements, and returns the index entries of the removed faces.
    fn take_out(&mut self, applied: &AppliedOwner) -> Vec<(u16, u32)> {
        let mut draws = Vec::with_capacity(2 * applied.faces.len());
        for slot in applied.faces.clone() {
            for k in 0..3 {
                let vertex = self.wedges[self.faces[slot as usize][k] as usize].vertex;
                self.stars.remove(vertex, corner(slot, k));
                self.marks.vertices.set(vertex);
            }
            let (material, draw) = (self.materials[slot as usize], self.draw_slots[slot as usize]);
            self.indices[usize::from(material)][draw as usize] = [0; 3];
            draws.push((material, draw));
        }
        for &(corner, wedge) in &applied.undo.corners {
            self.move_corner(corner, wedge);
            self.marks.faces.set(face_of(corner));
        }
        for &(slot, state) in &applied.undo.vertices {
            self.move_vertex(slot, state);
        }
        draws
    }

    /// Reverts [`Self::take_out`].
    fn put_back(&mut self, owner: u32, applied: AppliedOwner, redo: Redo) {
        for (&(slot, _), state) in applied.undo.vertices.iter().zip(redo.vertices) {
            self.move_vertex(slot, state);
        }
        for (&(corner, _), wedge) in applied.undo.corners.iter().zip(redo.wedges) {
            self.move_corner(corner, wedge);
        }
        for slot in applied.faces.clone() {
            self.put_face(slot, self.faces[slot as usize]);
        }
        self.applied.insert(owner, applied);
        // The mesh is as before, so no slots are dirty.
        self.finish_touched(Vec::new());
    }

    /// Releases the slots and dependencies of a removed chunk.
    fn release(&mut self, applied: AppliedOwner) {
        for &need in &applied.needs {
            if let Some(applied) = self.applied.get_mut(need) {
                applied.children -= 1;
            }
        }
        self.undo_bytes -= applied.undo.bytes();
        self.live_faces -= applied.faces.len();
        self.live_vertices -= applied.vertices.len();
        self.applied_chunks -= 1;
        // Free wedges name a vertex that exists as long as there are wedges.
        self.wedges[applied.wedges.start as usize..applied.wedges.end as usize].fill(Wedge::default());
        self.vertex_slots.give_back(applied.vertices);
        self.wedge_slots.give_back(applied.wedges);
        self.face_slots.give_back(applied.faces);
        for (material, range) in applied.draws {
            self.index_slots[usize::from(material)].give_back(range);
        }
    }

    /// Removes the record of a chunk that may be undone (with `raised`: that is not whole), and returns it with its
    /// owner id.
    fn take_applied(&mut self, chunk: u32, raised: bool) -> Result<(u32, AppliedOwner), RefineError> {
        let not_applied = RefineError::NotApplied(chunk);
        let owner = chunk.checked_add(1).ok_or(not_applied.clone())?;
        match self.applied.get(owner) {
            None => return Err(not_applied),
            Some(_) if self.only_grows => return Err(RefineError::OnlyGrows(chunk)),
            Some(applied) if raised && applied.truncation.is_none() => {
                return Err(RefineError::AlreadyApplied(chunk));
            }
            Some(&AppliedOwner { children: children @ 1.., .. }) => {
                return Err(RefineError::HasChildren { chunk, children });
            }
            Some(_) => {}
        }
        self.applied.remove(owner).map(|applied| (owner, applied)).ok_or(not_applied)
    }

    fn may_apply(&mut self, delta: &ChunkDelta) -> Result<Checked, RefineError> {
        let chunk = delta.chunk;
        let count = id32(self.applied.len()) - 1;
        if chunk >= count {
            return Err(RefineError::NoSuchChunk { chunk, count });
        }
        if self.is_applied(chunk) {
            return Err(RefineError::AlreadyApplied(chunk));
        }
        for &parent in &delta.parents {
            if parent == chunk || !self.is_applied(parent) {
                return Err(RefineError::MissingParent { chunk, parent });
            }
        }
        let checked = self.resolve(delta).ok_or(RefineError::Mismatch(chunk))?;
        // Not only the parents, as in `insert`.
        if let Some(need) = checked.needs.iter().find(|&need| self.applied_truncation(need - 1).is_some()) {
            return Err(RefineError::PartialParent { chunk, parent: need - 1 });
        }
        if self.moves_corners_once(&checked.corners) {
            Ok(checked)
        } else {
            Err(RefineError::Mismatch(chunk))
        }
    }

    /// Whether each corner is moved at most once; the corners must exist. Marks them temporarily, which is cheaper
    /// than sorting.
    fn moves_corners_once(&mut self, corners: &[(u32, u32)]) -> bool {
        const MARK: u32 = u32::MAX;
        let mut marked = 0;
        for &(corner, _) in corners {
            let at = &mut self.faces[face_of(corner) as usize][side_of(corner)];
            if *at == MARK {
                break;
            }
            *at = MARK;
            marked += 1;
        }
        for &(corner, wedge) in &corners[..marked] {
            self.faces[face_of(corner) as usize][side_of(corner)] = wedge;
        }
        marked == corners.len()
    }

    /// The elements that the delta refers to, if all of them exist or are its own.
    fn resolve(&self, delta: &ChunkDelta) -> Option<Checked> {
        let own = delta.chunk + 1;
        // An id of its own that is out of range has no record.
        let mut owners = Owners::new(&self.applied);
        let (vertices, wedges) = (delta.vertices.len(), delta.wedges.len());
        let is_own = |id: Id, count: usize| id.owner == own && (id.index as usize) < count;
        for (i, vertex) in delta.vertices.iter().enumerate() {
            match vertex.origin {
                Origin::Split(parent) if is_own(parent, i) => {}
                Origin::Split(parent) => _ = owners.vertex(parent)?,
                Origin::Part(part) if part < self.part_count => {}
                Origin::Part(_) => return None,
            }
        }
        for wedge in delta.wedges.iter().filter(|wedge| !is_own(wedge.vertex, vertices)) {
            owners.vertex(wedge.vertex)?;
        }
        for face in &delta.faces {
            for wedge in face.wedges.into_iter().filter(|&wedge| !is_own(wedge, wedges)) {
                owners.wedge(wedge)?;
            }
            if usize::from(face.material) >= self.indices.len() {
                return None;
            }
        }
        if !delta.moves.is_sorted_by(|a, b| a.vertex < b.vertex) {
            return None;
        }
        for m in &delta.moves {
            let slot = owners.vertex(m.vertex)?;
            if self.positions[slot as usize] != m.from {
                return None;
            }
        }
        let mut corners = Vec::with_capacity(delta.repoints.len());
        for r in &delta.repoints {
            // Corners move from existing wedges to wedges that the chunk adds. So a later move of the corner depends
            // on this chunk, and undoing the chunk leaves no corner at a removed wedge.
            let (face, from) = (owners.face(r.face)?, owners.wedge(r.from)?);
            if r.corner >= 3 || !is_own(r.to, wedges) {
                return None;
            }
            let corner = corner(face, r.corner.into());
            if self.corner_wedge(corner) != from {
                return None;
            }
            corners.push((corner, from));
        }
        let mut needs: Vec<u32> = delta.parents.iter().map(|p| p + 1).chain(owners.named).collect();
        needs.retain(|&need| need != 0);
        needs.sort_unstable();
        needs.dedup();
        Some(Checked { needs, corners })
    }
}
