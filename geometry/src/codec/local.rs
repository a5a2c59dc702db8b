//! A chunk's region as its decoder knows it: the stars of the region's interior vertices.
//!
//! Gathered from the mesh by breadth-first search over interior vertices, so numbering depends on
//! nothing but the chunk: whatever else is applied, and in whatever order, the region's stars are
//! the same (see ARCHITECTURE.md, "Why any order gives one mesh").

use std::collections::{HashMap, VecDeque};
use std::hash::{BuildHasherDefault, Hasher};

use crate::codec::fan::Spoke;
use crate::error::DecodeError;
use crate::mesh::Attributes;
use crate::refine::{ActiveMesh, ChunkDelta, Id, NewFace, NewVertex, NewWedge, Repoint};
use crate::stars::Stars;
use crate::vec3::{Vec3, length, triangle_normal};

/// Most faces that a region may have: bounds the work that a stranger's chunk can cause.
pub(crate) const MAX_LOCAL_FACES: usize = 1 << 18;

/// Multiplicative hashing of slots (Knuth, TAOCP 3, §6.4): keys are small, distinct and ours.
#[derive(Default)]
pub(crate) struct SlotHasher(u64);

impl Hasher for SlotHasher {
    fn finish(&self) -> u64 {
        self.0
    }
    fn write(&mut self, bytes: &[u8]) {
        for &b in bytes {
            self.write_u32(u32::from(b));
        }
    }
    fn write_u32(&mut self, key: u32) {
        self.0 = (self.0 ^ u64::from(key)).wrapping_mul(0x9e37_79b9_7f4a_7c15).rotate_left(29);
    }
}

pub(crate) type SlotMap<T> = HashMap<u32, T, BuildHasherDefault<SlotHasher>>;

pub(crate) struct LocalVertex {
    pub(crate) id: Id,
    pub(crate) position: [i32; 3],
    pub(crate) interior: bool,
    pub(crate) parent: Option<Id>,
    /// Sum of the positions at the far ends of the edges of its faces, each face counted, and how
    /// many those are: twice the ring where the star is closed.
    sum: [i64; 3],
    ends: u32,
    /// First wedge of the vertex that is known here; the others follow in `LocalWedge::next`.
    first_wedge: u32,
    last_wedge: u32,
}

pub(crate) struct LocalWedge {
    pub(crate) id: Id,
    pub(crate) vertex: u32,
    pub(crate) attributes: Attributes,
    next: u32,
}

pub(crate) struct LocalFace {
    id: Id,
    pub(crate) wedges: [u32; 3],
    pub(crate) corners: [u32; 3],
    pub(crate) material: u16,
    /// Wedges at gathering time, for faces that were there.
    before: [u32; 3],
}

impl LocalFace {
    pub(crate) fn id(&self) -> Id {
        self.id
    }
}

const NO_WEDGE: u32 = u32::MAX;

/// The region, in local numbers; new elements are appended.
pub(crate) struct Local<'a> {
    mesh: &'a ActiveMesh,
    /// Origin of what the chunk adds.
    own: u32,
    pub(crate) vertices: Vec<LocalVertex>,
    pub(crate) wedges: Vec<LocalWedge>,
    pub(crate) faces: Vec<LocalFace>,
    stars: Stars,
    pub(crate) vertex_at: SlotMap<u32>,
    wedge_at: SlotMap<u32>,
    face_at: SlotMap<u32>,
    new_vertices: u32,
    new_wedges: u32,
    new_faces: u32,
}

impl<'a> Local<'a> {
    pub(crate) fn new(mesh: &'a ActiveMesh, chunk: u32) -> Self {
        Self {
            mesh,
            own: chunk + 1,
            vertices: Vec::new(),
            wedges: Vec::new(),
            faces: Vec::new(),
            stars: Stars::new(0, 0),
            vertex_at: SlotMap::default(),
            wedge_at: SlotMap::default(),
            face_at: SlotMap::default(),
            new_vertices: 0,
            new_wedges: 0,
            new_faces: 0,
        }
    }

    /// (vertices, wedges, faces) added so far.
    pub(crate) fn added(&self) -> (u32, u32, u32) {
        (self.new_vertices, self.new_wedges, self.new_faces)
    }

    /// Gathers the interior vertices that can be reached from the one at `seed`, and their stars.
    /// `interior(slot)` codes whether a vertex that was met is interior.
    pub(crate) fn explore(
        &mut self,
        seed: u32,
        interior: &mut dyn FnMut(u32, usize) -> bool,
    ) -> Result<(), DecodeError> {
        if self.vertex_at.contains_key(&seed) {
            return Err(DecodeError::new("chunk", "a seed vertex is given twice"));
        }
        let mut queue = VecDeque::from([self.old_vertex(seed, true)]);
        let mut found: Vec<(Id, u32)> = Vec::new();
        while let Some(v) = queue.pop_front() {
            let slot = self.mesh.vertex_slot(self.vertices[v as usize].id);
            found.clear();
            for corner in self.mesh.stars.corners(slot) {
                let face = corner / 3;
                if !self.face_at.contains_key(&face) {
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
                let slots = self.mesh.faces[face as usize];
                let mut wedges = [0; 3];
                let mut corners = [0; 3];
                for k in 0..3 {
                    let vertex_slot = self.mesh.wedges[slots[k] as usize].vertex;
                    corners[k] = match self.vertex_at.get(&vertex_slot) {
                        Some(&known) => known,
                        None => {
                            let inside = interior(vertex_slot, self.outlook(&slots, k));
                            let new = self.old_vertex(vertex_slot, inside);
                            if inside {
                                queue.push_back(new);
                            }
                            new
                        }
                    };
                    wedges[k] = self.old_wedge(slots[k], corners[k]);
                }
                self.face_at.insert(face, self.faces.len() as u32);
                let material = self.mesh.materials[face as usize];
                self.push_face(LocalFace { id, wedges, corners, material, before: wedges });
            }
        }
        Ok(())
    }

    /// Makes a vertex of the outline known, without its star.
    pub(crate) fn name_outline(&mut self, slot: u32) -> Result<(), DecodeError> {
        if self.vertex_at.contains_key(&slot) {
            return Err(DecodeError::new("chunk", "a seed vertex is given twice"));
        }
        if self.vertices.len() > 3 * MAX_LOCAL_FACES {
            return Err(DecodeError::new("chunk", "too many seeds"));
        }
        self.old_vertex(slot, false);
        Ok(())
    }

    /// What the other corners of a face say about whether a corner is interior, 0 to 8: each is
    /// unknown, outside or inside.
    fn outlook(&self, wedges: &[u32; 3], k: usize) -> usize {
        let mut context = 0;
        for other in [(k + 1) % 3, (k + 2) % 3] {
            let slot = self.mesh.wedges[wedges[other] as usize].vertex;
            let known = self.vertex_at.get(&slot).map(|&v| self.vertices[v as usize].interior);
            context = context * 3 + known.map_or(0, |inside| 1 + usize::from(inside));
        }
        context
    }

    fn old_vertex(&mut self, slot: u32, interior: bool) -> u32 {
        let local = self.vertices.len() as u32;
        self.vertex_at.insert(slot, local);
        self.push_vertex(self.mesh.vertex_id(slot), self.mesh.positions[slot as usize], interior, None)
    }

    fn old_wedge(&mut self, slot: u32, vertex: u32) -> u32 {
        if let Some(&known) = self.wedge_at.get(&slot) {
            return known;
        }
        let wedge = self.mesh.wedges[slot as usize];
        let local = self.push_wedge(self.mesh.wedge_id(slot), vertex, wedge.attributes);
        self.wedge_at.insert(slot, local);
        local
    }

    pub(crate) fn add_vertex(&mut self, position: [i32; 3], parent: Option<u32>) -> u32 {
        let id = Id { origin: self.own, index: self.new_vertices };
        self.new_vertices += 1;
        let parent = parent.map(|t| self.vertices[t as usize].id);
        self.push_vertex(id, position, true, parent)
    }

    pub(crate) fn add_wedge(&mut self, vertex: u32, attributes: Attributes) -> u32 {
        let id = Id { origin: self.own, index: self.new_wedges };
        self.new_wedges += 1;
        self.push_wedge(id, vertex, attributes)
    }

    /// Adds a face; its wedges and material must be set before the next split.
    pub(crate) fn add_face(&mut self, corners: [u32; 3]) -> u32 {
        let id = Id { origin: self.own, index: self.new_faces };
        self.new_faces += 1;
        let wedges = [NO_WEDGE; 3];
        self.push_face(LocalFace { id, wedges, corners, material: 0, before: wedges })
    }

    fn push_vertex(&mut self, id: Id, position: [i32; 3], interior: bool, parent: Option<Id>) -> u32 {
        self.vertices.push(LocalVertex {
            id,
            position,
            interior,
            parent,
            sum: [0; 3],
            ends: 0,
            first_wedge: NO_WEDGE,
            last_wedge: NO_WEDGE,
        });
        self.stars.grow(self.vertices.len(), 0);
        (self.vertices.len() - 1) as u32
    }

    fn push_wedge(&mut self, id: Id, vertex: u32, attributes: Attributes) -> u32 {
        let local = self.wedges.len() as u32;
        self.wedges.push(LocalWedge { id, vertex, attributes, next: NO_WEDGE });
        let owner = &mut self.vertices[vertex as usize];
        match owner.last_wedge {
            NO_WEDGE => owner.first_wedge = local,
            last => self.wedges[last as usize].next = local,
        }
        self.vertices[vertex as usize].last_wedge = local;
        local
    }

    fn push_face(&mut self, face: LocalFace) -> u32 {
        let local = self.faces.len() as u32;
        self.stars.grow(0, self.faces.len() + 1);
        for (k, &v) in face.corners.iter().enumerate() {
            self.stars.insert(v, local * 3 + k as u32);
            let ends = [face.corners[(k + 1) % 3], face.corners[(k + 2) % 3]];
            self.count_ends(v, ends, 1);
        }
        self.faces.push(face);
        local
    }

    /// Adds or takes away the far ends of a face's edges at a vertex.
    fn count_ends(&mut self, vertex: u32, ends: [u32; 2], sign: i64) {
        let [a, b] = ends.map(|v| self.vertices[v as usize].position);
        let vertex = &mut self.vertices[vertex as usize];
        for axis in 0..3 {
            vertex.sum[axis] += sign * (i64::from(a[axis]) + i64::from(b[axis]));
        }
        vertex.ends = if sign > 0 { vertex.ends + 2 } else { vertex.ends - 2 };
    }

    /// Moves corner `k` of a face to another vertex at the same place. Its wedge must be set before the
    /// next split.
    pub(crate) fn move_corner(&mut self, face: u32, k: u8, to: u32) {
        let k = usize::from(k);
        let corners = self.faces[face as usize].corners;
        let from = corners[k];
        let corner = face * 3 + k as u32;
        self.stars.remove(from, corner);
        self.stars.insert(to, corner);
        let ends = [corners[(k + 1) % 3], corners[(k + 2) % 3]];
        self.count_ends(from, ends, -1);
        self.count_ends(to, ends, 1);
        self.faces[face as usize].corners[k] = to;
    }

    /// Puts a vertex in its place.
    pub(crate) fn place_vertex(&mut self, vertex: u32, position: [i32; 3]) {
        let before = std::mem::replace(&mut self.vertices[vertex as usize].position, position);
        let moved = [0, 1, 2].map(|k| i64::from(position[k]) - i64::from(before[k]));
        for corner in self.stars.corners(vertex) {
            let corners = self.faces[(corner / 3) as usize].corners;
            let k = (corner % 3) as usize;
            for end in [corners[(k + 1) % 3], corners[(k + 2) % 3]] {
                for (sum, moved) in self.vertices[end as usize].sum.iter_mut().zip(moved) {
                    *sum += moved;
                }
            }
        }
    }

    /// Mean of the far ends of the edges at a vertex, each face counted, leaving out `without` of
    /// them that are at `at`.
    pub(crate) fn mean_of_ends(&self, vertex: u32, without: u32, at: [i32; 3]) -> Option<Vec3> {
        let v = &self.vertices[vertex as usize];
        let count = v.ends.checked_sub(without).filter(|&c| c > 0)?;
        let inverse = 1.0 / f64::from(count);
        Some([0, 1, 2].map(|k| (v.sum[k] - i64::from(without) * i64::from(at[k])) as f64 * inverse))
    }

    pub(crate) fn set_wedge(&mut self, face: u32, k: u8, wedge: u32) {
        self.faces[face as usize].wedges[usize::from(k)] = wedge;
    }

    /// Gives a new face its wedges and material.
    pub(crate) fn set_face(&mut self, face: u32, wedges: [u32; 3], material: u16) {
        let face = &mut self.faces[face as usize];
        (face.wedges, face.before, face.material) = (wedges, wedges, material);
    }

    pub(crate) fn position(&self, vertex: u32) -> [f64; 3] {
        self.vertices[vertex as usize].position.map(f64::from)
    }

    pub(crate) fn valence(&self, vertex: u32) -> usize {
        self.vertices[vertex as usize].ends as usize / 2
    }

    /// The star of a vertex, in an order that depends on nothing but the chunk.
    pub(crate) fn star(&self, vertex: u32, star: &mut Vec<Spoke>) {
        star.clear();
        for corner in self.stars.corners(vertex) {
            let (face, k) = (corner / 3, (corner % 3) as usize);
            let corners = self.faces[face as usize].corners;
            star.push(Spoke { face, k: k as u8, a: corners[(k + 1) % 3], b: corners[(k + 2) % 3] });
        }
    }

    /// The wedge of a spoke at the centre, and at its vertices `a` and `b`.
    pub(crate) fn spoke_wedges(&self, spoke: &Spoke) -> [u32; 3] {
        let k = usize::from(spoke.k);
        let wedges = self.faces[spoke.face as usize].wedges;
        [wedges[k], wedges[(k + 1) % 3], wedges[(k + 2) % 3]]
    }

    /// The wedges of a vertex that are known here, in order of discovery.
    pub(crate) fn wedges_of(&self, vertex: u32) -> Vec<u32> {
        let mut list = Vec::new();
        let mut at = self.vertices[vertex as usize].first_wedge;
        while at != NO_WEDGE {
            list.push(at);
            at = self.wedges[at as usize].next;
        }
        list
    }

    /// Sum of the areas (doubled) of a vertex's faces that are known here, in square cells.
    pub(crate) fn star_area(&self, vertex: u32) -> f64 {
        self.stars.corners(vertex).map(|c| self.face_area(c / 3)).sum()
    }

    /// Twice the area of a face, in square cells.
    pub(crate) fn face_area(&self, face: u32) -> f64 {
        let [a, b, c] = self.faces[face as usize].corners.map(|v| self.position(v));
        length(triangle_normal(a, b, c))
    }

    /// What the chunk has done, in canonical ids.
    pub(crate) fn into_delta(self, chunk: u32, parents: Vec<u32>) -> ChunkDelta {
        let own = self.own;
        let wedge_id = |w: u32| self.wedges[w as usize].id;
        let mut delta = ChunkDelta { chunk, parents, ..ChunkDelta::default() };
        for v in self.vertices.iter().filter(|v| v.id.origin == own) {
            delta.vertices.push(NewVertex { position: v.position, parent: v.parent });
        }
        for w in self.wedges.iter().filter(|w| w.id.origin == own) {
            delta
                .wedges
                .push(NewWedge { vertex: self.vertices[w.vertex as usize].id, attributes: w.attributes });
        }
        for f in &self.faces {
            if f.id.origin == own {
                delta.faces.push(NewFace { wedges: f.wedges.map(wedge_id), material: f.material });
                continue;
            }
            for k in (0..3).filter(|&k| f.wedges[k] != f.before[k]) {
                delta.repoints.push(Repoint {
                    face: f.id,
                    corner: k as u8,
                    from: wedge_id(f.before[k]),
                    to: wedge_id(f.wedges[k]),
                });
            }
        }
        delta
    }
}
