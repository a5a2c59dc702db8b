//! A four-wide bounding volume hierarchy for distance queries: whether any triangle is within a distance, and else
//! how far the nearest is.
//!
//! It is the tree of [`TriangleBvh`] with every second level removed, so that four boxes are tested at once in single
//! precision. Rounding is conservative: boxes are skipped only if certainly too far, and accepted as a whole only if
//! certainly near. Triangle distances are those of [`closest_point_on_triangle`], so results do not depend on the
//! tree.
//!
//! Cost: about 20 bytes per triangle besides corners and positions. A query with a distance below the size of the
//! boxes visits O(log n) boxes, one with a larger distance few.

use glam::{DVec3, Vec4};

use crate::mesh::distance::{Node, TriangleBvh, closest_point_on_triangle};
use crate::mesh::four::PointOfFour;

/// Relative rounding error of a squared distance in single precision.
const SLACK: f32 = 1e-6;
/// Relative rounding error of a coordinate.
const COORDINATE_SLACK: f32 = 1.2e-7;
/// Capacity of the traversal stack: three pending children per level; a tree over 2^31 triangles has 16 levels.
const STACK: usize = 64;

/// No triangle, or no boxes.
const NONE: u32 = u32::MAX;
/// Entries of [`Hints`].
const HINTS: usize = 1024;

/// Four boxes.
#[derive(Clone, Copy, Debug)]
struct Boxes {
    low: [Vec4; 3],
    high: [Vec4; 3],
    /// First triangle of a leaf; else index of the child boxes.
    start: [u32; 4],
    /// Number of triangles of a leaf; 0 for an inner node.
    count: [u32; 4],
}

impl Boxes {
    /// Four empty boxes.
    const EMPTY: Self =
        Self { low: [Vec4::INFINITY; 3], high: [Vec4::NEG_INFINITY; 3], start: [0; 4], count: [0; 4] };
}

/// A query point, bracketed by two single-precision points.
struct Point {
    exact: DVec3,
    of_four: PointOfFour,
    low: [Vec4; 3],
    high: [Vec4; 3],
}

impl Point {
    fn new(point: [f64; 3]) -> Self {
        let near = point.map(|x| (x as f32, (x as f32).abs() * COORDINATE_SLACK));
        Self {
            exact: DVec3::from_array(point),
            of_four: PointOfFour::new(point),
            low: near.map(|(x, slack)| Vec4::splat(x - slack)),
            high: near.map(|(x, slack)| Vec4::splat(x + slack)),
        }
    }

    /// Squared distances to the nearest (lower bound) and to the farthest point (upper bound) of each box, up to
    /// [`SLACK`].
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

/// A bounding volume hierarchy over triangles with four children per node.
pub(crate) struct WideBvh {
    /// Empty if there are no triangles.
    boxes: Vec<Boxes>,
    /// Exact in single precision.
    positions: Vec<[f32; 3]>,
    triangles: Vec<[u32; 3]>,
}

impl WideBvh {
    /// Builds a hierarchy over `triangles`, which index `positions`. Positions must be exact in f32, for example grid
    /// cells. Panics as [`TriangleBvh::new`] does.
    pub(crate) fn new(positions: &[[f64; 3]], triangles: &[[u32; 3]]) -> Self {
        let (nodes, positions, triangles) = TriangleBvh::new(positions, triangles).into_parts();
        let positions = positions.iter().map(|p| p.as_vec3().to_array()).collect();
        Self { boxes: widen(&nodes), positions, triangles }
    }

    /// The position with an index.
    pub(crate) fn position(&self, index: u32) -> [f64; 3] {
        self.positions[index as usize].map(f64::from)
    }

    /// The triangles by their corners, in the order of [`TriangleBvh`].
    pub(crate) fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    /// Whether any triangle is at most `radius` away.
    pub(crate) fn any_within(&self, point: [f64; 3], radius: f64) -> bool {
        self.search(0, point, radius * radius, &mut Best::none(radius * radius), &mut new_stack()).is_some()
    }

    /// As [`Self::any_within`], testing first the triangle that was near for the last point close by, then those
    /// around the point.
    pub(crate) fn any_within_hinted(&self, point: [f64; 3], radius: f64, hints: &mut Hints<'_>) -> bool {
        let enough = radius * radius;
        let hint = hints.at(point);
        let known = hints.near[hint];
        if known != NONE && self.distance_squared(DVec3::from_array(point), known) <= enough {
            return true;
        }
        let seed = hints.seeds.map_or(NONE, |seeds| seeds.at(point));
        let stack = &mut hints.stack;
        let mut search = |from| self.search(from, point, enough, &mut Best::none(enough), stack);
        let near = if seed == NONE { None } else { search(seed) };
        let Some(found) = near.or_else(|| search(0)) else { return false };
        hints.near[hint] = found;
        true
    }

    /// Distance to the nearest triangle, if it is more than `radius`; `None` if a triangle is within `radius` or
    /// there is none. `last` is a triangle that is likely near, and becomes the nearest one found.
    pub(crate) fn distance_beyond(
        &self,
        point: [f64; 3],
        radius: f64,
        last: &mut Option<u32>,
    ) -> Option<f64> {
        let enough = radius * radius;
        let mut best = Best::none(f64::INFINITY);
        // A point that is not finite is near nothing.
        if let Some(triangle) = last.filter(|_| point.iter().all(|x| x.is_finite())) {
            best = Best { distance: self.distance_squared(DVec3::from_array(point), triangle), triangle };
            if best.distance <= enough {
                return None;
            }
        }
        if let Some(within) = self.search(0, point, enough, &mut best, &mut new_stack()) {
            *last = Some(within);
            return None;
        }
        *last = (best.triangle != NONE).then_some(best.triangle);
        last.map(|_| best.distance.sqrt())
    }

    fn corners(&self, triangle: u32) -> [DVec3; 3] {
        self.rounded_corners(triangle).map(|p| DVec3::from_array(p.map(f64::from)))
    }

    fn rounded_corners(&self, triangle: u32) -> [[f32; 3]; 3] {
        self.triangles[triangle as usize].map(|v| self.positions[v as usize])
    }

    fn distance_squared(&self, point: DVec3, triangle: u32) -> f64 {
        let corners = self.corners(triangle);
        point.distance_squared(closest_point_on_triangle(point, corners))
    }

    /// A triangle below the boxes `from` whose squared distance is at most `enough`; if there is none, lowers `best`
    /// to the smallest one below it.
    fn search(
        &self,
        from: u32,
        point: [f64; 3],
        enough: f64,
        best: &mut Best,
        stack: &mut Stack,
    ) -> Option<u32> {
        // A point that is not finite is near nothing.
        if self.boxes.is_empty() || !point.iter().all(|x| x.is_finite()) {
            return None;
        }
        let point = Point::new(point);
        let radius = enough.sqrt();
        let near_enough = (enough as f32) * (1.0 - SLACK);
        let bound = |best: f64| ((best as f32) * (1.0 + SLACK)).min(f32::MAX);
        let mut limit = bound(best.distance);
        stack[0] = (from, 0, 0.0);
        let mut keys = [0.0_f32; 4];
        let mut depth = 1;
        while depth > 0 {
            depth -= 1;
            let (start, count, distance) = stack[depth];
            if distance > limit {
                continue;
            }
            if count > 0 {
                // Up to four triangles at once: most queries end here.
                let last = start + count - 1;
                let four = [0, 1, 2, 3].map(|i| self.rounded_corners(last.min(start + i)));
                let (near, open) = point.of_four.within(four, radius, best.distance.max(enough));
                if near != 0 {
                    return Some(last.min(start + near.trailing_zeros()));
                }
                for triangle in (start..=last).filter(|i| open >> (i - start) & 1 == 1) {
                    let corners = self.corners(triangle);
                    let nearest = closest_point_on_triangle(point.exact, corners);
                    let distance = point.exact.distance_squared(nearest);
                    if distance <= enough {
                        return Some(triangle);
                    }
                    if distance < best.distance {
                        *best = Best { distance, triangle };
                        limit = bound(distance);
                    }
                }
                continue;
            }
            let boxes = &self.boxes[start as usize];
            let (nearest, farthest) = point.distances(boxes);
            if farthest.min_element() <= near_enough {
                let lane = farthest.min_position();
                return Some(self.first_in(boxes.start[lane], boxes.count[lane]));
            }
            let mut lanes = nearest.cmple(Vec4::splat(limit)).bitmask();
            let (nearest, order) = (nearest.to_array(), (nearest + farthest).to_array());
            let bottom = depth;
            while lanes != 0 {
                let lane = lanes.trailing_zeros() as usize;
                lanes &= lanes - 1;
                // The most promising on top.
                let mut at = depth;
                while at > bottom && keys[at - 1 - bottom] < order[lane] {
                    keys[at - bottom] = keys[at - 1 - bottom];
                    stack[at] = stack[at - 1];
                    at -= 1;
                }
                keys[at - bottom] = order[lane];
                stack[at] = (boxes.start[lane], boxes.count[lane], nearest[lane]);
                depth += 1;
            }
        }
        None
    }

    /// The first triangle below a box, given its entry in [`Boxes`].
    fn first_in(&self, mut start: u32, mut count: u32) -> u32 {
        while count == 0 {
            let inside = &self.boxes[start as usize];
            (start, count) = (inside.start[0], inside.count[0]);
        }
        start
    }
}

/// The nearest triangle so far.
struct Best {
    /// Squared distance.
    distance: f64,
    triangle: u32,
}

impl Best {
    fn none(distance: f64) -> Self {
        Self { distance, triangle: NONE }
    }
}

/// Pending boxes: start, count and squared distance.
type Stack = [(u32, u32, f32); STACK];

fn new_stack() -> Stack {
    [(0, 0, 0.0); STACK]
}

/// Start boxes for queries, by position.
pub(crate) struct Seeds {
    per_cell: f64,
    /// Leaf-level boxes, by a hash of the cell of a triangle's centre.
    boxes: Vec<u32>,
}

impl Seeds {
    /// For cells with edges of about `size`; 4 to 8 bytes per triangle.
    pub(crate) fn new(bvh: &WideBvh, size: f64) -> Self {
        let count = bvh.triangles.len().next_power_of_two();
        let mut seeds = Self { per_cell: 1.0 / size.max(f64::MIN_POSITIVE), boxes: vec![NONE; count] };
        for (at, boxes) in (0..).zip(&bvh.boxes) {
            for lane in (0..4).filter(|&lane| boxes.count[lane] > 0) {
                for triangle in boxes.start[lane]..boxes.start[lane] + boxes.count[lane] {
                    let [a, b, c] = bvh.corners(triangle);
                    let place = seeds.place(((a + b + c) * (1.0 / 3.0)).to_array());
                    seeds.boxes[place] = at;
                }
            }
        }
        seeds
    }

    fn place(&self, point: [f64; 3]) -> usize {
        hash(point, self.per_cell) as usize & (self.boxes.len() - 1)
    }

    fn at(&self, point: [f64; 3]) -> u32 {
        self.boxes[self.place(point)]
    }
}

/// Hash of a point's cell: products with large odd numbers (Teschner et al., "Optimized spatial hashing", 2003,
/// section 4.1).
fn hash(point: [f64; 3], per_cell: f64) -> u32 {
    let [x, y, z] = point.map(|x| (x * per_cell) as i32 as u32);
    x.wrapping_mul(73_856_093) ^ y.wrapping_mul(19_349_663) ^ z.wrapping_mul(83_492_791)
}

/// Recently near triangles, by position: consecutive queries are often close to each other.
pub(crate) struct Hints<'a> {
    per_cell: f64,
    near: Vec<u32>,
    seeds: Option<&'a Seeds>,
    stack: Stack,
}

impl<'a> Hints<'a> {
    /// Points less than about `size` apart share a hint.
    pub(crate) fn new(size: f64, seeds: Option<&'a Seeds>) -> Self {
        let per_cell = 1.0 / size.max(f64::MIN_POSITIVE);
        Self { per_cell, near: vec![NONE; HINTS], seeds, stack: new_stack() }
    }

    /// The entry of a point; different cells may share one.
    fn at(&self, point: [f64; 3]) -> usize {
        hash(point, self.per_cell) as usize % HINTS
    }
}

/// Merges two levels each of a binary tree whose root comes first.
fn widen(nodes: &[Node]) -> Vec<Boxes> {
    let Some(root) = nodes.first() else { return Vec::new() };
    let mut wide = vec![Boxes::EMPTY];
    // Boxes to fill, with the node that they are below.
    let mut open = vec![(0_usize, *root)];
    while let Some((at, node)) = open.pop() {
        // A leaf counts as its own child.
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
    fn empty_trees_and_nan_points_are_near_nothing() {
        let none = WideBvh::new(&[], &[]);
        assert!(!none.any_within([0.0; 3], f64::INFINITY));
        assert_eq!(none.distance_beyond([0.0; 3], 0.0, &mut None), None);
        let one = WideBvh::new(&[[0.0; 3], [4.0, 0.0, 0.0], [0.0, 4.0, 0.0]], &[[0, 1, 2]]);
        assert!(one.any_within([1.0, 1.0, 9.0], f64::INFINITY));
        assert!(!one.any_within([f64::NAN, 1.0, 0.0], f64::INFINITY));
        assert_eq!(one.distance_beyond([1.0, 1.0, 2.0], 1.99, &mut None), Some(2.0));
        assert_eq!(one.distance_beyond([1.0, 1.0, 2.0], 2.0, &mut None), None);
    }

    /// Few grid cells around the middle, so degenerate and touching triangles are common.
    fn cell() -> impl Strategy<Value = f64> {
        prop_oneof![(-4_i32..=4).prop_map(f64::from), (-8_388_608_i32..=8_388_607).prop_map(f64::from)]
    }

    proptest! {
        #[test]
        fn results_equal_the_binary_trees(
            positions in prop::collection::vec([cell(), cell(), cell()], 3..40),
            picks in prop::collection::vec([any::<u32>(), any::<u32>(), any::<u32>()], 1..120),
            queries in prop::collection::vec((any::<u32>(), [-6.0..6.0_f64, -6.0..6.0, -6.0..6.0], 0.0..6.0_f64), 1..20),
        ) {
            let n = positions.len() as u32;
            let triangles: Vec<[u32; 3]> = picks.iter().map(|t| t.map(|i| i % n)).collect();
            let (wide, binary) = (WideBvh::new(&positions, &triangles), TriangleBvh::new(&positions, &triangles));
            let seeds = Seeds::new(&wide, 3.0);
            let mut hints = Hints::new(2.0, Some(&seeds));
            let mut last = None;
            for (near, way, radius) in queries {
                let at = positions[(near % n) as usize];
                let point = [0, 1, 2].map(|k| at[k] + way[k]);
                let distance = binary.nearest(point, f64::INFINITY).unwrap().0;
                for radius in [radius, distance, 0.5 * distance, 2.0 * distance, 0.0] {
                    let within = binary.any_within(point, radius);
                    prop_assert_eq!(wide.any_within(point, radius), within);
                    prop_assert_eq!(wide.any_within_hinted(point, radius, &mut hints), within);
                    let beyond = (!within).then_some(distance);
                    prop_assert_eq!(wide.distance_beyond(point, radius, &mut None), beyond);
                    prop_assert_eq!(wide.distance_beyond(point, radius, &mut last), beyond);
                }
            }
        }
    }
}
