//! The refined mesh: structure of arrays over slots. Chunks get slots when they are applied, so memory
//! follows what is applied, not what exists; ids stay canonical (see [`Id`]).

use std::ops::Range;

use crate::asset::base::Base;
use crate::entropy::Codec;
use crate::mesh::Kinds;
use crate::mesh::slot_map::SlotMap;
use crate::mesh::stars::Stars;
use crate::mesh::{Grid, UvGrid, Wedge};
use crate::refine::delta::{ChunkDelta, Id, Repoint};
use crate::refine::places::{Place, Places};
use crate::refine::render::Touched;
use crate::refine::slots::Slots;

/// A chunk that cannot be applied or undone now. Nothing was changed.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum RefineError {
    /// Applied already.
    #[error("chunk {0} is applied already")]
    AlreadyApplied(u32),
    /// Not applied.
    #[error("chunk {0} is not applied")]
    NotApplied(u32),
    /// There is no such chunk.
    #[error("chunk {chunk} does not exist: the asset has {count}")]
    NoSuchChunk {
        /// The chunk.
        chunk: u32,
        /// How many there are.
        count: u32,
    },
    /// A parent is missing.
    #[error("chunk {chunk} needs chunk {parent}, which is not applied")]
    MissingParent {
        /// The chunk.
        chunk: u32,
        /// Its parent.
        parent: u32,
    },
    /// A parent is applied only up to a stop.
    #[error("chunk {chunk} needs the whole of chunk {parent}, which is applied only up to a stop")]
    PartialParent {
        /// The chunk.
        chunk: u32,
        /// Its parent.
        parent: u32,
    },
    /// A child is still applied.
    #[error("chunk {chunk} cannot be undone: {children} chunks that need it are applied")]
    HasChildren {
        /// The chunk.
        chunk: u32,
        /// Applied chunks that name it as a parent or refer to what it brought.
        children: u32,
    },
    /// The delta does not fit the mesh.
    #[error("chunk {0} does not fit the mesh: its data refers to what is not there")]
    Mismatch(u32),
}

/// A mesh of a base and any closed set of chunks, those without applied children perhaps up to a stop.
///
/// Memory ([`Self::bytes`]): 85 to 148 bytes a face, measured on eleven meshes with every chunk applied before
/// vertices knew what moved them, which adds 5 bytes a vertex (and 4 a move, not counted);
/// what it is depends on how far the lists have grown beyond what they hold.
#[derive(Clone, Debug)]
pub struct ActiveMesh {
    pub(crate) grid: Grid,
    pub(crate) uv_grid: UvGrid,
    pub(crate) codec: Codec,
    pub(crate) kinds: Kinds,
    pub(crate) places: Places,
    pub(crate) positions: Vec<[i32; 3]>,
    /// Where a vertex was before the chunk that brought it, or moved it last, was applied: a new one's is the
    /// position of its oldest ancestor within the chunk's parents.
    pub(crate) morph_from: Vec<[i32; 3]>,
    pub(crate) vertex_origin: Vec<u32>,
    /// The origin that put a vertex where it is: its own, or a chunk's that moved it.
    pub(crate) vertex_mover: Vec<u32>,
    /// How many of the lowest bits of a position are zero, at most.
    pub(crate) vertex_shift: Vec<u8>,
    /// [`Base::shifts`].
    pub(crate) shifts: Vec<u8>,
    pub(crate) wedges: Vec<Wedge>,
    pub(crate) wedge_origin: Vec<u32>,
    pub(crate) faces: Vec<[u32; 3]>,
    pub(crate) face_origin: Vec<u32>,
    pub(crate) materials: Vec<u16>,
    /// Slot of each face in the index list of its material.
    draw_slots: Vec<u32>,
    /// Index lists, one per material; unused entries are `[0, 0, 0]`.
    pub(crate) indices: Vec<Vec<[u32; 3]>>,
    pub(crate) stars: Stars,
    vertex_slots: Slots,
    wedge_slots: Slots,
    face_slots: Slots,
    index_slots: Vec<Slots>,
    live_faces: usize,
    live_vertices: usize,
    applied_chunks: usize,
}

impl ActiveMesh {
    /// The base mesh alone. The base must have been decoded or built by this crate.
    #[must_use]
    pub fn new(base: &Base) -> Self {
        let materials = usize::from(base.material_count.max(1));
        let mut mesh = Self {
            grid: base.grid,
            uv_grid: base.uv_grid,
            codec: base.codec,
            kinds: base.kinds(),
            places: Places::new(base.chunk_count),
            positions: Vec::new(),
            morph_from: Vec::new(),
            vertex_origin: Vec::new(),
            vertex_mover: Vec::new(),
            vertex_shift: Vec::new(),
            shifts: base.shifts.clone(),
            wedges: Vec::new(),
            wedge_origin: Vec::new(),
            faces: Vec::new(),
            face_origin: Vec::new(),
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
        mesh.wedges[..base.wedges.len()].copy_from_slice(&base.wedges);
        for (slot, face) in base.faces.iter().enumerate() {
            mesh.put_face(slot as u32, face.wedges);
        }
        mesh
    }

    /// Grid of the positions.
    #[must_use]
    pub fn grid(&self) -> Grid {
        self.grid
    }

    /// How its chunks are coded.
    #[must_use]
    pub fn codec(&self) -> Codec {
        self.codec
    }

    /// Whether a chunk is applied, whole or up to a stop.
    #[must_use]
    pub fn is_applied(&self, chunk: u32) -> bool {
        chunk.checked_add(1).is_some_and(|origin| self.places.get(origin).is_some())
    }

    /// The stop that a chunk is applied up to; `None` if it is whole or not applied.
    #[must_use]
    pub fn applied_stop(&self, chunk: u32) -> Option<u8> {
        self.places.get(chunk.checked_add(1)?)?.stop
    }

    /// Faces that are there now.
    #[must_use]
    pub fn face_count(&self) -> usize {
        self.live_faces
    }

    /// Vertices that are there now.
    #[must_use]
    pub fn vertex_count(&self) -> usize {
        self.live_vertices
    }

    /// Chunks that are applied now.
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
            + (self.vertex_origin.capacity()
                + self.vertex_mover.capacity()
                + self.wedge_origin.capacity()
                + self.face_origin.capacity())
                * 4
            + self.wedges.capacity() * size_of::<Wedge>()
            + self.faces.capacity() * 12
            + self.materials.capacity() * 2
            + self.draw_slots.capacity() * 4
            + self.indices.iter().map(|i| i.capacity() * 12).sum::<usize>()
            + self.stars.bytes()
            + self.places.bytes()
    }

    /// Applies a decoded chunk, or its beginning up to a stop, once its parents are applied whole.
    ///
    /// To go from one stop to another, or on to the whole, undo the one and apply the other; between the
    /// two, and before any of its children is applied, the other may be decoded. [`Touched::merge`] makes
    /// one change of them for a renderer.
    ///
    /// # Errors
    /// See [`RefineError`]; the mesh is then unchanged.
    pub fn apply(&mut self, delta: &ChunkDelta) -> Result<Touched, RefineError> {
        self.may_apply(delta)?;
        if !self.moves_corners_once(&delta.repoints) {
            return Err(RefineError::Mismatch(delta.chunk));
        }
        let origin = delta.chunk + 1;
        // Not the parents alone: an index that names too few must not make references dangle.
        let mut needs = delta.needs();
        let movers: Vec<u32> =
            delta.moves.iter().map(|m| self.vertex_mover[self.vertex_slot(m.vertex) as usize]).collect();
        // What moves a vertex on can be undone only first.
        needs.extend(movers.iter().filter(|&&mover| mover != 0));
        needs.sort_unstable();
        needs.dedup();
        for &need in &needs {
            if let Some(place) = self.places.get_mut(need) {
                place.children += 1;
            }
        }
        let materials: Vec<u16> = delta.faces.iter().map(|f| f.material).collect();
        self.reserve(origin, delta.vertices.len(), delta.wedges.len(), &materials);
        let place = self.places.get(origin).cloned().unwrap_or_default();
        for (slot, vertex) in place.vertices.clone().zip(&delta.vertices) {
            self.positions[slot as usize] = vertex.position;
            self.vertex_shift[slot as usize] = vertex.shift;
            // A parent inside this chunk has a smaller index, so its ancestor is already known.
            self.morph_from[slot as usize] = match vertex.parent {
                Some(parent) if parent.origin == origin => {
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
            self.move_vertex(m.vertex, (m.to, m.from), m.shifts[1], origin, &mut touched);
        }
        for (slot, face) in place.faces.clone().zip(&delta.faces) {
            self.put_face(slot, face.wedges.map(|w| self.wedge_slot(w)));
            touched.face(slot);
        }
        for repoint in &delta.repoints {
            let face = self.face_slot(repoint.face);
            self.move_corner(face, repoint.corner, self.wedge_slot(repoint.to));
            touched.face(face);
        }
        if let Some(place) = self.places.get_mut(origin) {
            place.needs = needs;
            place.movers = movers;
            place.stop = delta.stop;
        }
        self.applied_chunks += 1;
        self.finish_touched(&mut touched);
        Ok(touched)
    }

    /// Undoes an applied chunk none of whose children is applied; `delta` is what was applied.
    ///
    /// # Errors
    /// See [`RefineError`]; the mesh is then unchanged.
    pub fn undo(&mut self, delta: &ChunkDelta) -> Result<Touched, RefineError> {
        let not_applied = RefineError::NotApplied(delta.chunk);
        let origin = delta.chunk.checked_add(1).ok_or(not_applied.clone())?;
        let place = self.places.get(origin).cloned().ok_or(not_applied)?;
        if place.children > 0 {
            return Err(RefineError::HasChildren { chunk: delta.chunk, children: place.children });
        }
        if place.stop != delta.stop
            || !self.fits(delta, true)
            || place.faces.len() != delta.faces.len()
            || place.wedges.len() != delta.wedges.len()
            || place.vertices.len() != delta.vertices.len()
            || place.movers.len() != delta.moves.len()
            || !self.moves_corners_once(&delta.repoints)
        {
            return Err(RefineError::Mismatch(delta.chunk));
        }
        let mut touched = Touched::default();
        for slot in place.faces.clone() {
            for k in 0..3 {
                let vertex = self.wedges[self.faces[slot as usize][k] as usize].vertex;
                self.stars.remove(vertex, slot * 3 + k as u32);
                touched.vertex(vertex);
            }
            let (material, draw) = (self.materials[slot as usize], self.draw_slots[slot as usize]);
            self.indices[usize::from(material)][draw as usize] = [0; 3];
            touched.draws.push((material, draw));
        }
        for repoint in &delta.repoints {
            let face = self.face_slot(repoint.face);
            self.move_corner(face, repoint.corner, self.wedge_slot(repoint.from));
            touched.face(face);
        }
        for (m, &mover) in delta.moves.iter().zip(&place.movers) {
            self.move_vertex(m.vertex, (m.from, m.from), m.shifts[0], mover, &mut touched);
        }
        for &need in &place.needs {
            if let Some(place) = self.places.get_mut(need) {
                place.children -= 1;
            }
        }
        self.live_faces -= place.faces.len();
        self.live_vertices -= place.vertices.len();
        self.applied_chunks -= 1;
        self.vertex_slots.give_back(place.vertices);
        self.wedge_slots.give_back(place.wedges);
        self.face_slots.give_back(place.faces);
        for (material, range) in place.draws {
            self.index_slots[usize::from(material)].give_back(range);
        }
        self.places.remove(origin);
        self.finish_touched(&mut touched);
        Ok(touched)
    }

    fn may_apply(&self, delta: &ChunkDelta) -> Result<(), RefineError> {
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
        if !self.fits(delta, false) {
            return Err(RefineError::Mismatch(chunk));
        }
        // Not the parents alone, for the reason given in `apply`.
        let partial = delta.needs().into_iter().find(|&need| self.applied_stop(need - 1).is_some());
        partial.map_or(Ok(()), |need| Err(RefineError::PartialParent { chunk, parent: need - 1 }))
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
    fn fits(&self, delta: &ChunkDelta, applied: bool) -> bool {
        let own = delta.chunk + 1;
        let known = |id: Id, count: usize, range: fn(&Place) -> &Range<u32>| {
            if id.origin == own {
                (id.index as usize) < count
            } else {
                self.place(id.origin).is_some_and(|p| (id.index as usize) < range(p).len())
            }
        };
        let wedge = |id: Id| known(id, delta.wedges.len(), |p| &p.wedges);
        delta.vertices.iter().enumerate().all(|(i, v)| {
            v.parent.is_none_or(|p| {
                known(p, delta.vertices.len(), |p| &p.vertices) && (p.origin != own || (p.index as usize) < i)
            })
        }) && delta.wedges.iter().all(|w| known(w.vertex, delta.vertices.len(), |p| &p.vertices))
            && delta
                .faces
                .iter()
                .all(|f| usize::from(f.material) < self.indices.len() && f.wedges.iter().all(|&w| wedge(w)))
            && delta.moves.is_sorted_by(|a, b| a.vertex < b.vertex)
            && delta.moves.iter().all(|m| {
                let at = if applied { m.to } else { m.from };
                m.vertex.origin != own
                    && known(m.vertex, 0, |p| &p.vertices)
                    && self.positions[self.vertex_slot(m.vertex) as usize] == at
            })
            && delta.repoints.iter().all(|r| {
                // Corners move to wedges that the chunk brings, from wedges that were there: then whatever
                // moves them on needs this chunk, and undoing it leaves none at a wedge that is gone.
                let ours = r.from.origin != own && r.to.origin == own && r.face.origin != own;
                let at = if applied { r.to } else { r.from };
                ours && r.corner < 3
                    && known(r.face, 0, |p| &p.faces)
                    && wedge(r.from)
                    && wedge(r.to)
                    && self.faces[self.face_slot(r.face) as usize][usize::from(r.corner)]
                        == self.wedge_slot(at)
            })
    }

    fn reserve(&mut self, origin: u32, vertices: usize, wedges: usize, materials: &[u16]) {
        let place = Place {
            vertices: self.vertex_slots.take(vertices as u32),
            wedges: self.wedge_slots.take(wedges as u32),
            faces: self.face_slots.take(materials.len() as u32),
            draws: Vec::new(),
            stop: None,
            children: 0,
            needs: Vec::new(),
            movers: Vec::new(),
        };
        let (v, w, f) = (
            self.vertex_slots.high() as usize,
            self.wedge_slots.high() as usize,
            self.face_slots.high() as usize,
        );
        grow(&mut self.positions, v, [0; 3]);
        grow(&mut self.morph_from, v, [0; 3]);
        grow(&mut self.vertex_origin, v, 0);
        grow(&mut self.vertex_mover, v, 0);
        grow(&mut self.vertex_shift, v, 0);
        grow(&mut self.wedges, w, Wedge::default());
        grow(&mut self.wedge_origin, w, 0);
        grow(&mut self.faces, f, [0; 3]);
        grow(&mut self.face_origin, f, 0);
        grow(&mut self.materials, f, 0);
        grow(&mut self.draw_slots, f, 0);
        self.stars.grow(v, f);
        for slot in place.vertices.clone() {
            self.vertex_origin[slot as usize] = origin;
            self.vertex_mover[slot as usize] = origin;
            self.stars.clear(slot);
        }
        for slot in place.wedges.clone() {
            self.wedge_origin[slot as usize] = origin;
        }
        let mut order: Vec<(u16, u32)> = materials.iter().copied().zip(place.faces.clone()).collect();
        order.sort_unstable();
        let mut draws = Vec::new();
        for run in order.chunk_by(|a, b| a.0 == b.0) {
            let material = run[0].0;
            let list = usize::from(material);
            let range = self.index_slots[list].take(run.len() as u32);
            let high = self.index_slots[list].high() as usize;
            grow(&mut self.indices[list], high, [0; 3]);
            for (&(_, face), draw) in run.iter().zip(range.clone()) {
                self.draw_slots[face as usize] = draw;
                self.materials[face as usize] = material;
                self.face_origin[face as usize] = origin;
            }
            draws.push((material, range));
        }
        self.live_vertices += vertices;
        self.live_faces += materials.len();
        self.places.insert(origin, Place { draws, ..place });
    }

    fn put_face(&mut self, slot: u32, wedges: [u32; 3]) {
        self.faces[slot as usize] = wedges;
        for (k, wedge) in wedges.into_iter().enumerate() {
            self.stars.insert(self.wedges[wedge as usize].vertex, slot * 3 + k as u32);
        }
        let list = usize::from(self.materials[slot as usize]);
        self.indices[list][self.draw_slots[slot as usize] as usize] = wedges;
    }

    fn move_vertex(
        &mut self,
        vertex: Id,
        (to, from): ([i32; 3], [i32; 3]),
        shift: u8,
        mover: u32,
        touched: &mut Touched,
    ) {
        let slot = self.vertex_slot(vertex);
        self.positions[slot as usize] = to;
        self.morph_from[slot as usize] = from;
        self.vertex_shift[slot as usize] = shift;
        self.vertex_mover[slot as usize] = mover;
        for corner in self.stars.corners(slot) {
            touched.face(corner / 3);
        }
    }

    fn move_corner(&mut self, face: u32, corner: u8, to: u32) {
        let k = usize::from(corner);
        let from = self.faces[face as usize][k];
        let (old, new) = (self.wedges[from as usize].vertex, self.wedges[to as usize].vertex);
        self.stars.remove(old, face * 3 + k as u32);
        self.stars.insert(new, face * 3 + k as u32);
        self.faces[face as usize][k] = to;
        let list = usize::from(self.materials[face as usize]);
        self.indices[list][self.draw_slots[face as usize] as usize][k] = to;
    }

    /// Completes a list of touched faces: their index entries, and every wedge around their corners,
    /// whose normals may have changed.
    fn finish_touched(&self, touched: &mut Touched) {
        let faces = std::mem::take(&mut touched.faces);
        for &face in &faces {
            touched.draws.push((self.materials[face as usize], self.draw_slots[face as usize]));
            for wedge in self.faces[face as usize] {
                touched.vertex(self.wedges[wedge as usize].vertex);
            }
        }
        // A face names vertices that its neighbours name too: look each up only once.
        let mut seen = SlotMap::default();
        for vertex in std::mem::take(&mut touched.vertices) {
            if seen.insert(vertex, 0) {
                self.touch_star(vertex, &mut touched.wedges);
            }
        }
        touched.wedges.sort_unstable();
        touched.wedges.dedup();
        touched.draws.sort_unstable();
        touched.draws.dedup();
    }

    /// The wedges around a vertex. Runs of one wedge, which most stars are, come once.
    fn touch_star(&self, vertex: u32, wedges: &mut Vec<u32>) {
        let first = wedges.len();
        for corner in self.stars.corners(vertex) {
            let wedge = self.faces[(corner / 3) as usize][(corner % 3) as usize];
            if wedges[first..].last() != Some(&wedge) {
                wedges.push(wedge);
            }
        }
    }

    pub(crate) fn place(&self, origin: u32) -> Option<&Place> {
        self.places.get(origin)
    }

    /// Slots of ids; 0 for ids that are not there, which [`Self::fits`] has excluded.
    pub(crate) fn vertex_slot(&self, id: Id) -> u32 {
        self.place(id.origin).map_or(0, |p| p.vertices.start + id.index)
    }

    pub(crate) fn wedge_slot(&self, id: Id) -> u32 {
        self.place(id.origin).map_or(0, |p| p.wedges.start + id.index)
    }

    pub(crate) fn face_slot(&self, id: Id) -> u32 {
        self.place(id.origin).map_or(0, |p| p.faces.start + id.index)
    }

    /// Ids of slots that are in use.
    pub(crate) fn vertex_id(&self, slot: u32) -> Id {
        let origin = self.vertex_origin[slot as usize];
        Id { origin, index: slot - self.place(origin).map_or(slot, |p| p.vertices.start) }
    }

    pub(crate) fn wedge_id(&self, slot: u32) -> Id {
        let origin = self.wedge_origin[slot as usize];
        Id { origin, index: slot - self.place(origin).map_or(slot, |p| p.wedges.start) }
    }

    pub(crate) fn face_id(&self, slot: u32) -> Id {
        let origin = self.face_origin[slot as usize];
        Id { origin, index: slot - self.place(origin).map_or(slot, |p| p.faces.start) }
    }
}

fn grow<T: Clone>(list: &mut Vec<T>, count: usize, value: T) {
    if list.len() < count {
        list.resize(count, value);
    }
}
