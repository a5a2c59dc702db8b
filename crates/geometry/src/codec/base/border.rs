//! The border of what is there of a base mesh: where a face that grows over a gate may meet what is there.

/// Open edges that are kept of a vertex, the newest: bounds the work of hostile bytes.
const MOST_OPEN: usize = 8;

/// By vertex, the ends of its directed edges that have a face on one side only.
#[derive(Clone, Debug, Default)]
pub(super) struct Border {
    /// Where edges to the vertex come from, oldest first.
    to: Vec<Vec<u32>>,
    /// Where edges from the vertex go, oldest first.
    from: Vec<Vec<u32>>,
}

/// Vertices that a face over a gate is likely to have as its third, likeliest first.
#[derive(Clone, Debug)]
pub(super) struct Likely {
    pub(super) vertices: Vec<u32>,
    /// Whether the first would close both other edges.
    pub(super) closes: bool,
}

impl Border {
    /// A new vertex has no edges.
    pub(super) fn vertex(&mut self) {
        self.to.push(Vec::new());
        self.from.push(Vec::new());
    }

    /// A face takes a directed edge, whose other side is there or is not.
    pub(super) fn edge(&mut self, a: u32, b: u32, other_side: bool) {
        let [a_at, b_at] = [a as usize, b as usize];
        if other_side {
            self.from[b_at].retain(|&v| v != a);
            self.to[a_at].retain(|&v| v != b);
            return;
        }
        for (list, v) in [(&mut self.from[a_at], b), (&mut self.to[b_at], a)] {
            if list.len() == MOST_OPEN {
                list.remove(0);
            }
            list.push(v);
        }
    }

    /// Who the third vertex of the face across the edge from `a` to `b` may be.
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

    /// A border of so many vertices and these open edges, in order.
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
    fn who_closes_both_edges_comes_first_then_the_left_then_the_right_each_newest_first() {
        // From 4, 2, 3 and 6 to 0, and from 1 to 5, 3, 2 and 7.
        let border = border(8, &[(4, 0), (2, 0), (3, 0), (6, 0), (1, 5), (1, 3), (1, 2), (1, 7)]);
        assert_eq!(likely(&border, 0, 1), (vec![3, 2, 6, 4, 7, 5], true));
        // Seen from elsewhere other edges count: 0 has none that go out, 1 none that come in.
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
    fn an_edge_whose_other_side_comes_is_open_no_longer() {
        let mut border = border(4, &[(0, 1), (1, 2), (2, 0), (3, 1)]);
        assert_eq!(likely(&border, 1, 2), (vec![0, 3], true));
        border.edge(1, 0, true);
        assert_eq!(likely(&border, 1, 2), (vec![3, 0], false), "0 is there only from 2 on");
        border.edge(0, 2, true);
        assert_eq!(likely(&border, 1, 2), (vec![3], false));
        // Elsewhere nothing has changed.
        assert_eq!(likely(&border, 2, 3), (vec![1], true));
    }

    #[test]
    fn of_many_open_edges_the_newest_are_kept() {
        let many = u32::try_from(MOST_OPEN).unwrap() + 3;
        let open: Vec<(u32, u32)> = (2..2 + many).map(|v| (v, 0)).collect();
        let (vertices, closes) = likely(&border(many as usize + 2, &open), 0, 1);
        assert!(vertices.into_iter().eq((5..2 + many).rev()) && !closes);
    }
}
