//! The mesh while it is being simplified: what is left of it, with adjacency and quadrics.

use crate::mesh::{Attributes, QuantisedMesh, Wedge};
use crate::simplify::quadric::Quadric;
use crate::stars::Stars;
use crate::vec3::{Vec3, add, cross, dot, length, scale, sub, triangle_normal};

/// Weight of the plane that holds a boundary edge in place, per squared edge length.
const BOUNDARY_WEIGHT: f64 = 10.0;
/// The same for an edge where uv, normal group or material jump.
const SEAM_WEIGHT: f64 = 1.0;

/// A vertex that no collapse has removed has no parent.
pub(crate) const NO_VERTEX: u32 = u32::MAX;

/// What is left of a mesh at some point of its simplification. Ids are the input's throughout.
pub(crate) struct Live {
    /// Positions in grid cells about the middle of the grid.
    pub(crate) positions: Vec<Vec3>,
    pub(crate) quadrics: Vec<Quadric>,
    /// Wedges; grows when a collapse keeps a wedge that meets none at its new vertex.
    pub(crate) wedges: Vec<Wedge>,
    /// Next unused normal group of each vertex.
    next_group: Vec<u32>,
    /// Corners of each face, as wedges and as vertices; meaningless for dead faces.
    pub(crate) face_wedges: Vec<[u32; 3]>,
    pub(crate) face_vertices: Vec<[u32; 3]>,
    pub(crate) material: Vec<u16>,
    pub(crate) alive: Vec<bool>,
    /// Where a removed vertex was collapsed to; itself while it is there.
    pub(crate) moved_to: Vec<u32>,
    pub(crate) stars: Stars,
    pub(crate) face_count: usize,
}

impl Live {
    pub(crate) fn new(mesh: &QuantisedMesh) -> Self {
        let middle = f64::from(1_u32 << mesh.grid.bits) * 0.5;
        let positions: Vec<Vec3> = mesh.positions.iter().map(|p| p.map(|x| f64::from(x) - middle)).collect();
        let face_wedges: Vec<[u32; 3]> = mesh.faces.iter().map(|f| f.wedges).collect();
        let face_vertices: Vec<[u32; 3]> =
            face_wedges.iter().map(|w| w.map(|w| mesh.wedges[w as usize].vertex)).collect();
        let mut stars = Stars::new(positions.len(), face_wedges.len());
        for (face, vertices) in face_vertices.iter().enumerate().rev() {
            for (k, &vertex) in vertices.iter().enumerate() {
                stars.insert(vertex, (face * 3 + k) as u32);
            }
        }
        let mut next_group = vec![0; positions.len()];
        for wedge in &mesh.wedges {
            let next: &mut u32 = &mut next_group[wedge.vertex as usize];
            *next = (*next).max(wedge.attributes.group + 1);
        }
        let mut live = Self {
            moved_to: (0..positions.len() as u32).collect(),
            quadrics: vec![Quadric::default(); positions.len()],
            positions,
            wedges: mesh.wedges.clone(),
            next_group,
            material: mesh.faces.iter().map(|f| f.material).collect(),
            alive: vec![true; face_wedges.len()],
            face_count: face_wedges.len(),
            face_wedges,
            face_vertices,
            stars,
        };
        live.add_quadrics();
        live
    }

    pub(crate) fn triangle(&self, face: usize) -> [Vec3; 3] {
        self.face_vertices[face].map(|v| self.positions[v as usize])
    }

    pub(crate) fn centroid(&self, face: usize) -> Vec3 {
        let [a, b, c] = self.triangle(face);
        scale(add(add(a, b), c), 1.0 / 3.0)
    }

    /// A new wedge at `vertex` with the attributes of `source` and a normal group of its own.
    pub(crate) fn keep_wedge(&mut self, vertex: u32, source: u32) -> u32 {
        let group = self.next_group[vertex as usize];
        self.next_group[vertex as usize] += 1;
        let attributes = Attributes { group, ..self.wedges[source as usize].attributes };
        self.wedges.push(Wedge { vertex, attributes });
        (self.wedges.len() - 1) as u32
    }

    /// Calls `f` for every live face that shares an edge with `face`.
    pub(crate) fn edge_neighbours(&self, face: usize, f: &mut dyn FnMut(usize)) {
        let vertices = self.face_vertices[face];
        for k in 0..3 {
            let (a, b) = (vertices[k], vertices[(k + 1) % 3]);
            for corner in self.stars.corners(a) {
                let other = (corner / 3) as usize;
                if other != face && self.face_vertices[other].contains(&b) {
                    f(other);
                }
            }
        }
    }

    fn add_quadrics(&mut self) {
        let mut edges: Vec<(u32, u32, u32)> = Vec::with_capacity(self.face_wedges.len() * 3);
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
            for k in 0..3 {
                let (v, w) = (self.face_vertices[face][k], self.face_vertices[face][(k + 1) % 3]);
                edges.push((v.min(w), v.max(w), (face * 3 + k) as u32));
            }
        }
        edges.sort_unstable();
        for run in edges.chunk_by(|x, y| (x.0, x.1) == (y.0, y.1)) {
            let weight = if run.len() == 1 {
                BOUNDARY_WEIGHT
            } else if run.iter().any(|e| self.edge_attributes(e.2) != self.edge_attributes(run[0].2)) {
                SEAM_WEIGHT
            } else {
                continue;
            };
            for &(v, w, corner) in run {
                self.add_edge_plane(v, w, (corner / 3) as usize, weight);
            }
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

    /// What must agree across an edge for it not to be a seam: both wedges and the material, in an
    /// order that does not depend on the direction of the edge.
    fn edge_attributes(&self, corner: u32) -> (u32, u32, u16) {
        let (face, k) = ((corner / 3) as usize, (corner % 3) as usize);
        let (a, b) = (self.face_wedges[face][k], self.face_wedges[face][(k + 1) % 3]);
        (a.min(b), a.max(b), self.material[face])
    }
}
