//! Vertex stars of a mesh that changes rarely: one array of corners, sorted by vertex.

/// For each vertex, the corners (`face × 3 + k`) of the live faces around it, ascending.
#[derive(Clone, Debug, Default)]
pub(crate) struct StarTable {
    /// Where each vertex's corners begin; one more at the end.
    first: Vec<u32>,
    corners: Vec<u32>,
}

impl StarTable {
    /// Sorts the corners of the given faces by vertex (a counting sort: time and memory are linear in
    /// vertices and faces).
    pub(crate) fn rebuild(&mut self, vertices: usize, faces: &[u32], face_vertices: &[[u32; 3]]) {
        self.first.clear();
        self.first.resize(vertices + 1, 0);
        for &face in faces {
            for v in face_vertices[face as usize] {
                self.first[v as usize] += 1;
            }
        }
        let mut sum = 0;
        for first in &mut self.first {
            sum += *first;
            *first = sum;
        }
        self.corners.resize(faces.len() * 3, 0);
        for &face in faces.iter().rev() {
            for (k, v) in face_vertices[face as usize].into_iter().enumerate().rev() {
                let at = &mut self.first[v as usize];
                *at -= 1;
                self.corners[*at as usize] = face * 3 + k as u32;
            }
        }
    }

    /// The corners at a vertex.
    pub(crate) fn corners(&self, vertex: u32) -> impl Iterator<Item = u32> + Clone + '_ {
        let (from, to) = (self.first[vertex as usize], self.first[vertex as usize + 1]);
        self.corners[from as usize..to as usize].iter().copied()
    }
}

/// Calls `visit` once for every edge, with its end points and the corners (`face × 3 + k`, the edge from
/// corner k to the next) of the faces at it, ascending. Time n log n in the valence n of a vertex.
pub(crate) fn each_edge(
    stars: &StarTable,
    face_vertices: &[[u32; 3]],
    visit: &mut dyn FnMut(u32, u32, &[u32]),
) {
    let mut spokes: Vec<(u32, u32)> = Vec::new();
    let mut run: Vec<u32> = Vec::new();
    for v in 0..stars.first.len().saturating_sub(1) as u32 {
        spokes.clear();
        for corner in stars.corners(v) {
            let (face, k) = (corner / 3, corner % 3);
            let corners = face_vertices[face as usize];
            let (next, last) = ((k + 1) % 3, (k + 2) % 3);
            if corners[next as usize] > v {
                spokes.push((corners[next as usize], corner));
            }
            if corners[last as usize] > v {
                spokes.push((corners[last as usize], face * 3 + last));
            }
        }
        spokes.sort_unstable();
        for edge in spokes.chunk_by(|a, b| a.0 == b.0) {
            run.clear();
            run.extend(edge.iter().map(|e| e.1));
            visit(v, edge[0].0, &run);
        }
    }
}
