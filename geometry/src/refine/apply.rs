//! Applying chunks, undoing them, and taking them on from stop to stop.
//!
//! The mesh keeps what undoing a chunk puts back ([`Undo`]): of older vertices where they were, of older corners the
//! wedge they were at. What the chunk brought only goes. Both are kept by slot, since what a chunk refers to cannot go
//! before the chunk does.

use std::ops::Range;

use crate::asset::index::ChunkInfo;
use crate::mesh::Wedge;
use crate::mesh::corner::{corner, face_of};
use crate::refine::active::ActiveMesh;
use crate::refine::delta::{ChunkDelta, Id, Repoint};
use crate::refine::error::{ChunkError, RefineError};
use crate::refine::places::{Place, Undo, VertexState};
use crate::refine::render::Touched;

/// What taking a chunk out undoes, so that it can be put back where it was.
struct Forward {
    /// In the order of [`Undo::vertices`].
    vertices: Vec<VertexState>,
    /// In the order of [`Undo::corners`].
    wedges: Vec<u32>,
}

impl ActiveMesh {
    /// Applies a decoded chunk, or its beginning up to a stop, once its parents are applied whole. The delta is not
    /// needed afterwards: [`Self::undo`] and [`Self::raise`] take the chunk's id.
    ///
    /// # Errors
    /// See [`RefineError`]; the mesh is then unchanged.
    pub fn apply(&mut self, delta: &ChunkDelta) -> Result<Touched, RefineError> {
        self.may_apply(delta)?;
        Ok(self.insert(delta))
    }

    /// Undoes an applied chunk none of whose children is applied.
    ///
    /// # Errors
    /// See [`RefineError`]; the mesh is then unchanged.
    pub fn undo(&mut self, chunk: u32) -> Result<Touched, RefineError> {
        let (_, place) = self.take_place(chunk, false)?;
        let mut touched = self.take_out(&place);
        self.release(place);
        self.finish_touched(&mut touched);
        Ok(touched)
    }

    /// Takes a chunk that is applied up to a stop on to another, or to the whole (`None`): undoes it, decodes it from
    /// `payload` as [`Self::decode_prefix`] does, and applies that. What changed in between counts as one change.
    ///
    /// # Errors
    /// If the chunk is not applied, or is whole, or cannot be decoded or applied so; the mesh is then unchanged. That
    /// its beginning could be used does not show that it was sound: who mistrusts both undoes the chunk.
    pub fn raise(
        &mut self,
        chunk: u32,
        info: &ChunkInfo,
        stop: Option<u8>,
        payload: &[u8],
    ) -> Result<Touched, ChunkError> {
        let (owner, place) = self.take_place(chunk, true)?;
        let forward = self.forward(&place.undo);
        let mut touched = self.take_out(&place);
        let decoded = self.decode_prefix(chunk, info, stop, payload);
        match decoded.and_then(|delta| Ok(self.may_apply(&delta).map(|()| delta)?)) {
            Ok(delta) => {
                self.release(place);
                self.finish_touched(&mut touched);
                touched.merge(self.insert(&delta));
                Ok(touched)
            }
            Err(why) => {
                self.put_back(owner, place, forward);
                Err(why)
            }
        }
    }

    /// Applies what [`Self::may_apply`] has let pass.
    fn insert(&mut self, delta: &ChunkDelta) -> Touched {
        let owner = delta.chunk + 1;
        let undo = if self.only_grows { Undo::default() } else { self.before(delta) };
        // Not the parents alone: an index that names too few must not make references dangle.
        let mut needs = delta.needs();
        // What moves a vertex on can be undone only first.
        needs.extend(undo.vertices.iter().map(|(_, was)| was.mover).filter(|&mover| mover != 0));
        needs.sort_unstable();
        needs.dedup();
        for &need in &needs {
            if let Some(place) = self.places.get_mut(need) {
                place.children += 1;
            }
        }
        let materials: Vec<u16> = delta.faces.iter().map(|f| f.material).collect();
        self.reserve(owner, delta.vertices.len(), delta.wedges.len(), &materials);
        let place = self.places.get(owner).cloned().unwrap_or_default();
        for (slot, vertex) in place.vertices.clone().zip(&delta.vertices) {
            self.positions[slot as usize] = vertex.position;
            self.vertex_shift[slot as usize] = vertex.shift;
            // A parent inside this chunk has a smaller index, so its ancestor is already known.
            self.morph_from[slot as usize] = match vertex.parent {
                Some(parent) if parent.owner == owner => {
                    self.morph_from[(place.vertices.start + parent.index) as usize]
                }
                Some(parent) => self.positions[self.vertex_slot(parent) as usize],
                None => vertex.position,
            };
        }
        for (slot, wedge) in place.wedges.clone().zip(&delta.wedges) {
            self.wedges[slot as usize] =
                Wedge { vertex: self.vertex_slot(wedge.vertex), attributes: wedge.attributes };
        }
        let mut touched = Touched::default();
        for m in &delta.moves {
            // After the new vertices, which come from where it was.
            let state = VertexState { position: m.to, morph_from: m.from, shift: m.shifts[1], mover: owner };
            self.move_vertex(self.vertex_slot(m.vertex), state, &mut touched);
        }
        for (slot, face) in place.faces.clone().zip(&delta.faces) {
            self.put_face(slot, face.wedges.map(|w| self.wedge_slot(w)));
            touched.face(slot);
        }
        for repoint in &delta.repoints {
            let corner = self.corner_slot(repoint);
            self.move_corner(corner, self.wedge_slot(repoint.to));
            touched.face(face_of(corner));
        }
        if let Some(place) = self.places.get_mut(owner) {
            place.needs = needs;
            self.undo_bytes += undo.bytes();
            place.undo = undo;
            place.stop = delta.stop;
        }
        self.applied_chunks += 1;
        self.finish_touched(&mut touched);
        touched
    }

    /// What undoing the delta puts back.
    fn before(&self, delta: &ChunkDelta) -> Undo {
        let vertices = delta.moves.iter().map(|m| {
            let slot = self.vertex_slot(m.vertex);
            let position = self.positions[slot as usize];
            // Nothing morphs back: what was undone is where it is at once.
            (slot, VertexState { morph_from: position, ..self.vertex_state(slot) })
        });
        let corners = delta.repoints.iter().map(|r| (self.corner_slot(r), self.wedge_slot(r.from)));
        Undo { vertices: vertices.collect(), corners: corners.collect() }
    }

    /// How the vertices and corners that undoing puts back are now.
    fn forward(&self, undo: &Undo) -> Forward {
        Forward {
            vertices: undo.vertices.iter().map(|&(slot, _)| self.vertex_state(slot)).collect(),
            wedges: undo.corners.iter().map(|&(corner, _)| self.corner_wedge(corner)).collect(),
        }
    }

    /// Takes what a chunk brought and changed out of the mesh; its slots stay reserved, and what it needs stays needed.
    fn take_out(&mut self, place: &Place) -> Touched {
        let mut touched = Touched::default();
        for slot in place.faces.clone() {
            for k in 0..3 {
                let vertex = self.wedges[self.faces[slot as usize][k] as usize].vertex;
                self.stars.remove(vertex, corner(slot, k));
                touched.vertex(vertex);
            }
            let (material, draw) = (self.materials[slot as usize], self.draw_slots[slot as usize]);
            self.indices[usize::from(material)][draw as usize] = [0; 3];
            touched.draws.push((material, draw));
        }
        for &(corner, wedge) in &place.undo.corners {
            self.move_corner(corner, wedge);
            touched.face(face_of(corner));
        }
        for &(slot, state) in &place.undo.vertices {
            self.move_vertex(slot, state, &mut touched);
        }
        touched
    }

    /// Puts back what [`Self::take_out`] took, where it was.
    fn put_back(&mut self, owner: u32, place: Place, forward: Forward) {
        // Who looks again finds what he has.
        let mut unchanged = Touched::default();
        for (&(slot, _), state) in place.undo.vertices.iter().zip(forward.vertices) {
            self.move_vertex(slot, state, &mut unchanged);
        }
        for (&(corner, _), wedge) in place.undo.corners.iter().zip(forward.wedges) {
            self.move_corner(corner, wedge);
        }
        for slot in place.faces.clone() {
            self.put_face(slot, self.faces[slot as usize]);
        }
        self.places.insert(owner, place);
    }

    /// Gives back what a chunk that was taken out held.
    fn release(&mut self, place: Place) {
        for &need in &place.needs {
            if let Some(place) = self.places.get_mut(need) {
                place.children -= 1;
            }
        }
        self.undo_bytes -= place.undo.bytes();
        self.live_faces -= place.faces.len();
        self.live_vertices -= place.vertices.len();
        self.applied_chunks -= 1;
        self.vertex_slots.give_back(place.vertices);
        self.wedge_slots.give_back(place.wedges);
        self.face_slots.give_back(place.faces);
        for (material, range) in place.draws {
            self.index_slots[usize::from(material)].give_back(range);
        }
    }

    /// The owner and the place of a chunk that may be undone (`raised`: and that is not whole), which is then no longer
    /// applied.
    fn take_place(&mut self, chunk: u32, raised: bool) -> Result<(u32, Place), RefineError> {
        let not_applied = RefineError::NotApplied(chunk);
        let owner = chunk.checked_add(1).ok_or(not_applied.clone())?;
        match self.places.get(owner) {
            None => return Err(not_applied),
            Some(_) if self.only_grows => return Err(RefineError::OnlyGrows(chunk)),
            Some(place) if raised && place.stop.is_none() => return Err(RefineError::AlreadyApplied(chunk)),
            Some(&Place { children: children @ 1.., .. }) => {
                return Err(RefineError::HasChildren { chunk, children });
            }
            Some(_) => {}
        }
        self.places.remove(owner).map(|place| (owner, place)).ok_or(not_applied)
    }

    fn may_apply(&mut self, delta: &ChunkDelta) -> Result<(), RefineError> {
        let chunk = delta.chunk;
        let count = self.places.len() as u32 - 1;
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
        if !self.fits(delta) {
            return Err(RefineError::Mismatch(chunk));
        }
        // Not the parents alone, for the reason given in `insert`.
        if let Some(need) = delta.needs().into_iter().find(|&need| self.applied_stop(need - 1).is_some()) {
            return Err(RefineError::PartialParent { chunk, parent: need - 1 });
        }
        if self.moves_corners_once(&delta.repoints) { Ok(()) } else { Err(RefineError::Mismatch(chunk)) }
    }

    /// Whether no corner is moved twice; the corners must be there. Marks them for the moment, which
    /// costs less than sorting them.
    fn moves_corners_once(&mut self, repoints: &[Repoint]) -> bool {
        const MARK: u32 = u32::MAX;
        let mut before = Vec::with_capacity(repoints.len());
        for r in repoints {
            let (face, k) = (self.face_slot(r.face) as usize, usize::from(r.corner));
            let corner = std::mem::replace(&mut self.faces[face][k], MARK);
            if corner == MARK {
                break;
            }
            before.push((face, k, corner));
        }
        for &(face, k, corner) in &before {
            self.faces[face][k] = corner;
        }
        before.len() == repoints.len()
    }

    /// Whether everything that the delta refers to is there, or is its own.
    fn fits(&self, delta: &ChunkDelta) -> bool {
        let own = delta.chunk + 1;
        let known = |id: Id, count: usize, range: fn(&Place) -> &Range<u32>| {
            if id.owner == own {
                (id.index as usize) < count
            } else {
                self.place(id.owner).is_some_and(|p| (id.index as usize) < range(p).len())
            }
        };
        let wedge = |id: Id| known(id, delta.wedges.len(), |p| &p.wedges);
        delta.vertices.iter().enumerate().all(|(i, v)| {
            v.parent.is_none_or(|p| {
                known(p, delta.vertices.len(), |p| &p.vertices) && (p.owner != own || (p.index as usize) < i)
            })
        }) && delta.wedges.iter().all(|w| known(w.vertex, delta.vertices.len(), |p| &p.vertices))
            && delta
                .faces
                .iter()
                .all(|f| usize::from(f.material) < self.indices.len() && f.wedges.iter().all(|&w| wedge(w)))
            && delta.moves.is_sorted_by(|a, b| a.vertex < b.vertex)
            && delta.moves.iter().all(|m| {
                m.vertex.owner != own
                    && known(m.vertex, 0, |p| &p.vertices)
                    && self.positions[self.vertex_slot(m.vertex) as usize] == m.from
            })
            && delta.repoints.iter().all(|r| {
                // Corners move to wedges that the chunk brings, from wedges that were there: then whatever
                // moves them on needs this chunk, and undoing it leaves none at a wedge that is gone.
                let ours = r.from.owner != own && r.to.owner == own && r.face.owner != own;
                ours && r.corner < 3
                    && known(r.face, 0, |p| &p.faces)
                    && wedge(r.from)
                    && wedge(r.to)
                    && self.faces[self.face_slot(r.face) as usize][usize::from(r.corner)]
                        == self.wedge_slot(r.from)
            })
    }
}
