//! Distance from points to a triangle surface, and a bounding volume hierarchy that makes it fast.
//!
//! The point–triangle distance is the case analysis by Voronoi regions of Ericson, "Real-Time Collision Detection"
//! (2005), §5.1.5, in f64; degenerate triangles are treated as their edges. The hierarchy is a binary tree of
//! axis-aligned boxes, split at the median of the longest axis, searched depth first with the nearer child first. It
//! is deterministic and can be shared between threads.
//!
//! Cost: building is O(n log n); memory about 40 bytes per triangle and 24 per position (boxes are f32, rounded
//! outwards). A nearest query near the surface visits O(log n) nodes, one far away more.

use glam::DVec3;

/// Triangles per leaf; with fewer than four, boxes cost more than they save.
const LEAF_TRIANGLES: usize = 4;

/// Upper bound on the depth: each split halves the triangles, of which there are fewer than 2^32.
const STACK: usize = 40;

/// A triangle whose squared double area is below this share of its edges' squared product is
/// treated as a segment: its barycentric coordinates would be noise.
const DEGENERATE: f64 = 1e-28;

/// A triangle whose squared double area is below this share of its edges' squared product is thin: the
/// determinants that tell where a point projects to lose all their digits along its length.
const THIN: f64 = 1e-8;

/// The point of the triangle `a b c` that is nearest to `p`.
#[must_use]
pub fn closest_point_on_triangle(p: DVec3, [a, b, c]: [DVec3; 3]) -> DVec3 {
    let ab = b - a;
    let ac = c - a;
    let normal = ab.cross(ac);
    let scale = ab.length_squared() * ac.length_squared();
    if normal.length_squared() <= THIN * scale {
        let inside = normal.length_squared() > DEGENERATE * scale;
        return closest_point_on_thin_triangle(p, [a, b, c], inside.then_some(normal));
    }
    // The regions are tried in Ericson's order: vertex a, vertex b, edge ab, vertex c, edge ac,
    // edge bc, inside.
    let ap = p - a;
    let d1 = ab.dot(ap);
    let d2 = ac.dot(ap);
    if d1 <= 0.0 && d2 <= 0.0 {
        return a;
    }
    let bp = p - b;
    let d3 = ab.dot(bp);
    let d4 = ac.dot(bp);
    if d3 >= 0.0 && d4 <= d3 {
        return b;
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        return a + ab * (d1 / (d1 - d3));
    }
    let cp = p - c;
    let d5 = ab.dot(cp);
    let d6 = ac.dot(cp);
    if d6 >= 0.0 && d5 <= d6 {
        return c;
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        return a + ac * (d2 / (d2 - d6));
    }
    let va = d3 * d6 - d5 * d4;
    if va <= 0.0 && d4 - d3 >= 0.0 && d5 - d6 >= 0.0 {
        return b + (c - b) * ((d4 - d3) / ((d4 - d3) + (d5 - d6)));
    }
    let sum = va + vb + vc;
    a + ab * (vb / sum) + ac * (vc / sum)
}

/// Whether the bounding box of a triangle, and so the triangle, is farther from `p` than √`limit`. A quarter of the
/// cost of the exact distance.
#[inline]
pub(crate) fn box_is_beyond(p: DVec3, [a, b, c]: [DVec3; 3], limit: f64) -> bool {
    let less = |x: f64, y: f64| if x < y { x } else { y };
    let more = |x: f64, y: f64| if x > y { x } else { y };
    let outside =
        |p: f64, a: f64, b: f64, c: f64| more(more(less(less(a, b), c) - p, p - more(more(a, b), c)), 0.0);
    let way =
        DVec3::new(outside(p.x, a.x, b.x, c.x), outside(p.y, a.y, b.y, c.y), outside(p.z, a.z, b.z, c.z));
    // Both sides are rounded.
    way.length_squared() > limit * (1.0 + 1e-9)
}

/// The nearest point on the edges, or the foot of the perpendicular if the triangle has a normal and the foot is
/// inside.
fn closest_point_on_thin_triangle(p: DVec3, [a, b, c]: [DVec3; 3], normal: Option<DVec3>) -> DVec3 {
    let edge = closest_point_on_edges(p, [a, b, c]);
    let Some(n) = normal else { return edge };
    let foot = p - n * (n.dot(p - a) / n.length_squared());
    let inside = [(a, b), (b, c), (c, a)].iter().all(|&(s, e)| (e - s).cross(foot - s).dot(n) >= 0.0);
    if inside && p.distance_squared(foot) < p.distance_squared(edge) { foot } else { edge }
}

/// The nearest point on three segments, for triangles without interior.
fn closest_point_on_edges(p: DVec3, [a, b, c]: [DVec3; 3]) -> DVec3 {
    let mut best = closest_point_on_segment(p, a, b);
    for q in [closest_point_on_segment(p, b, c), closest_point_on_segment(p, c, a)] {
        if p.distance_squared(q) < p.distance_squared(best) {
            best = q;
        }
    }
    best
}

/// The nearest point of the segment `a b`, which may be degenerate (Ericson §5.1.2).
fn closest_point_on_segment(p: DVec3, a: DVec3, b: DVec3) -> DVec3 {
    let ab = b - a;
    let t = ab.dot(p - a);
    let length_squared = ab.length_squared();
    if t <= 0.0 || length_squared == 0.0 {
        a
    } else if t >= length_squared {
        b
    } else {
        a + ab * (t / length_squared)
    }
}

/// A node: a box, and either two children side by side or a run of triangles.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Node {
    /// Rounded outwards.
    pub(crate) low: [f32; 3],
    pub(crate) high: [f32; 3],
    /// First triangle of a leaf; else index of the first of two adjacent children.
    pub(crate) start: u32,
    /// Triangles of a leaf; 0 for an inner node.
    pub(crate) count: u32,
}

impl Node {
    const EMPTY: Self = Self { low: [0.0; 3], high: [0.0; 3], start: 0, count: 0 };

    /// Squared distance from `p` to the box; 0 inside.
    fn distance_squared(&self, p: DVec3) -> f64 {
        let [low, high] = [self.low, self.high].map(|x| DVec3::from_array(x.map(f64::from)));
        let outside = (low - p).max(p - high).max(DVec3::ZERO);
        outside.length_squared()
    }
}

/// A bounding volume hierarchy over triangles, for distance and ray queries.
#[derive(Clone, Debug)]
pub struct TriangleBvh {
    pub(super) nodes: Vec<Node>,
    pub(super) positions: Vec<DVec3>,
    /// Corners as indices of `positions`, in the order of the leaves.
    pub(super) triangles: Vec<[u32; 3]>,
    /// The caller's index of each of `triangles`.
    pub(super) ids: Vec<u32>,
}

impl TriangleBvh {
    /// Its nodes (root first), the positions, and the triangles in leaf order.
    pub(crate) fn into_parts(self) -> (Vec<Node>, Vec<DVec3>, Vec<[u32; 3]>) {
        (self.nodes, self.positions, self.triangles)
    }

    /// Builds a hierarchy over `triangles`, which index `positions`. Degenerate triangles count as the segment or
    /// point that they are.
    ///
    /// # Panics
    /// If a triangle refers to a position out of range, or there are 2^31 triangles or more.
    #[must_use]
    pub fn new(positions: &[[f64; 3]], triangles: &[[u32; 3]]) -> Self {
        assert!(triangles.len() < 1 << 31, "a TriangleBvh holds fewer than 2^31 triangles");
        let positions: Vec<DVec3> = positions.iter().map(|&p| DVec3::from_array(p)).collect();
        let corners = |i: u32| triangles[i as usize].map(|v| positions[v as usize]);
        // Centres of boxes rather than of triangles, so slivers are split as their boxes are.
        let centers = (0..triangles.len() as u32).map(|i| {
            let [a, b, c] = corners(i);
            0.5 * (a.min(b).min(c) + a.max(b).max(c))
        });
        let mut order: Vec<(DVec3, u32)> = centers.zip(0..).collect();
        let mut nodes = Vec::with_capacity(triangles.len() / 2 + 1);
        if !order.is_empty() {
            nodes.push(Node { count: order.len() as u32, ..Node::EMPTY });
            let mut open = vec![0usize];
            while let Some(index) = open.pop() {
                let (start, count) = (nodes[index].start as usize, nodes[index].count as usize);
                if count <= LEAF_TRIANGLES {
                    continue;
                }
                let run = &mut order[start..start + count];
                let axis = longest_axis(run);
                let middle = count / 2;
                run.select_nth_unstable_by(middle, |(x, i), (y, j)| {
                    x[axis].total_cmp(&y[axis]).then(i.cmp(j))
                });
                let child = nodes.len();
                nodes[index].start = child as u32;
                nodes[index].count = 0;
                let half = |start: usize, count: usize| Node {
                    start: start as u32,
                    count: count as u32,
                    ..Node::EMPTY
                };
                nodes.extend([half(start, middle), half(start + middle, count - middle)]);
                open.push(child + 1);
                open.push(child);
            }
        }
        let ids: Vec<u32> = order.iter().map(|&(_, id)| id).collect();
        drop(order);
        // Children come after their parents.
        for index in (0..nodes.len()).rev() {
            let Node { start, count, .. } = nodes[index];
            let (low, high) = if count > 0 {
                bounds(corners, &ids[start as usize..(start + count) as usize])
            } else {
                let [a, b] = [nodes[start as usize], nodes[start as usize + 1]];
                let both = [0, 1, 2];
                (both.map(|k| a.low[k].min(b.low[k])), both.map(|k| a.high[k].max(b.high[k])))
            };
            nodes[index] = Node { low, high, start, count };
        }
        nodes.shrink_to_fit();
        let triangles = ids.iter().map(|&i| triangles[i as usize]).collect();
        Self { nodes, positions, triangles, ids }
    }

    /// Whether there is no triangle.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.ids.is_empty()
    }

    /// Distance to the nearest triangle within `max_distance`, and its index as given to [`TriangleBvh::new`]; `None`
    /// if there is none. A finite `max_distance` makes the search cheaper.
    #[must_use]
    pub fn nearest(&self, point: [f64; 3], max_distance: f64) -> Option<(f64, u32)> {
        let p = DVec3::from_array(point);
        let mut best = max_distance * max_distance;
        let mut found = None;
        self.search(
            p,
            |best_so_far, corners, id| {
                let d = p.distance_squared(closest_point_on_triangle(p, *corners));
                if d < *best_so_far || (found.is_none() && d <= *best_so_far) {
                    *best_so_far = d;
                    found = Some(id);
                }
                false
            },
            &mut best,
        );
        found.map(|id| (best.sqrt(), id))
    }

    /// Whether any triangle is at most `radius` away; stops at the first one.
    #[must_use]
    pub fn any_within(&self, point: [f64; 3], radius: f64) -> bool {
        let p = DVec3::from_array(point);
        let mut limit = radius * radius;
        self.search(
            p,
            |limit, corners, _| p.distance_squared(closest_point_on_triangle(p, *corners)) <= *limit,
            &mut limit,
        )
    }

    /// Visits the triangles of all leaves whose box is within √`limit` of `p`, nearer children
    /// first, until `visit` returns true; `visit` may lower the limit. Returns whether it stopped.
    fn search(
        &self,
        p: DVec3,
        mut visit: impl FnMut(&mut f64, &[DVec3; 3], u32) -> bool,
        limit: &mut f64,
    ) -> bool {
        let Some(root) = self.nodes.first() else { return false };
        let mut stack = [(0u32, 0.0f64); STACK];
        stack[0] = (0, root.distance_squared(p));
        let mut depth = 1;
        while depth > 0 {
            depth -= 1;
            let (index, distance) = stack[depth];
            // A NaN distance (from a NaN query) visits nothing.
            if distance > *limit || distance.is_nan() {
                continue;
            }
            let node = &self.nodes[index as usize];
            let start = node.start as usize;
            if node.count > 0 {
                let run = start..start + node.count as usize;
                for (corners, &id) in self.triangles[run.clone()].iter().zip(&self.ids[run]) {
                    if visit(limit, &corners.map(|v| self.positions[v as usize]), id) {
                        return true;
                    }
                }
                continue;
            }
            let near = (node.start, self.nodes[start].distance_squared(p));
            let far = (node.start + 1, self.nodes[start + 1].distance_squared(p));
            let (near, far) = if near.1 <= far.1 { (near, far) } else { (far, near) };
            stack[depth] = far;
            stack[depth + 1] = near;
            depth += 2;
        }
        false
    }
}

/// The box of the triangles `ids`, rounded outwards.
fn bounds(corners: impl Fn(u32) -> [DVec3; 3], ids: &[u32]) -> ([f32; 3], [f32; 3]) {
    let mut low = DVec3::INFINITY;
    let mut high = DVec3::NEG_INFINITY;
    for &id in ids {
        for corner in corners(id) {
            low = low.min(corner);
            high = high.max(corner);
        }
    }
    let below = |x: f64| if f64::from(x as f32) > x { (x as f32).next_down() } else { x as f32 };
    let above = |x: f64| if f64::from(x as f32) < x { (x as f32).next_up() } else { x as f32 };
    (low.to_array().map(below), high.to_array().map(above))
}

/// The axis with the largest spread of centres.
fn longest_axis(run: &[(DVec3, u32)]) -> usize {
    let mut low = DVec3::INFINITY;
    let mut high = DVec3::NEG_INFINITY;
    for &(center, _) in run {
        low = low.min(center);
        high = high.max(center);
    }
    let size = high - low;
    if size.x >= size.y && size.x >= size.z {
        0
    } else if size.y >= size.z {
        1
    } else {
        2
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const TRIANGLE: [DVec3; 3] =
        [DVec3::new(0.0, 0.0, 0.0), DVec3::new(4.0, 0.0, 0.0), DVec3::new(0.0, 4.0, 0.0)];

    fn distance(p: [f64; 3], triangle: [DVec3; 3]) -> f64 {
        let p = DVec3::from_array(p);
        p.distance(closest_point_on_triangle(p, triangle))
    }

    #[test]
    fn every_voronoi_region_of_a_triangle() {
        let cases = [
            ([1.0, 1.0, 3.0], 3.0),           // inside
            ([-3.0, -4.0, 0.0], 5.0),         // vertex a
            ([7.0, -4.0, 0.0], 5.0),          // vertex b
            ([-4.0, 7.0, 0.0], 5.0),          // vertex c
            ([2.0, -3.0, 4.0], 5.0),          // edge ab
            ([-3.0, 2.0, 4.0], 5.0),          // edge ac
            ([4.0, 4.0, 0.0], 8.0f64.sqrt()), // edge bc
            ([4.0, 4.0, 1.0], 3.0),           // edge bc, off the plane
        ];
        for (p, expected) in cases {
            assert!((distance(p, TRIANGLE) - expected).abs() < 1e-12, "{p:?}");
        }
    }

    #[test]
    fn degenerate_triangles_are_segments_and_points() {
        let [a, b, c] = TRIANGLE;
        assert_eq!(distance([3.0, 4.0, 0.0], [a, a, a]), 5.0);
        assert_eq!(distance([2.0, 3.0, 0.0], [a, a, b]), 3.0);
        assert_eq!(distance([3.0, 2.0, 0.0], [a, c, a]), 3.0);
        assert_eq!(distance([2.0, 3.0, 0.0], [a, b, b]), 3.0);
        assert_eq!(distance([2.0, 3.0, 0.0], [a, DVec3::X, b]), 3.0);
        assert_eq!(distance([7.0, 4.0, 0.0], [DVec3::X, a, b]), 5.0);
    }

    #[test]
    fn points_of_a_needle_are_on_it() {
        for length in [1e3, 1e6, 1.6e7] {
            let needle = [DVec3::ZERO, DVec3::new(length, 1.0, 2.0), DVec3::new(length, 0.0, 3.0)];
            let [a, b, c] = needle;
            for i in 0..=40 {
                for j in 0..=40 - i {
                    let (u, v) = (f64::from(i) / 40.0, f64::from(j) / 40.0);
                    let on = a * (1.0 - u - v) + b * u + c * v;
                    let d = distance(on.to_array(), needle);
                    assert!(d <= 1e-7, "{length} long: {d} from itself");
                    let above = on + DVec3::new(0.0, 3.0, 3.0);
                    let d = distance(above.to_array(), needle);
                    assert!(d <= 18.0_f64.sqrt() + 1e-6, "{length} long: {d}");
                }
            }
        }
    }

    #[test]
    fn an_empty_hierarchy_finds_nothing() {
        let bvh = TriangleBvh::new(&[], &[]);
        assert!(bvh.is_empty());
        assert_eq!(bvh.nearest([0.0; 3], f64::INFINITY), None);
        assert!(!bvh.any_within([0.0; 3], f64::INFINITY));
    }

    #[test]
    fn limits_are_inclusive_and_nan_finds_nothing() {
        let bvh = TriangleBvh::new(&TRIANGLE.map(|v| v.to_array()), &[[0, 1, 2]]);
        assert_eq!(bvh.nearest([1.0, 1.0, 2.0], 2.0), Some((2.0, 0)));
        assert_eq!(bvh.nearest([1.0, 1.0, 2.0], 1.99), None);
        assert!(bvh.any_within([1.0, 1.0, 2.0], 2.0));
        assert!(!bvh.any_within([1.0, 1.0, 2.0], 1.99));
        assert_eq!(bvh.nearest([f64::NAN, 0.0, 0.0], f64::INFINITY), None);
    }

    #[test]
    fn many_equal_triangles_do_not_deepen_the_tree() {
        let bvh = TriangleBvh::new(&TRIANGLE.map(|v| v.to_array()), &vec![[0, 1, 2]; 10_000]);
        assert_eq!(bvh.nearest([1.0, 1.0, 2.0], f64::INFINITY).map(|n| n.0), Some(2.0));
    }

    fn coordinate() -> impl Strategy<Value = f64> {
        // Few distinct values, so degenerate and touching triangles are common.
        prop_oneof![(-4i32..=4).prop_map(f64::from), -4.0..4.0f64]
    }

    fn point() -> impl Strategy<Value = [f64; 3]> {
        [coordinate(), coordinate(), coordinate()]
    }

    proptest! {
        #[test]
        fn the_hierarchy_agrees_with_brute_force(
            positions in prop::collection::vec(point(), 3..40),
            picks in prop::collection::vec([any::<u32>(), any::<u32>(), any::<u32>()], 1..120),
            query in point(),
            limit in 0.0..6.0f64,
        ) {
            let n = positions.len() as u32;
            let triangles: Vec<[u32; 3]> = picks.iter().map(|t| t.map(|i| i % n)).collect();
            let bvh = TriangleBvh::new(&positions, &triangles);
            let brute = |t: &[u32; 3]| {
                distance(query, t.map(|v| DVec3::from_array(positions[v as usize])))
            };
            let expected = triangles.iter().map(brute).fold(f64::INFINITY, f64::min);
            let (found, id) = bvh.nearest(query, f64::INFINITY).unwrap();
            prop_assert!((found - expected).abs() <= 1e-12, "{found} {expected}");
            prop_assert!((brute(&triangles[id as usize]) - expected).abs() <= 1e-12);
            if (limit - expected).abs() > 1e-9 {
                prop_assert_eq!(bvh.any_within(query, limit), expected < limit);
                prop_assert_eq!(bvh.nearest(query, limit).is_some(), expected < limit);
            }
        }

        #[test]
        fn no_point_of_the_triangle_is_nearer(
            corners in [point(), point(), point()],
            query in point(),
            weights in [0.0..1.0f64, 0.0..1.0f64, 0.0..1.0f64],
        ) {
            let [a, b, c] = corners.map(DVec3::from_array);
            let [u, v, w] = weights.map(|x| x / (weights[0] + weights[1] + weights[2]).max(1e-300));
            let on_triangle = a * u + b * v + c * w;
            let p = DVec3::from_array(query);
            prop_assert!(distance(query, [a, b, c]) <= p.distance(on_triangle) + 1e-9);
        }
    }
}
