//! How far points are from a surface, where it does not matter which triangle is the nearest: whether any is within a
//! distance, and how far the nearest is if none is.
//!
//! The tree of [`TriangleBvh`] with every second level left out, so that four boxes are looked at together, in single
//! precision: too near by the rounding where boxes are left out, too far where one is taken to be near for all of its
//! triangles. Distances of triangles are those of [`closest_point_on_triangle`], so answers do not depend on the tree.
//!
//! Cost: about 20 bytes a triangle besides corners and positions. A question about a point that is nearer than
//! boxes are large takes O(log n) boxes, one with a distance beyond that few.

use glam::{DVec3, Vec4};

use crate::mesh::distance::{Node, TriangleBvh, box_is_beyond, closest_point_on_triangle};

/// Covers the rounding of a squared distance in single precision.
const SLACK: f32 = 1e-6;
/// The same for a coordinate, as a share of it.
const COORDINATE_SLACK: f32 = 1.2e-7;
/// Children that can wait: three at each of the levels, of which a tree over 2^31 triangles has 16.
const STACK: usize = 64;

/// Stands for triangles that were not looked at one by one.
const SOME: u32 = u32::MAX;
/// Places that [`Hints`] keeps.
const HINTS: usize = 1024;

/// Four boxes.
#[derive(Clone, Copy, Debug)]
struct Boxes {
    low: [Vec4; 3],
    high: [Vec4; 3],
    /// First triangle of a leaf; else index of the boxes inside.
    start: [u32; 4],
    /// Triangles of a leaf; 0 for boxes inside.
    count: [u32; 4],
}

impl Boxes {
    /// None of which holds anything.
    const EMPTY: Self =
        Self { low: [Vec4::INFINITY; 3], high: [Vec4::NEG_INFINITY; 3], start: [0; 4], count: [0; 4] };
}

/// A point, as seen by [`Boxes`]: between two that single precision has.
struct Point {
    exact: DVec3,
    low: [Vec4; 3],
    high: [Vec4; 3],
}

impl Point {
    fn new(point: [f64; 3]) -> Self {
        let near = point.map(|x| (x as f32, (x as f32).abs() * COORDINATE_SLACK));
        Self {
            exact: DVec3::from_array(point),
            low: near.map(|(x, slack)| Vec4::splat(x - slack)),
            high: near.map(|(x, slack)| Vec4::splat(x + slack)),
        }
    }

    /// Squared distances of the nearest and of the farthest point of each box: at most, and at least; but for the
    /// rounding that [`SLACK`] covers.
    fn distances(&self, boxes: &Boxes) -> (Vec4, Vec4) {
        let (mut nearest, mut farthest) = (Vec4::ZERO, Vec4::ZERO);
        for axis in 0..3 {
            let (low, high) = (boxes.low[axis], boxes.high[axis]);
            let outside = (low - self.high[axis]).max(self.low[axis] - high).max(Vec4::ZERO);
            let across = (self.high[axis] - low).max(high - self.low[axis]);
            nearest += outside * outside;
            farthest += across * across;
        }
        (nearest, farthest)
    }
}

/// A bounding volume hierarchy over triangles with four children a node.
pub(crate) struct WideBvh {
    /// Empty where there is no triangle.
    boxes: Vec<Boxes>,
    positions: Vec<DVec3>,
    triangles: Vec<[u32; 3]>,
}

impl WideBvh {
    /// A hierarchy over `triangles`, which index `positions`: cells of a grid, or what is as far below the end of
    /// single precision. Panics as [`TriangleBvh::new`] does.
    pub(crate) fn new(positions: &[[f64; 3]], triangles: &[[u32; 3]]) -> Self {
        let (nodes, positions, triangles) = TriangleBvh::new(positions, triangles).into_parts();
        Self { boxes: widen(&nodes), positions, triangles }
    }

    /// One of the positions.
    pub(crate) fn position(&self, index: u32) -> [f64; 3] {
        self.positions[index as usize].to_array()
    }

    /// The triangles, by their corners, in the order of [`TriangleBvh`].
    pub(crate) fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    /// Whether any triangle is at most `radius` away.
    pub(crate) fn any_within(&self, point: [f64; 3], radius: f64) -> bool {
        self.search(point, radius * radius, &mut { radius * radius }).is_some()
    }

    /// The same, asking first the triangle that was near when the last point near by was asked for.
    pub(crate) fn any_within_again(&self, point: [f64; 3], radius: f64, hints: &mut Hints) -> bool {
        let hint = hints.at(point);
        if let Some(&corners) = self.triangles.get(*hint as usize)
            && self.distance_squared(DVec3::from_array(point), corners) <= radius * radius
        {
            return true;
        }
        let found = self.search(point, radius * radius, &mut { radius * radius });
        *hint = found.unwrap_or(*hint);
        found.is_some()
    }

    /// How far the nearest triangle is, if none is at most `radius` away and there is any.
    pub(crate) fn distance_beyond(&self, point: [f64; 3], radius: f64) -> Option<f64> {
        let mut best = f64::INFINITY;
        let within = self.search(point, radius * radius, &mut best).is_some();
        (!within && best.is_finite()).then(|| best.sqrt())
    }

    fn distance_squared(&self, point: DVec3, corners: [u32; 3]) -> f64 {
        let corners = corners.map(|v| self.positions[v as usize]);
        point.distance_squared(closest_point_on_triangle(point, corners))
    }

    /// A triangle whose squared distance is at most `enough`, or [`SOME`] of them; if there is none, lowers `best` to the
    /// least below it.
    fn search(&self, point: [f64; 3], enough: f64, best: &mut f64) -> Option<u32> {
        // What is no point is near nothing.
        if self.boxes.is_empty() || !point.iter().all(|x| x.is_finite()) {
            return None;
        }
        let point = Point::new(point);
        let near_enough = (enough as f32) * (1.0 - SLACK);
        let bound = |best: f64| ((best as f32) * (1.0 + SLACK)).min(f32::MAX);
        let mut limit = bound(*best);
        let mut stack = [(0_u32, 0_u32, 0.0_f32); STACK];
        let mut keys = [0.0_f32; 4];
        let mut depth = 1;
        while depth > 0 {
            depth -= 1;
            let (start, count, distance) = stack[depth];
            if distance > limit {
                continue;
            }
            if count > 0 {
                for triangle in start..start + count {
                    let corners = self.triangles[triangle as usize].map(|v| self.positions[v as usize]);
                    if box_is_beyond(point.exact, corners, best.max(enough)) {
                        continue;
                    }
                    let nearest = closest_point_on_triangle(point.exact, corners);
                    let distance = point.exact.distance_squared(nearest);
                    if distance <= enough {
                        return Some(triangle);
                    }
                    if distance < *best {
                        *best = distance;
                        limit = bound(distance);
                    }
                }
                continue;
            }
            let boxes = &self.boxes[start as usize];
            let (nearest, farthest) = point.distances(boxes);
            if farthest.min_element() <= near_enough {
                return Some(SOME);
            }
            let (nearest, order) = (nearest.to_array(), (nearest + farthest).to_array());
            let bottom = depth;
            for lane in 0..4 {
                if nearest[lane] <= limit {
                    // The likeliest on top.
                    let mut at = depth;
                    stack[at] = (boxes.start[lane], boxes.count[lane], nearest[lane]);
                    keys[at - bottom] = order[lane];
                    while at > bottom && keys[at - 1 - bottom] < keys[at - bottom] {
                        keys.swap(at - bottom, at - 1 - bottom);
                        stack.swap(at, at - 1);
                        at -= 1;
                    }
                    depth += 1;
                }
            }
        }
        None
    }
}

/// Which triangles were near, by place: most questions are about places where others were asked for.
pub(crate) struct Hints {
    per_cell: f64,
    triangles: Vec<u32>,
}

impl Hints {
    /// For points of which those less than about `size` apart are likely to be near the same triangle.
    pub(crate) fn new(size: f64) -> Self {
        Self { per_cell: 1.0 / size.max(f64::MIN_POSITIVE), triangles: vec![SOME; HINTS] }
    }

    /// The place of a point, which it shares with others here and there.
    fn at(&mut self, point: [f64; 3]) -> &mut u32 {
        // Large odd numbers (Teschner et al., "Optimized spatial hashing", 2003, section 4.1).
        let [x, y, z] = point.map(|x| (x * self.per_cell).floor() as i32 as u32);
        let hash = x.wrapping_mul(73_856_093) ^ y.wrapping_mul(19_349_663) ^ z.wrapping_mul(83_492_791);
        &mut self.triangles[hash as usize % HINTS]
    }
}

/// The boxes of a binary tree, whose root comes first, those of two levels together.
fn widen(nodes: &[Node]) -> Vec<Boxes> {
    let Some(root) = nodes.first() else { return Vec::new() };
    let mut wide = vec![Boxes::EMPTY];
    // Boxes to fill, and the node that they are inside of.
    let mut open = vec![(0_usize, *root)];
    while let Some((at, node)) = open.pop() {
        // A leaf is its own child.
        let inside = |node: Node| match (node.count, node.start as usize) {
            (0, first) => [Some(nodes[first]), Some(nodes[first + 1])],
            _ => [Some(node), None],
        };
        let children = inside(node).into_iter().flatten().flat_map(inside).flatten();
        for (lane, child) in children.enumerate() {
            for axis in 0..3 {
                wide[at].low[axis][lane] = child.low[axis];
                wide[at].high[axis][lane] = child.high[axis];
            }
            wide[at].count[lane] = child.count;
            wide[at].start[lane] = child.start;
            if child.count == 0 {
                wide[at].start[lane] = wide.len() as u32;
                open.push((wide.len(), child));
                wide.push(Boxes::EMPTY);
            }
        }
    }
    wide.shrink_to_fit();
    wide
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn no_triangle_and_no_point_are_near_nothing() {
        let none = WideBvh::new(&[], &[]);
        assert!(!none.any_within([0.0; 3], f64::INFINITY));
        assert_eq!(none.distance_beyond([0.0; 3], 0.0), None);
        let one = WideBvh::new(&[[0.0; 3], [4.0, 0.0, 0.0], [0.0, 4.0, 0.0]], &[[0, 1, 2]]);
        assert!(one.any_within([1.0, 1.0, 9.0], f64::INFINITY));
        assert!(!one.any_within([f64::NAN, 1.0, 0.0], f64::INFINITY));
        assert_eq!(one.distance_beyond([1.0, 1.0, 2.0], 1.99), Some(2.0));
        assert_eq!(one.distance_beyond([1.0, 1.0, 2.0], 2.0), None);
    }

    /// Cells of a grid about its middle; few of them, so that degenerate and touching triangles are common.
    fn cell() -> impl Strategy<Value = f64> {
        prop_oneof![(-4_i32..=4).prop_map(f64::from), (-8_388_608_i32..=8_388_607).prop_map(f64::from)]
    }

    proptest! {
        #[test]
        fn answers_are_those_of_the_binary_tree(
            positions in prop::collection::vec([cell(), cell(), cell()], 3..40),
            picks in prop::collection::vec([any::<u32>(), any::<u32>(), any::<u32>()], 1..120),
            queries in prop::collection::vec((any::<u32>(), [-6.0..6.0_f64, -6.0..6.0, -6.0..6.0], 0.0..6.0_f64), 1..20),
        ) {
            let n = positions.len() as u32;
            let triangles: Vec<[u32; 3]> = picks.iter().map(|t| t.map(|i| i % n)).collect();
            let (wide, binary) = (WideBvh::new(&positions, &triangles), TriangleBvh::new(&positions, &triangles));
            let mut hints = Hints::new(2.0);
            for (near, way, radius) in queries {
                let at = positions[(near % n) as usize];
                let point = [0, 1, 2].map(|k| at[k] + way[k]);
                let distance = binary.nearest(point, f64::INFINITY).unwrap().0;
                for radius in [radius, distance, 0.5 * distance, 2.0 * distance, 0.0] {
                    let within = binary.any_within(point, radius);
                    prop_assert_eq!(wide.any_within(point, radius), within);
                    prop_assert_eq!(wide.any_within_again(point, radius, &mut hints), within);
                    prop_assert_eq!(wide.distance_beyond(point, radius), (!within).then_some(distance));
                }
            }
        }
    }
}
