//! The mesh during simplification, with adjacency and quadrics.

use std::collections::HashMap;

use crate::collapse::Placed;
use crate::entropy::Codec;
use crate::mesh::corner;
use crate::mesh::orientation_class::ORIENTATION_CLASSES;
use crate::mesh::vec3::{Vec3, add, cross, dot, length, scale, sub, triangle_normal};
use crate::mesh::wedges::Wedges;
use crate::mesh::{Attributes, QuantisedMesh, Wedge};
use crate::simplify::quadric::Quadric;
use crate::simplify::star_table::{StarTable, each_edge};

/// Weight of the constraint plane of a boundary edge, per squared edge length.
const BOUNDARY_WEIGHT: f64 = 10.0;
/// Weight of the constraint plane of an edge where uv, normal group or material change.
const SEAM_WEIGHT: f64 = 1.0;

/// Longest chain of collapses followed to find a vertex's successor.
const MAX_HOPS: usize = 10_000;

/// The remaining mesh at some point of simplification, in the input's ids.
pub(crate) struct Live<'a> {
    mesh: &'a QuantisedMesh,
    /// Positions in grid cells relative to the centre of the grid.
    pub(crate) positions: Vec<Vec3>,
    pub(crate) quadrics: Vec<Quadric>,
    /// Known number of zero low bits of each vertex's cell.
    pub(crate) shifts: Vec<u8>,
    /// Half the grid: position + this = cell.
    middle: f64,
    /// Bits per axis.
    bits: u8,
    /// Wedges; a collapse adds one if a moved wedge meets none at its new vertex.
    pub(crate) wedges: Wedges<'a>,
    /// Next unused normal group of each vertex.
    next_group: Vec<u32>,
    /// With the axis-aligned codec, groups are orientation classes ([`crate::mesh::orientation_class`]): the newest
    /// copy number, by vertex and class, that collapses have created.
    copies_by_class: Option<HashMap<(u32, u32), u32>>,
    /// Corners of each face, as wedges and as vertices; meaningless for removed faces.
    pub(crate) face_wedges: Vec<[u32; 3]>,
    pub(crate) face_vertices: Vec<[u32; 3]>,
    pub(crate) alive: Vec<bool>,
    /// The vertex that a removed vertex was collapsed to; itself for existing vertices.
    pub(crate) moved_to: Vec<u32>,
    /// Upper bound on the distance between a vertex and the input vertices collapsed to it.
    pub(crate) reach: Vec<f64>,
    /// As of the last [`Live::settle`].
    pub(crate) stars: StarTable,
    /// Live faces, ascending.
    pub(crate) faces: Vec<u32>,
}

impl<'a> Live<'a> {
    pub(crate) fn new(mesh: &'a QuantisedMesh, codec: Codec) -> Self {
        let middle = f64::from(1_u32 << mesh.grid.bits) * 0.5;
        let positions: Vec<Vec3> = mesh.positions.iter().map(|p| p.map(|x| f64::from(x) - middle)).collect();
        let face_wedges: Vec<[u32; 3]> = mesh.faces.iter().map(|f| f.wedges).collect();
        let face_vertices: Vec<[u32; 3]> =
            face_wedges.iter().map(|w| w.map(|w| mesh.wedges[w as usize].vertex)).collect();
        let mut next_group = vec![0; positions.len()];
        for wedge in &mesh.wedges {
            let next: &mut u32 = &mut next_group[wedge.vertex as usize];
            *next = (*next).max(wedge.attributes.group + 1);
        }
        let mut live = Self {
            mesh,
            moved_to: (0..positions.len() as u32).collect(),
            quadrics: vec![Quadric::default(); positions.len()],
            shifts: vec![0; positions.len()],
            middle,
            bits: mesh.grid.bits,
            positions,
            wedges: Wedges::new(&mesh.wedges),
            copies_by_class: (codec == Codec::AxisAligned).then(HashMap::new),
            next_group,
            alive: vec![true; face_wedges.len()],
            reach: vec![0.0; mesh.positions.len()],
            faces: (0..face_wedges.len() as u32).collect(),
            face_wedges,
            face_vertices,
            stars: StarTable::default(),
        };
        live.settle();
        live.add_quadrics();
        live
    }

    /// Position of a vertex; the last one if it was removed.
    pub(crate) fn placed(&self, vertex: u32) -> Placed {
        Placed { vertex, cell: self.cell(vertex), shift: self.shifts[vertex as usize] }
    }

    /// The cell of a vertex.
    pub(crate) fn cell(&self, vertex: u32) -> [i32; 3] {
        self.positions[vertex as usize].map(|x| (x + self.middle) as i32)
    }

    /// The position of a cell.
    pub(crate) fn position(&self, cell: [i32; 3]) -> Vec3 {
        cell.map(|x| f64::from(x) - self.middle)
    }

    /// The point nearest to `position` whose cell has `shift` zero low bits.
    pub(crate) fn on_grid(&self, position: Vec3, shift: u8) -> Vec3 {
        let most = (((1_i32 << self.bits) - 1) >> shift) << shift;
        let half = f64::from((1_i32 << shift) >> 1);
        position.map(|x| {
            let cell = (x + self.middle + half).max(0.0) as i32;
            f64::from(((cell >> shift) << shift).min(most)) - self.middle
        })
    }

    /// The input.
    pub(crate) fn mesh(&self) -> &'a QuantisedMesh {
        self.mesh
    }

    /// Half the grid: what is added to a position to get its cell.
    pub(crate) fn middle(&self) -> f64 {
        self.middle
    }

    pub(crate) fn bits(&self) -> u8 {
        self.bits
    }

    pub(crate) fn triangle(&self, face: usize) -> [Vec3; 3] {
        self.face_vertices[face].map(|v| self.positions[v as usize])
    }

    pub(crate) fn centroid(&self, face: usize) -> Vec3 {
        let [a, b, c] = self.triangle(face);
        scale(add(add(a, b), c), 1.0 / 3.0)
    }

    /// Whether two faces are equal or share an edge.
    pub(crate) fn share_an_edge(&self, a: u32, b: u32) -> bool {
        let [a, b] = [a, b].map(|f| self.face_vertices[f as usize]);
        a.into_iter().filter(|v| b.contains(v)).count() > 1
    }

    /// Frees what only simplification needs.
    pub(crate) fn finish(&mut self) {
        self.quadrics = Vec::new();
        self.reach = Vec::new();
        self.next_group = Vec::new();
        self.copies_by_class = None;
        self.moved_to = Vec::new();
        self.face_vertices = Vec::new();
        self.stars = StarTable::default();
    }

    /// Frees what only the base mesh needs; vertex positions and wedges stay.
    pub(crate) fn forget_faces(&mut self) {
        self.face_wedges = Vec::new();
        self.alive = Vec::new();
        self.faces = Vec::new();
    }

    /// The corner positions of a face in the input.
    pub(crate) fn first_triangle(&self, face: u32) -> [Vec3; 3] {
        let vertex = |wedge: u32| self.mesh.wedges[wedge as usize].vertex;
        let wedges = self.mesh.faces[face as usize].wedges;
        wedges.map(|wedge| self.position(self.mesh.positions[vertex(wedge) as usize]))
    }

    /// Whether the mesh is divided into parts.
    pub(crate) fn has_parts(&self) -> bool {
        !self.mesh.parts.is_empty()
    }

    /// The material of a face.
    pub(crate) fn material(&self, face: u32) -> u16 {
        self.mesh.faces[face as usize].material
    }

    /// The vertex that an input vertex was collapsed to.
    pub(crate) fn successor(&self, mut vertex: u32) -> u32 {
        // Bounded, because deliberately unlocked outlines can create cycles.
        for _ in 0..MAX_HOPS {
            let next = self.moved_to[vertex as usize];
            if next == vertex {
                break;
            }
            vertex = next;
        }
        vertex
    }

    /// Adds a wedge at `vertex` with the attributes of `source` and a new normal group.
    pub(crate) fn add_wedge(&mut self, vertex: u32, source: u32) -> u32 {
        let attributes = self.wedges.get(source).attributes;
        let group = match &self.copies_by_class {
            Some(copies_by_class) => {
                let side = attributes.group % ORIENTATION_CLASSES;
                let known = copies_by_class.get(&(vertex, side)).copied();
                side + ORIENTATION_CLASSES
                    * (known.unwrap_or(self.next_group[vertex as usize] / ORIENTATION_CLASSES) + 1)
            }
            None => self.next_group[vertex as usize],
        };
        let attributes = Attributes { group, ..attributes };
        self.take_group(vertex, group);
        self.wedges.push(Wedge { vertex, attributes })
    }

    /// Restores a wedge that [`Self::add_wedge`] created earlier.
    pub(crate) fn restore_wedge(&mut self, wedge: Wedge) {
        self.take_group(wedge.vertex, wedge.attributes.group);
        self.wedges.push(wedge);
    }

    /// Marks a vertex's group as used.
    fn take_group(&mut self, vertex: u32, group: u32) {
        match &mut self.copies_by_class {
            Some(copies_by_class) => {
                let newest = copies_by_class.entry((vertex, group % ORIENTATION_CLASSES)).or_default();
                *newest = (*newest).max(group / ORIENTATION_CLASSES);
            }
            None => self.next_group[vertex as usize] = group + 1,
        }
    }

    /// Updates face list and stars after collapses.
    pub(crate) fn settle(&mut self) {
        self.faces.retain(|&f| self.alive[f as usize]);
        self.stars.rebuild(self.positions.len(), &self.faces, &self.face_vertices);
    }

    fn add_quadrics(&mut self) {
        for face in 0..self.face_wedges.len() {
            let [a, b, c] = self.triangle(face);
            let normal = triangle_normal(a, b, c);
            let double_area = length(normal);
            if double_area > 0.0 {
                let plane = Quadric::plane(scale(normal, 1.0 / double_area), a, double_area * 0.5);
                for v in self.face_vertices[face] {
                    self.quadrics[v as usize].add(&plane);
                }
            }
        }
        let mut held: Vec<(u32, u32, u32, f64)> = Vec::new();
        each_edge(&self.stars, &self.face_vertices, &mut |v, w, run| {
            let weight = if run.len() == 1 {
                BOUNDARY_WEIGHT
            } else if run.iter().any(|&c| self.edge_attributes(c) != self.edge_attributes(run[0])) {
                SEAM_WEIGHT
            } else {
                return;
            };
            held.extend(run.iter().map(|&corner| (v, w, corner::face_of(corner), weight)));
        });
        for (v, w, face, weight) in held {
            self.add_edge_plane(v, w, face as usize, weight);
        }
    }

    /// The plane through an edge, perpendicular to one of its faces.
    fn add_edge_plane(&mut self, v: u32, w: u32, face: usize, weight: f64) {
        let [a, b, c] = self.triangle(face);
        let edge = sub(self.positions[w as usize], self.positions[v as usize]);
        let across = cross(edge, triangle_normal(a, b, c));
        let size = length(across);
        if size > 0.0 {
            let plane = Quadric::plane(
                scale(across, 1.0 / size),
                self.positions[v as usize],
                dot(edge, edge) * weight,
            );
            self.quadrics[v as usize].add(&plane);
            self.quadrics[w as usize].add(&plane);
        }
    }

    /// The values that differ across a seam edge: both wedges and the material, independent of the direction of the
    /// edge.
    fn edge_attributes(&self, corner: u32) -> (u32, u32, u16) {
        let (face, k) = (corner::face_of(corner) as usize, corner::side_of(corner));
        let (a, b) = (self.face_wedges[face][k], self.face_wedges[face][corner::next(k)]);
        (a.min(b), a.max(b), self.material(face as u32))
    }
}
