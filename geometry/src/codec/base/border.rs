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
