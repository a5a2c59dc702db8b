//! A chunk's region as its decoder sees it: the stars of the region's interior vertices.
//!
//! It is gathered from the mesh (`codec::gather`) by breadth-first search over interior vertices. The numbering depends
//! on the chunk only: the region's stars are the same for any other chunks applied, in any order
//! (docs/design/refinement.md, "Why any order gives one mesh").
//!
//! Positions are integers below 2^24 stored as `f64`, so their sums and differences are exact.

use crate::codec::elements::Elements;
use crate::codec::fan::StarFace;
use crate::codec::gather_buffers::GatherBuffers;
use crate::codec::star::{Star, Stars};
use crate::mesh::Attributes;
use crate::mesh::corner::Spaced;
use crate::mesh::skin::Skin;
use crate::mesh::slot_map::SlotMap;
use crate::mesh::vec3::{Vec3, add, cross, length, scale, sub};
use crate::numbers::{id32, inverse, truncated};
use crate::refine::{ActiveMesh, Id, MovedVertex, Owners};

/// Most faces of a region: bounds the work that an untrusted peer's chunk can cause.
pub(crate) const MAX_LOCAL_FACES: usize = 1 << 18;

pub(crate) struct LocalVertex {
    pub(crate) position: Vec3,
    /// Sum of the other corners' positions over the faces of the star, two per face.
    sum: Vec3,
    star: Star,
    pub(crate) interior: bool,
    /// Largest known number of low bits of its position that are zero.
    pub(crate) shift: u8,
}

pub(crate) struct LocalWedge {
    pub(crate) id: Id,
    pub(crate) vertex: u32,
    /// Slot in the mesh; [`NONE`] for a new one.
    pub(crate) slot: u32,
    pub(crate) attributes: Attributes,
    next: u32,
}

pub(crate) struct LocalFace {
    pub(crate) corners: [u32; 3],
    pub(crate) wedges: [u32; 3],
}

impl LocalVertex {
    /// Faces around it.
    #[inline]
    pub(crate) fn valence(&self) -> usize {
        self.star.len()
    }
}

/// An existing face with its wedges before the chunk.
pub(crate) struct ExistingFace {
    pub(crate) id: Id,
    pub(crate) wedges: [u32; 3],
}

pub(crate) const NONE: u32 = u32::MAX;

/// Buffers of a region, reused from chunk to chunk.
#[derive(Default)]
pub(crate) struct LocalMemory {
    vertices: Vec<LocalVertex>,
    wedges: Vec<LocalWedge>,
    faces: Vec<LocalFace>,
    areas: Vec<f64>,
    materials: Vec<u16>,
    stars: Stars,
    wedge_ends: Vec<[u32; 2]>,
    vertex_ids: Vec<Id>,
    gathered: Vec<ExistingFace>,
    vertex_at: SlotMap,
    wedge_at: SlotMap,
    new_vertices: Vec<(u32, Option<u32>)>,
    isolated_parts: Vec<u32>,
    new_skins: Vec<Skin>,
    gather_buffers: GatherBuffers,
}

impl LocalMemory {
    /// Memory held, in bytes.
    pub(crate) fn bytes(&self) -> usize {
        self.vertices.capacity() * size_of::<LocalVertex>()
            + self.wedges.capacity() * size_of::<LocalWedge>()
            + self.faces.capacity() * size_of::<LocalFace>()
            + self.areas.capacity() * size_of::<f64>()
            + self.materials.capacity() * 2
            + self.stars.bytes()
            + (self.wedge_ends.capacity() + self.vertex_ids.capacity()) * 8
            + self.gathered.capacity() * size_of::<ExistingFace>()
            + self.vertex_at.bytes()
            + self.wedge_at.bytes()
            + self.new_vertices.capacity() * 12
            + self.isolated_parts.capacity() * 4
            + self.new_skins.capacity() * size_of::<Skin>()
            + self.gather_buffers.bytes()
    }
}

/// The region, in local numbers; new elements are appended.
pub(crate) struct Local<'a> {
    pub(crate) mesh: &'a ActiveMesh,
    pub(crate) owners: Owners<'a>,
    /// Owner id of the elements that the chunk adds.
    own: u32,
    pub(crate) vertices: Vec<LocalVertex>,
    pub(crate) wedges: Vec<LocalWedge>,
    pub(crate) faces: Vec<LocalFace>,
    /// Doubled areas of the faces, in square cells; a separate array, since area sums read nothing else.
    areas: Vec<f64>,
    pub(crate) materials: Vec<u16>,
    stars: Stars,
    /// First and last known wedge of each vertex; the others follow by `LocalWedge::next`.
    pub(crate) wedge_ends: Vec<[u32; 2]>,
    vertex_ids: Vec<Id>,
    /// The existing faces, which are the first ones.
    pub(crate) gathered: Vec<ExistingFace>,
    pub(crate) vertex_at: SlotMap,
    /// Local numbers of existing wedges other than each vertex's first.
    pub(crate) wedge_at: SlotMap,
    pub(crate) gather_buffers: GatherBuffers,
    /// New vertices, with the vertex that each splits from.
    pub(crate) new_vertices: Vec<(u32, Option<u32>)>,
    /// Parts of the new vertices without faces, which come first; empty if the asset is one part.
    pub(crate) isolated_parts: Vec<u32>,
    /// Skins of the new vertices; empty if the asset has none.
    pub(crate) new_skins: Vec<Skin>,
    pub(crate) new_wedges: u32,
    /// Older vertices that the chunk moves.
    pub(crate) moves: Vec<MovedVertex>,
}

impl<'a> Local<'a> {
    /// An empty region of a chunk, which takes the buffers of `memory`.
    pub(crate) fn new(mesh: &'a ActiveMesh, chunk: u32, memory: LocalMemory) -> Self {
        let mut local = Self {
            mesh,
            owners: Owners::new(&mesh.applied),
            own: chunk + 1,
            vertices: memory.vertices,
            wedges: memory.wedges,
            faces: memory.faces,
            areas: memory.areas,
            materials: memory.materials,
            stars: memory.stars,
            wedge_ends: memory.wedge_ends,
            vertex_ids: memory.vertex_ids,
            gathered: memory.gathered,
            vertex_at: memory.vertex_at,
            wedge_at: memory.wedge_at,
            gather_buffers: memory.gather_buffers,
            new_vertices: memory.new_vertices,
            isolated_parts: memory.isolated_parts,
            new_skins: memory.new_skins,
            new_wedges: 0,
            moves: Vec::new(),
        };
        local.vertices.clear();
        local.wedges.clear();
        local.faces.clear();
        local.areas.clear();
        local.materials.clear();
        local.stars.clear();
        local.wedge_ends.clear();
        local.vertex_ids.clear();
        local.gathered.clear();
        local.vertex_at.clear();
        local.wedge_at.clear();
        local.new_vertices.clear();
        local.isolated_parts.clear();
        local.new_skins.clear();
        local
    }

    /// Returns the buffers, for another chunk.
    pub(crate) fn memory(self) -> LocalMemory {
        LocalMemory {
            vertices: self.vertices,
            wedges: self.wedges,
            faces: self.faces,
            areas: self.areas,
            materials: self.materials,
            stars: self.stars,
            wedge_ends: self.wedge_ends,
            vertex_ids: self.vertex_ids,
            gathered: self.gathered,
            vertex_at: self.vertex_at,
            wedge_at: self.wedge_at,
            gather_buffers: self.gather_buffers,
            new_vertices: self.new_vertices,
            isolated_parts: self.isolated_parts,
            new_skins: self.new_skins,
        }
    }

    /// Elements added so far.
    pub(crate) fn added(&self) -> Elements {
        let faces = self.faces.len() - self.gathered.len();
        Elements { vertices: id32(self.new_vertices.len()), wedges: self.new_wedges, faces: id32(faces) }
    }

    pub(crate) fn add_vertex(&mut self, position: Vec3, parent: Option<u32>, shift: u8) -> u32 {
        let id = Id { owner: self.own, index: id32(self.new_vertices.len()) };
        self.new_vertices.push((id32(self.vertices.len()), parent));
        self.push_vertex(id, position, true, shift)
    }

    pub(crate) fn add_wedge(&mut self, vertex: u32, attributes: Attributes) -> u32 {
        let id = Id { owner: self.own, index: self.new_wedges };
        self.new_wedges += 1;
        self.push_wedge(id, NONE, vertex, attributes)
    }

    /// Adds a degenerate face, two of whose corners coincide. Its wedges and material must be set before the next
    /// split.
    pub(crate) fn add_face(&mut self, corners: [u32; 3]) -> u32 {
        self.push_face(LocalFace { corners, wedges: [NONE; 3] }, 0.0, 0)
    }

    pub(crate) fn push_vertex(&mut self, id: Id, position: Vec3, interior: bool, shift: u8) -> u32 {
        let star = Star::default();
        self.vertices.push(LocalVertex { position, sum: [0.0; 3], star, interior, shift });
        self.vertex_ids.push(id);
        self.wedge_ends.push([NONE; 2]);
        id32(self.vertices.len() - 1)
    }

    pub(crate) fn push_wedge(&mut self, id: Id, slot: u32, vertex: u32, attributes: Attributes) -> u32 {
        let local = id32(self.wedges.len());
        self.wedges.push(LocalWedge { id, vertex, slot, attributes, next: NONE });
        let [first, last] = &mut self.wedge_ends[vertex as usize];
        match *last {
            NONE => *first = local,
            before => self.wedges[before as usize].next = local,
        }
        *last = local;
        local
    }

    pub(crate) fn push_face(&mut self, face: LocalFace, area: f64, material: u16) -> u32 {
        let local = id32(self.faces.len());
        let [a, b, c] = face.corners;
        let [p, q, r] = face.corners.map(|v| self.position(v));
        self.faces.push(face);
        self.areas.push(area);
        self.materials.push(material);
        for (k, v, ends) in [(0, a, add(q, r)), (1, b, add(r, p)), (2, c, add(p, q))] {
            let vertex = &mut self.vertices[v as usize];
            vertex.sum = add(vertex.sum, ends);
            self.stars.push(&mut vertex.star, Spaced::new(local, k));
        }
        local
    }

    /// Moves the centre corners of star faces from one vertex to another at the same position. Their wedges must be
    /// set before the next split.
    pub(crate) fn move_corners<'s>(
        &mut self,
        star_faces: impl Iterator<Item = &'s StarFace>,
        from: u32,
        to: u32,
    ) {
        let Self { vertices, faces, stars, .. } = self;
        let mut ends = [0.0; 3];
        let mut star = vertices[to as usize].star;
        for star_face in star_faces {
            let (a, b) = (&vertices[star_face.a as usize], &vertices[star_face.b as usize]);
            ends = add(ends, add(a.position, b.position));
            faces[star_face.face as usize].corners[usize::from(star_face.k)] = to;
            stars.push(&mut star, Spaced::new(star_face.face, star_face.k));
        }
        let vertex = &mut vertices[to as usize];
        (vertex.star, vertex.sum) = (star, add(vertex.sum, ends));
        let vertex = &mut vertices[from as usize];
        vertex.sum = sub(vertex.sum, ends);
        stars.remove_if(&mut vertex.star, |c| faces[c.face() as usize].corners[usize::from(c.side())] == to);
    }

    /// Moves an older vertex whose star is given.
    pub(crate) fn move_vertex(&mut self, vertex: u32, star: &[StarFace], position: [i32; 3], shift: u8) {
        let was = &self.vertices[vertex as usize];
        self.moves.push(MovedVertex {
            vertex: self.vertex_ids[vertex as usize],
            from: was.position.map(truncated),
            to: position,
            shifts: [was.shift, shift],
        });
        self.vertices[vertex as usize].shift = shift;
        self.place_vertex(vertex, star, position);
    }

    /// Sets the position of a vertex whose star is given.
    pub(crate) fn place_vertex(&mut self, vertex: u32, star: &[StarFace], position: [i32; 3]) {
        let position = position.map(f64::from);
        let before = std::mem::replace(&mut self.vertices[vertex as usize].position, position);
        let moved = sub(position, before);
        for star_face in star {
            let mut at = |end: u32| {
                let end = &mut self.vertices[end as usize];
                end.sum = add(end.sum, moved);
                sub(end.position, position)
            };
            // Coordinates are integers, so the cross product is exact and equal at every corner.
            let (a, b) = (at(star_face.a), at(star_face.b));
            self.areas[star_face.face as usize] = length(cross(a, b));
        }
    }

    /// Mean of the other corners over a vertex's faces, leaving out `without` of them that are at `at`.
    #[inline]
    pub(crate) fn mean_of_ends(&self, vertex: u32, without: u32, at: Vec3) -> Option<Vec3> {
        let v = &self.vertices[vertex as usize];
        let count = id32(2 * v.star.len()).checked_sub(without).filter(|&c| c > 0)?;
        Some(scale(sub(v.sum, scale(at, f64::from(without))), inverse(count)))
    }

    /// The wedge at a corner of a face.
    #[inline]
    pub(crate) fn wedge(&self, face: u32, k: u8) -> u32 {
        self.faces[face as usize].wedges[usize::from(k)]
    }

    pub(crate) fn set_wedge(&mut self, face: u32, k: u8, wedge: u32) {
        self.faces[face as usize].wedges[usize::from(k)] = wedge;
    }

    /// Sets the wedges and material of a new face.
    pub(crate) fn set_face(&mut self, face: u32, wedges: [u32; 3], material: u16) {
        self.faces[face as usize].wedges = wedges;
        self.materials[face as usize] = material;
    }

    /// The material of a face.
    pub(crate) fn material(&self, face: u32) -> u16 {
        self.materials[face as usize]
    }

    #[inline]
    pub(crate) fn position(&self, vertex: u32) -> Vec3 {
        self.vertices[vertex as usize].position
    }

    #[inline]
    pub(crate) fn valence(&self, vertex: u32) -> usize {
        self.vertices[vertex as usize].star.len()
    }

    /// The star of a vertex, newest face first: an order that depends on the chunk only.
    pub(crate) fn star(&self, vertex: u32, star: &mut Vec<StarFace>) {
        star.clear();
        star.extend(self.stars.of(self.vertices[vertex as usize].star).iter().rev().map(|corner| {
            let corners = &self.faces[corner.face() as usize].corners;
            let (a, b) = (corners[corner.next()], corners[corner.previous()]);
            StarFace { face: corner.face(), k: corner.side(), a, b }
        }));
    }

    /// Sum of the doubled areas of a vertex's faces, in star order, in square cells.
    #[inline]
    pub(crate) fn star_area(&self, vertex: u32) -> f64 {
        let corners = self.stars.of(self.vertices[vertex as usize].star);
        corners.iter().rev().fold(0.0, |area, corner| area + self.areas[corner.face() as usize])
    }

    /// The wedges of a star face at the centre, and at its vertices `a` and `b`.
    pub(crate) fn spoke_wedges(&self, star_face: &StarFace) -> [u32; 3] {
        let wedges = &self.faces[star_face.face as usize].wedges;
        let corner = Spaced::new(star_face.face, star_face.k);
        [wedges[usize::from(star_face.k)], wedges[corner.next()], wedges[corner.previous()]]
    }

    /// The first known wedge of a vertex, in order of discovery.
    #[inline]
    pub(crate) fn first_wedge(&self, vertex: u32) -> Option<u32> {
        Some(self.wedge_ends[vertex as usize][0]).filter(|&w| w != NONE)
    }

    /// The known wedges of a vertex, in order of discovery.
    pub(crate) fn wedges_of(&self, vertex: u32) -> impl Iterator<Item = u32> {
        std::iter::successors(self.first_wedge(vertex), |&w| {
            Some(self.wedges[w as usize].next).filter(|&w| w != NONE)
        })
    }

    /// Twice the area of a face, in square cells.
    #[inline]
    pub(crate) fn face_area(&self, face: u32) -> f64 {
        self.areas[face as usize]
    }

    /// The skin of a vertex; the default of one without.
    pub(crate) fn skin(&self, vertex: u32) -> Skin {
        let id = self.vertex_id(vertex);
        let skin = if id.owner == self.own {
            self.new_skins.get(id.index as usize)
        } else {
            self.mesh.skins.get(self.mesh.vertex_slot(id) as usize)
        };
        skin.copied().unwrap_or_default()
    }

    /// The id of a vertex.
    pub(crate) fn vertex_id(&self, vertex: u32) -> Id {
        self.vertex_ids[vertex as usize]
    }

    /// Ids of the existing faces, in order of their numbers.
    pub(crate) fn gathered_faces(&self) -> impl ExactSizeIterator<Item = Id> {
        self.gathered.iter().map(|f| f.id)
    }
}
