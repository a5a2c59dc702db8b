//! A chunk's region as its decoder knows it: the stars of the region's interior vertices.
//!
//! Gathered from the mesh by breadth-first search over interior vertices, so numbering depends on
//! nothing but the chunk: whatever else is applied, and in whatever order, the region's stars are
//! the same (docs/design/refinement.md, "Why any order gives one mesh").
//!
//! Positions are integers below 2^24 kept as `f64`, so sums and differences of them are exact.

use crate::codec::fan::Spoke;
use crate::entropy::steps;
use crate::error::DecodeError;
use crate::mesh::Attributes;
use crate::mesh::corner;
use crate::mesh::slot_map::SlotMap;
use crate::mesh::stars::END;
use crate::mesh::vec3::{Vec3, add, cross, length, sub, triangle_normal};
use crate::numbers::{id32, truncated};
use crate::refine::{ActiveMesh, ChunkDelta, Id, Moved, NewFace, NewVertex, NewWedge, Repoint};

/// Most faces that a region may have: bounds the work that a stranger's chunk can cause.
pub(crate) const MAX_LOCAL_FACES: usize = 1 << 18;

pub(crate) struct LocalVertex {
    pub(crate) position: Vec3,
    /// Sum of the positions at the far ends of the edges of its faces, each face counted, and how
    /// many those are: twice the ring where the star is closed.
    sum: Vec3,
    ends: u32,
    /// The first corner of the star (`face × 4 + k`); the others follow in `LocalFace::next`.
    star: u32,
    pub(crate) interior: bool,
    /// How many of the lowest bits of its position are zero, at most.
    pub(crate) shift: u8,
}

pub(crate) struct LocalWedge {
    pub(crate) id: Id,
    pub(crate) vertex: u32,
    pub(crate) attributes: Attributes,
    next: u32,
}

pub(crate) struct LocalFace {
    pub(crate) corners: [u32; 3],
    next: [u32; 3],
    pub(crate) wedges: [u32; 3],
    pub(crate) material: u16,
    /// Doubled, in square cells.
    area: f64,
}

/// What a face was before the chunk.
struct Gathered {
    id: Id,
    wedges: [u32; 3],
}

const NONE: u32 = u32::MAX;

/// So many elements of each kind.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Elements {
    pub(crate) vertices: u32,
    pub(crate) wedges: u32,
    pub(crate) faces: u32,
}

impl Elements {
    /// All kinds together.
    pub(crate) fn total(&self) -> u64 {
        u64::from(self.vertices) + u64::from(self.wedges) + u64::from(self.faces)
    }
}

impl std::fmt::Display for Elements {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} vertices, {} wedges and {} faces", self.vertices, self.wedges, self.faces)
    }
}

/// The region, in local numbers; new elements are appended.
pub(crate) struct Local<'a> {
    mesh: &'a ActiveMesh,
    /// Owner of what the chunk adds.
    own: u32,
    pub(crate) vertices: Vec<LocalVertex>,
    pub(crate) wedges: Vec<LocalWedge>,
    pub(crate) faces: Vec<LocalFace>,
    /// First and last wedge of each vertex that is known here; the others follow in `LocalWedge::next`.
    wedge_ends: Vec<[u32; 2]>,
    vertex_ids: Vec<Id>,
    /// The faces that were there: the first ones.
    gathered: Vec<Gathered>,
    vertex_at: SlotMap,
    wedge_at: SlotMap,
    /// The vertices that the chunk adds, and those they split from.
    new_vertices: Vec<(u32, Option<u32>)>,
    new_wedges: u32,
    /// Older vertices that the chunk moves.
    moves: Vec<Moved>,
}

impl<'a> Local<'a> {
    /// For a chunk of about so many splits.
    pub(crate) fn new(mesh: &'a ActiveMesh, chunk: u32, splits: usize) -> Self {
        Self {
            mesh,
            own: chunk + 1,
            vertices: Vec::with_capacity(2 * splits),
            wedges: Vec::with_capacity(2 * splits),
            faces: Vec::with_capacity(4 * splits),
            wedge_ends: Vec::with_capacity(2 * splits),
            vertex_ids: Vec::with_capacity(2 * splits),
            gathered: Vec::with_capacity(2 * splits),
            vertex_at: SlotMap::default(),
            wedge_at: SlotMap::default(),
            new_vertices: Vec::with_capacity(splits),
            new_wedges: 0,
            moves: Vec::new(),
        }
    }

    /// Elements added so far.
    pub(crate) fn added(&self) -> Elements {
        let faces = self.faces.len() - self.gathered.len();
        Elements { vertices: id32(self.new_vertices.len()), wedges: self.new_wedges, faces: id32(faces) }
    }

    /// Gathers the interior vertices that can be reached from the one at `seed`, and their stars.
    /// `interior(slot, outlook)` codes whether a vertex that was met is interior.
    pub(crate) fn explore(
        &mut self,
        seed: u32,
        interior: &mut dyn FnMut(u32, usize) -> bool,
    ) -> Result<(), DecodeError> {
        self.refuse_known(seed)?;
        let mut queue = vec![(self.old_vertex(seed, true), seed)];
        let mut found: Vec<(Id, u32)> = Vec::new();
        let mut at = 0;
        while let Some(&(v, slot)) = queue.get(at) {
            at += 1;
            found.clear();
            for corner in self.mesh.stars.corners(slot) {
                let face = corner / 3;
                if !self.is_gathered(face, v) {
                    found.push((self.mesh.face_id(face), face));
                }
            }
            found.sort_unstable();
            found.dedup();
            if self.faces.len() + found.len() > MAX_LOCAL_FACES {
                return Err(DecodeError::new(
                    "chunk",
                    format!("its region has over {MAX_LOCAL_FACES} faces"),
                ));
            }
            for &(id, face) in &found {
                self.gather(id, face, &mut queue, interior);
            }
        }
        Ok(())
    }

    /// Makes a vertex of the outline known, without its star.
    pub(crate) fn name_outline(&mut self, slot: u32) -> Result<(), DecodeError> {
        self.refuse_known(slot)?;
        if self.vertices.len() > 3 * MAX_LOCAL_FACES {
            return Err(DecodeError::new("chunk", "too many seeds"));
        }
        self.old_vertex(slot, false);
        Ok(())
    }

    fn refuse_known(&self, seed: u32) -> Result<(), DecodeError> {
        match self.vertex_at.get(seed) {
            Some(_) => Err(DecodeError::new("chunk", "a seed vertex is given twice")),
            None => Ok(()),
        }
    }

    /// Whether a face at interior vertex `v` came with another one's star: stars are gathered in the order
    /// of the vertices' numbers.
    fn is_gathered(&self, face: u32, v: u32) -> bool {
        self.mesh.faces[face as usize].iter().any(|&wedge| {
            self.known_vertex(wedge).is_some_and(|c| c < v && self.vertices[c as usize].interior)
        })
    }

    /// The local number of a wedge slot's vertex, if it has one.
    fn known_vertex(&self, wedge: u32) -> Option<u32> {
        match self.wedge_at.get(wedge) {
            Some(known) => Some(self.wedges[known as usize].vertex),
            None => self.vertex_at.get(self.mesh.wedges[wedge as usize].vertex),
        }
    }

    fn gather(
        &mut self,
        id: Id,
        face: u32,
        queue: &mut Vec<(u32, u32)>,
        interior: &mut dyn FnMut(u32, usize) -> bool,
    ) {
        let slots = self.mesh.faces[face as usize];
        let mut wedges = [0; 3];
        let mut corners = [0; 3];
        for k in 0..3 {
            corners[k] = match self.known_vertex(slots[k]) {
                Some(known) => known,
                None => {
                    let slot = self.mesh.wedges[slots[k] as usize].vertex;
                    let inside = interior(slot, self.outlook(&slots, k));
                    let new = self.old_vertex(slot, inside);
                    if inside {
                        queue.push((new, slot));
                    }
                    new
                }
            };
            wedges[k] = self.old_wedge(slots[k], corners[k]);
        }
        let area = length(triangle_normal(
            self.position(corners[0]),
            self.position(corners[1]),
            self.position(corners[2]),
        ));
        let material = self.mesh.materials[face as usize];
        self.gathered.push(Gathered { id, wedges });
        self.push_face(LocalFace { corners, next: [END; 3], wedges, material, area });
    }

    /// What the other corners of a face say about whether a corner is interior, 0 to 8: each is
    /// unknown, outside or inside.
    fn outlook(&self, wedges: &[u32; 3], k: usize) -> usize {
        let mut context = 0;
        for other in [corner::next(k), corner::previous(k)] {
            let known = self.known_vertex(wedges[other]).map(|v| self.vertices[v as usize].interior);
            context = context * 3 + known.map_or(0, |inside| 1 + usize::from(inside));
        }
        context
    }

    fn old_vertex(&mut self, slot: u32, interior: bool) -> u32 {
        self.vertex_at.insert(slot, id32(self.vertices.len()));
        let position = self.mesh.positions[slot as usize].map(f64::from);
        self.push_vertex(self.mesh.vertex_id(slot), position, interior, self.mesh.vertex_shift[slot as usize])
    }

    fn old_wedge(&mut self, slot: u32, vertex: u32) -> u32 {
        if let Some(known) = self.wedge_at.get(slot) {
            return known;
        }
        let wedge = self.mesh.wedges[slot as usize];
        let local = self.push_wedge(self.mesh.wedge_id(slot), vertex, wedge.attributes);
        self.wedge_at.insert(slot, local);
        local
    }

    pub(crate) fn add_vertex(&mut self, position: Vec3, parent: Option<u32>, shift: u8) -> u32 {
        let id = Id { owner: self.own, index: id32(self.new_vertices.len()) };
        self.new_vertices.push((id32(self.vertices.len()), parent));
        self.push_vertex(id, position, true, shift)
    }

    pub(crate) fn add_wedge(&mut self, vertex: u32, attributes: Attributes) -> u32 {
        let id = Id { owner: self.own, index: self.new_wedges };
        self.new_wedges += 1;
        self.push_wedge(id, vertex, attributes)
    }

    /// Adds a face two of whose corners are at the same place; its wedges and material must be set before
    /// the next split.
    pub(crate) fn add_face(&mut self, corners: [u32; 3]) -> u32 {
        self.push_face(LocalFace { corners, next: [END; 3], wedges: [NONE; 3], material: 0, area: 0.0 })
    }

    fn push_vertex(&mut self, id: Id, position: Vec3, interior: bool, shift: u8) -> u32 {
        self.vertices.push(LocalVertex { position, sum: [0.0; 3], ends: 0, star: END, interior, shift });
        self.vertex_ids.push(id);
        self.wedge_ends.push([NONE; 2]);
        id32(self.vertices.len() - 1)
    }

    fn push_wedge(&mut self, id: Id, vertex: u32, attributes: Attributes) -> u32 {
        let local = id32(self.wedges.len());
        self.wedges.push(LocalWedge { id, vertex, attributes, next: NONE });
        let [first, last] = &mut self.wedge_ends[vertex as usize];
        match *last {
            NONE => *first = local,
            before => self.wedges[before as usize].next = local,
        }
        *last = local;
        local
    }

    fn push_face(&mut self, face: LocalFace) -> u32 {
        let local = id32(self.faces.len());
        let [a, b, c] = face.corners;
        let places = face.corners.map(|v| self.position(v));
        self.faces.push(face);
        for (k, v, ends) in [(0, a, [1, 2]), (1, b, [2, 0]), (2, c, [0, 1])] {
            self.enter(v, local, k, add(places[ends[0]], places[ends[1]]));
        }
        local
    }

    /// Puts a corner at the front of a vertex's star; `ends` is the sum of the positions of the face's
    /// other corners.
    fn enter(&mut self, vertex: u32, face: u32, k: usize, ends: Vec3) {
        let vertex = &mut self.vertices[vertex as usize];
        vertex.sum = add(vertex.sum, ends);
        vertex.ends += 2;
        self.faces[face as usize].next[k] = std::mem::replace(&mut vertex.star, face * 4 + id32(k));
    }

    /// The opposite.
    fn leave(&mut self, vertex: u32, face: u32, k: usize, ends: Vec3) {
        let vertex = &mut self.vertices[vertex as usize];
        vertex.sum = sub(vertex.sum, ends);
        vertex.ends -= 2;
        let (corner, after) = (face * 4 + id32(k), self.faces[face as usize].next[k]);
        if vertex.star == corner {
            vertex.star = after;
            return;
        }
        let mut at = vertex.star;
        while at != END {
            steps::take(1);
            let next = &mut self.faces[(at / 4) as usize].next[(at % 4) as usize % 3];
            if *next == corner {
                *next = after;
                return;
            }
            at = *next;
        }
    }

    /// Moves the centre of a spoke to another vertex at the same place. Its wedge must be set before the
    /// next split.
    pub(crate) fn move_corner(&mut self, spoke: &Spoke, to: u32) {
        let k = usize::from(spoke.k);
        let ends = add(self.position(spoke.a), self.position(spoke.b));
        let from = std::mem::replace(&mut self.faces[spoke.face as usize].corners[k], to);
        self.leave(from, spoke.face, k, ends);
        self.enter(to, spoke.face, k, ends);
    }

    /// Moves an older vertex, whose star is given.
    pub(crate) fn move_vertex(&mut self, vertex: u32, star: &[Spoke], position: [i32; 3], shift: u8) {
        let was = &self.vertices[vertex as usize];
        self.moves.push(Moved {
            vertex: self.vertex_ids[vertex as usize],
            from: was.position.map(truncated),
            to: position,
            shifts: [was.shift, shift],
        });
        self.vertices[vertex as usize].shift = shift;
        self.place_vertex(vertex, star, position);
    }

    /// Puts a vertex, whose star is given, in its place.
    pub(crate) fn place_vertex(&mut self, vertex: u32, star: &[Spoke], position: [i32; 3]) {
        let position = position.map(f64::from);
        let before = std::mem::replace(&mut self.vertices[vertex as usize].position, position);
        let moved = sub(position, before);
        for spoke in star {
            for end in [spoke.a, spoke.b] {
                let end = &mut self.vertices[end as usize];
                end.sum = add(end.sum, moved);
            }
            // Coordinates are integers, so the cross product is exact: the same from any corner.
            let [a, b] = [spoke.a, spoke.b].map(|v| sub(self.position(v), position));
            self.faces[spoke.face as usize].area = length(cross(a, b));
        }
    }

    /// Mean of the far ends of the edges at a vertex, each face counted, leaving out `without` of
    /// them that are at `at`.
    pub(crate) fn mean_of_ends(&self, vertex: u32, without: u32, at: Vec3) -> Option<Vec3> {
        let v = &self.vertices[vertex as usize];
        let count = v.ends.checked_sub(without).filter(|&c| c > 0)?;
        let (inverse, without) = (1.0 / f64::from(count), f64::from(without));
        Some([0, 1, 2].map(|k| (v.sum[k] - without * at[k]) * inverse))
    }

    pub(crate) fn set_wedge(&mut self, face: u32, k: u8, wedge: u32) {
        self.faces[face as usize].wedges[usize::from(k)] = wedge;
    }

    /// Gives a new face its wedges and material.
    pub(crate) fn set_face(&mut self, face: u32, wedges: [u32; 3], material: u16) {
        let face = &mut self.faces[face as usize];
        (face.wedges, face.material) = (wedges, material);
    }

    pub(crate) fn position(&self, vertex: u32) -> Vec3 {
        self.vertices[vertex as usize].position
    }

    pub(crate) fn valence(&self, vertex: u32) -> usize {
        self.vertices[vertex as usize].ends as usize / 2
    }

    /// The star of a vertex, in an order that depends on nothing but the chunk. Answers the sum of the
    /// areas (doubled) of the faces, in square cells.
    pub(crate) fn star(&self, vertex: u32, star: &mut Vec<Spoke>) -> f64 {
        star.clear();
        let mut area = 0.0;
        let mut at = self.vertices[vertex as usize].star;
        while at != END {
            steps::take(1);
            let (face, k) = (at / 4, (at % 4) as u8);
            let LocalFace { corners: [p, q, r], next, area: of_face, .. } = &self.faces[face as usize];
            let (a, b, next) = match k {
                0 => (*q, *r, next[0]),
                1 => (*r, *p, next[1]),
                _ => (*p, *q, next[2]),
            };
            star.push(Spoke { face, k, a, b });
            area += of_face;
            at = next;
        }
        area
    }

    /// The wedge of a spoke at the centre, and at its vertices `a` and `b`.
    pub(crate) fn spoke_wedges(&self, spoke: &Spoke) -> [u32; 3] {
        let [p, q, r] = self.faces[spoke.face as usize].wedges;
        match spoke.k {
            0 => [p, q, r],
            1 => [q, r, p],
            _ => [r, p, q],
        }
    }

    /// The first wedge of a vertex that is known here, in order of discovery.
    pub(crate) fn first_wedge(&self, vertex: u32) -> Option<u32> {
        Some(self.wedge_ends[vertex as usize][0]).filter(|&w| w != NONE)
    }

    /// The wedges of a vertex that are known here, in order of discovery.
    pub(crate) fn wedges_of(&self, vertex: u32) -> impl Iterator<Item = u32> {
        std::iter::successors(self.first_wedge(vertex), |&w| {
            Some(self.wedges[w as usize].next).filter(|&w| w != NONE)
        })
    }

    /// Twice the area of a face, in square cells.
    pub(crate) fn face_area(&self, face: u32) -> f64 {
        self.faces[face as usize].area
    }

    /// The id of a vertex.
    pub(crate) fn vertex_id(&self, vertex: u32) -> Id {
        self.vertex_ids[vertex as usize]
    }

    /// The ids of the faces that were there, in order of their numbers.
    pub(crate) fn gathered_faces(&self) -> impl ExactSizeIterator<Item = Id> {
        self.gathered.iter().map(|f| f.id)
    }

    /// What the chunk has done, in canonical ids.
    pub(crate) fn into_delta(mut self, chunk: u32, parents: Vec<u32>) -> ChunkDelta {
        let mut moves = std::mem::take(&mut self.moves);
        moves.sort_unstable_by_key(|m| m.vertex);
        let wedge_id = |w: u32| self.wedges[w as usize].id;
        let new_wedges = &self.wedges[self.wedges.len() - self.new_wedges as usize..];
        let (old, new_faces) = self.faces.split_at(self.gathered.len());
        let vertex = |&(v, parent): &(u32, Option<u32>)| NewVertex {
            position: self.position(v).map(truncated),
            shift: self.vertices[v as usize].shift,
            parent: parent.map(|p| self.vertex_id(p)),
        };
        let wedge = |w: &LocalWedge| NewWedge { vertex: self.vertex_id(w.vertex), attributes: w.attributes };
        let face = |f: &LocalFace| NewFace { wedges: f.wedges.map(wedge_id), material: f.material };
        let mut repoints = Vec::new();
        for (face, before) in old.iter().zip(&self.gathered) {
            for k in (0..3).filter(|&k| face.wedges[k] != before.wedges[k]) {
                let (from, to) = (wedge_id(before.wedges[k]), wedge_id(face.wedges[k]));
                repoints.push(Repoint { face: before.id, corner: u8::try_from(k).unwrap_or(0), from, to });
            }
        }
        ChunkDelta {
            chunk,
            stop: None,
            parents,
            moves,
            vertices: self.new_vertices.iter().map(vertex).collect(),
            wedges: new_wedges.iter().map(wedge).collect(),
            faces: new_faces.iter().map(face).collect(),
            repoints,
        }
    }
}
