//! The border of the decoded part of a base mesh: predicts the third vertex of a face across a gate.

/// Open edges stored per vertex, the newest: bounds the work of hostile bytes.
const MAX_OPEN: usize = 8;

/// The border: directed edges with a face on one side only, by vertex.
#[derive(Clone, Debug, Default)]
pub(super) struct Border {
    /// Start vertices of open edges to each vertex, oldest first.
    to: Vec<Vec<u32>>,
    /// End vertices of open edges from the vertex, oldest first.
    from: Vec<Vec<u32>>,
}

/// Likely third vertices of a face across a gate, likeliest first.
#[derive(Clone, Debug)]
pub(super) struct Likely {
    pub(super) vertices: Vec<u32>,
    /// Whether the first would close both other edges of the face.
    pub(super) closes: bool,
}

impl Border {
    /// Adds a vertex without edges.
    pub(super) fn vertex(&mut self) {
        self.to.push(Vec::new());
        self.from.push(Vec::new());
    }

    /// Adds a directed edge of a new face; `other_side` tells whether the opposite edge exists.
    pub(super) fn edge(&mut self, a: u32, b: u32, other_side: bool) {
        let [a_at, b_at] = [a as usize, b as usize];
        if other_side {
            self.from[b_at].retain(|&v| v != a);
            self.to[a_at].retain(|&v| v != b);
            return;
        }
        for (list, v) in [(&mut self.from[a_at], b), (&mut self.to[b_at], a)] {
            if list.len() == MAX_OPEN {
                list.remove(0);
            }
            list.push(v);
        }
    }

    /// Likely third vertices of the face across the edge from `a` to `b`.
    pub(super) fn likely(&self, a: u32, b: u32) -> Likely {
        let (left, right) = (&self.to[a as usize], &self.from[b as usize]);
        let both: Vec<u32> = left.iter().rev().copied().filter(|v| right.contains(v)).collect();
        let closes = !both.is_empty();
        let mut vertices = both;
        for v in left.iter().rev().chain(right.iter().rev()) {
            if *v != a && *v != b && !vertices.contains(v) {
                vertices.push(*v);
            }
        }
        Likely { vertices, closes }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A border of `vertices` vertices with these open edges, in order.
    fn border(vertices: usize, open: &[(u32, u32)]) -> Border {
        let mut border = Border::default();
        (0..vertices).for_each(|_| border.vertex());
        open.iter().for_each(|&(a, b)| border.edge(a, b, false));
        border
    }

    fn likely(border: &Border, a: u32, b: u32) -> (Vec<u32>, bool) {
        let Likely { vertices, closes } = border.likely(a, b);
        (vertices, closes)
    }

    #[test]
    fn likely_vertices_close_both_edges_then_left_then_right_newest_first() {
        // Open edges from 4, 2, 3 and 6 to 0, and from 1 to 5, 3, 2 and 7.
        let border = border(8, &[(4, 0), (2, 0), (3, 0), (6, 0), (1, 5), (1, 3), (1, 2), (1, 7)]);
        assert_eq!(likely(&border, 0, 1), (vec![3, 2, 6, 4, 7, 5], true));
        // In the other direction none: no open edge leaves 0, none ends at 1.
        assert_eq!(likely(&border, 1, 0), (vec![], false));
        assert_eq!(likely(&border, 3, 2), (vec![1, 0], false));
    }

    #[test]
    fn the_gates_own_ends_are_not_its_third_vertex() {
        let border = border(3, &[(1, 0), (2, 0), (1, 0), (1, 2)]);
        assert_eq!(likely(&border, 0, 1), (vec![2], true));
        assert_eq!(likely(&border, 0, 2), (vec![1], false));
    }

    #[test]
    fn an_edge_with_two_faces_is_not_open() {
        let mut border = border(4, &[(0, 1), (1, 2), (2, 0), (3, 1)]);
        assert_eq!(likely(&border, 1, 2), (vec![0, 3], true));
        border.edge(1, 0, true);
        assert_eq!(likely(&border, 1, 2), (vec![3, 0], false), "0 is open only from 2");
        border.edge(0, 2, true);
        assert_eq!(likely(&border, 1, 2), (vec![3], false));
        // The other edges are unchanged.
        assert_eq!(likely(&border, 2, 3), (vec![1], true));
    }

    #[test]
    fn of_many_open_edges_the_newest_are_kept() {
        let many = u32::try_from(MAX_OPEN).unwrap() + 3;
        let open: Vec<(u32, u32)> = (2..2 + many).map(|v| (v, 0)).collect();
        let (vertices, closes) = likely(&border(many as usize + 2, &open), 0, 1);
        assert!(vertices.into_iter().eq((5..2 + many).rev()) && !closes);
    }
}
