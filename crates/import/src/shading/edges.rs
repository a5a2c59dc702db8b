//! Which faces meet at which edges, at what angle.

use std::collections::HashMap;

use glam::DVec3;
use lodestream_geometry::mesh::{NONE, SourceMesh};

use super::face::FaceShading;

/// The faces of a mesh around its vertices. Equal positions of a part are one vertex.
pub(super) struct Surface {
    /// Vertices of each face.
    vertices: Vec<[u32; 3]>,
    /// Twice the area times the normal of each face.
    normals: Vec<DVec3>,
    /// Where each vertex's corners begin in `corners`, and the end.
    starts: Vec<u32>,
    /// Face × 3 + corner.
    corners: Vec<u32>,
}

/// A side of an edge from a vertex, of a face around it.
struct Side {
    /// The edge's other vertex.
    to: u32,
    /// Whether the face has the edge from the vertex to the other.
    forward: bool,
    /// Index of the face around the vertex.
    at: u32,
}

/// Two faces that share an edge.
pub(super) struct Edge {
    pub(super) faces: [u32; 2],
    /// Cosine of the angle between their normals.
    pub(super) cosine: f64,
    pub(super) length: f64,
}

impl Surface {
    pub(super) fn new(mesh: &SourceMesh, shading: &[FaceShading]) -> Self {
        let vertex_of = weld(mesh);
        let vertices: Vec<_> =
            mesh.faces.iter().map(|face| face.map(|corner| vertex_of[corner.position as usize])).collect();
        let normals = mesh.faces.iter().map(|face| {
            let [a, b, c] = face.map(|corner| DVec3::from(mesh.positions[corner.position as usize]));
            (b - a).cross(c - a)
        });
        let mut surface =
            Self { normals: normals.collect(), vertices, starts: Vec::new(), corners: Vec::new() };
        surface.gather(vertex_of.iter().max().map_or(0, |last| last + 1), shading);
        surface
    }

    /// Lists the corners of each vertex, but not of faces with normals or without an area.
    fn gather(&mut self, count: u32, shading: &[FaceShading]) {
        let normals = &self.normals;
        let listed =
            |face: usize| shading[face] != FaceShading::Given && normals[face].length_squared() > 0.0;
        let mut starts = vec![0_u32; count as usize + 1];
        for (face, vertices) in self.vertices.iter().enumerate().filter(|(face, _)| listed(*face)) {
            debug_assert!(face < normals.len());
            for vertex in vertices {
                starts[*vertex as usize + 1] += 1;
            }
        }
        for vertex in 0..count as usize {
            starts[vertex + 1] += starts[vertex];
        }
        let mut next = starts.clone();
        self.corners = vec![0; starts[count as usize] as usize];
        for (face, vertices) in self.vertices.iter().enumerate().filter(|(face, _)| listed(*face)) {
            for (corner, vertex) in (0..).zip(vertices) {
                let place = &mut next[*vertex as usize];
                self.corners[*place as usize] = face as u32 * 3 + corner;
                *place += 1;
            }
        }
        self.starts = starts;
    }

    fn around(&self, vertex: u32) -> &[u32] {
        let [start, end] = [vertex, vertex + 1].map(|at| self.starts[at as usize] as usize);
        &self.corners[start..end]
    }

    /// Calls back with each two faces around a vertex, by their index in `corners`, that share an edge: of several faces
    /// at an edge, those that bend least.
    fn neighbours(
        &self,
        corners: &[u32],
        sides: &mut Vec<Side>,
        mut found: impl FnMut(u32, usize, usize, f64),
    ) {
        sides.clear();
        for (at, &corner) in (0..).zip(corners) {
            let (face, corner) = ((corner / 3) as usize, corner as usize % 3);
            let vertices = self.vertices[face];
            sides.push(Side { to: vertices[(corner + 1) % 3], forward: true, at });
            sides.push(Side { to: vertices[(corner + 2) % 3], forward: false, at });
        }
        sides.sort_unstable_by_key(|side| (side.to, side.forward, side.at));
        for edge in sides.chunk_by(|a, b| a.to == b.to) {
            let (back, forward) = edge.split_at(edge.partition_point(|side| !side.forward));
            for side in forward {
                let own = (corners[side.at as usize] / 3) as usize;
                let other = back.iter().map(|side| {
                    let face = (corners[side.at as usize] / 3) as usize;
                    let lengths = self.normals[own].length() * self.normals[face].length();
                    (side.at, self.normals[own].dot(self.normals[face]) / lengths)
                });
                // Of hundreds of faces at one edge, any will do.
                let other = other.take(64).max_by(|a, b| a.1.total_cmp(&b.1));
                if let Some((other, cosine)) = other {
                    found(side.to, side.at as usize, other as usize, cosine);
                }
            }
        }
    }

    /// Calls back with each edge at which two faces meet.
    pub(super) fn edges(&self, mesh: &SourceMesh, mut found: impl FnMut(Edge)) {
        let mut sides = Vec::new();
        for vertex in 0..(self.starts.len() - 1) as u32 {
            let corners = self.around(vertex);
            self.neighbours(corners, &mut sides, |to, a, b, cosine| {
                // Each edge is found from both ends.
                if to <= vertex {
                    return;
                }
                let faces = [corners[a] / 3, corners[b] / 3];
                let place = |of: u32| {
                    let corner = self.vertices[faces[0] as usize].iter().position(|v| *v == of);
                    let corner = mesh.faces[faces[0] as usize][corner.unwrap_or(0)];
                    DVec3::from(mesh.positions[corner.position as usize])
                };
                found(Edge { faces, cosine, length: place(vertex).distance(place(to)) });
            });
        }
    }

    /// Gives normals to corners at vertices where smooth surfaces end: the area-weighted sum of the faces of its surface
    /// around the vertex. `flat` faces have none.
    pub(super) fn give_normals(
        &self,
        mesh: &mut SourceMesh,
        shading: &[FaceShading],
        flat: &[bool],
        least_cosine: f64,
    ) {
        let (mut sides, mut surfaces) = (Vec::new(), Vec::<u32>::new());
        // Faces with normals of their own are apart from those without.
        let mut given = vec![false; self.starts.len() - 1];
        let with_normals = self.vertices.iter().zip(shading).filter(|(_, s)| **s == FaceShading::Given);
        for vertex in with_normals.flat_map(|(vertices, _)| vertices) {
            given[*vertex as usize] = true;
        }
        for vertex in 0..(self.starts.len() - 1) as u32 {
            let corners = self.around(vertex);
            surfaces.clear();
            surfaces.extend(0..corners.len() as u32);
            self.neighbours(corners, &mut sides, |_, a, b, cosine| {
                let face = |at: usize| (corners[at] / 3) as usize;
                let joined = match (shading[face(a)], shading[face(b)]) {
                    _ if flat[face(a)] || flat[face(b)] => flat[face(a)] && flat[face(b)],
                    (FaceShading::Group(a), FaceShading::Group(b)) => a == b,
                    (FaceShading::Group(_), _) | (_, FaceShading::Group(_)) => false,
                    _ => cosine >= least_cosine,
                };
                if joined {
                    join(&mut surfaces, a as u32, b as u32);
                }
            });
            for at in 0..surfaces.len() as u32 {
                surfaces[at as usize] = root(&mut surfaces, at);
            }
            // All flat faces are one surface here: none of them needs a normal.
            let is_flat = |at: usize| flat[(corners[at] / 3) as usize];
            let mut apart = given[vertex as usize];
            apart |= (1..surfaces.len())
                .any(|at| is_flat(at) != is_flat(0) || !is_flat(at) && surfaces[at] != surfaces[0]);
            if !apart {
                continue;
            }
            for of in 0..surfaces.len() {
                if surfaces[of] as usize != of || is_flat(of) {
                    continue;
                }
                let members = || (of..surfaces.len()).filter(|&at| surfaces[at] as usize == of);
                let sum: DVec3 = members().map(|at| self.normals[(corners[at] / 3) as usize]).sum();
                let Some(normal) = sum.try_normalize() else { continue };
                let number = mesh.normals.len() as u32;
                mesh.normals.push(normal.as_vec3().to_array());
                for at in members() {
                    mesh.faces[(corners[at] / 3) as usize][corners[at] as usize % 3].normal = number;
                }
            }
        }
    }
}

/// The first of a set, in a forest of parents.
pub(super) fn root(parents: &mut [u32], mut of: u32) -> u32 {
    while parents[of as usize] != of {
        let parent = parents[of as usize];
        parents[of as usize] = parents[parent as usize];
        of = parent;
    }
    of
}

/// Joins two sets; the first of both is that of the lower number.
pub(super) fn join(parents: &mut [u32], a: u32, b: u32) {
    let (a, b) = (root(parents, a), root(parents, b));
    parents[a.max(b) as usize] = a.min(b);
}

/// The vertex of each position: equal positions of a part are one.
fn weld(mesh: &SourceMesh) -> Vec<u32> {
    let mut part_of = vec![NONE; if mesh.parts.is_empty() { 0 } else { mesh.positions.len() }];
    for (face, part) in mesh.faces.iter().zip(&mesh.parts) {
        for corner in face {
            part_of[corner.position as usize] = *part;
        }
    }
    let mut first: HashMap<([u64; 3], u32), u32> = HashMap::with_capacity(mesh.positions.len());
    let mut count = 0;
    let vertices = mesh.positions.iter().enumerate().map(|(at, position)| {
        // Adding +0.0 turns -0.0 into +0.0, so that the two are one position.
        let key = position.map(|x| (x + 0.0).to_bits());
        *first.entry((key, part_of.get(at).copied().unwrap_or(NONE))).or_insert_with(|| {
            count += 1;
            count - 1
        })
    });
    vertices.collect()
}
