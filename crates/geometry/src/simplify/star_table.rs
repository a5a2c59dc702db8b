//! Vertex stars of a mesh that changes rarely: an array of corners sorted by vertex.

use crate::mesh::corner::{corner, face_of, next, previous, side_of};
use crate::mesh::rows::Rows;

/// For each vertex, the corners (`face × 3 + k`) of the live faces around it, ascending.
#[derive(Clone, Debug, Default)]
pub(crate) struct StarTable(Rows<u32>);

impl StarTable {
    /// Sorts the corners of the given faces, which ascend, by vertex.
    pub(crate) fn rebuild(&mut self, vertices: usize, faces: &[u32], face_vertices: &[[u32; 3]]) {
        self.0.rebuild(vertices, || {
            faces
                .iter()
                .flat_map(|&face| (0..3).map(move |k| (face_vertices[face as usize][k], corner(face, k))))
        });
    }

    /// The corners at a vertex.
    pub(crate) fn row(&self, vertex: u32) -> &[u32] {
        self.0.row(vertex)
    }

    /// The corners at a vertex, as an iterator.
    pub(crate) fn corners(&self, vertex: u32) -> impl Iterator<Item = u32> + Clone + '_ {
        self.0.row(vertex).iter().copied()
    }
}

/// Calls `visit` once per edge with its end points and the corners (`face × 3 + k`, the edge from corner k to the
/// next) of its faces, ascending. Time O(n log n) in the valence n of a vertex.
pub(crate) fn each_edge(
    stars: &StarTable,
    face_vertices: &[[u32; 3]],
    visit: &mut dyn FnMut(u32, u32, &[u32]),
) {
    let mut star_faces: Vec<(u32, u32)> = Vec::new();
    let mut run: Vec<u32> = Vec::new();
    for v in 0..stars.0.len() as u32 {
        star_faces.clear();
        for at in stars.corners(v) {
            let (face, k) = (face_of(at), side_of(at));
            let vertices = face_vertices[face as usize];
            let (next, previous) = (next(k), previous(k));
            if vertices[next] > v {
                star_faces.push((vertices[next], at));
            }
            if vertices[previous] > v {
                star_faces.push((vertices[previous], corner(face, previous)));
            }
        }
        star_faces.sort_unstable();
        for edge in star_faces.chunk_by(|a, b| a.0 == b.0) {
            run.clear();
            run.extend(edge.iter().map(|e| e.1));
            visit(v, edge[0].0, &run);
        }
    }
}
