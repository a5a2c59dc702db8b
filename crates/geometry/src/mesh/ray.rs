//! Ray casting: the first intersection of a ray with a surface.

use glam::DVec3;

use crate::mesh::distance::{Node, TriangleBvh};

/// Capacity of the traversal stack: one pending node per level.
const STACK: usize = 64;

impl TriangleBvh {
    /// The first triangle that a ray hits from either side, at more than `range[0]` and less than `range[1]` lengths of
    /// `direction` from `origin`: the parameter, and the index as given to [`TriangleBvh::new`]. A ray in the plane of
    /// a triangle misses it; one along an edge hits at least one of the adjacent triangles, up to rounding (Möller and
    /// Trumbore, "Fast, minimum storage ray/triangle intersection", 1997). O(log n) for small triangles.
    #[must_use]
    pub fn first_hit(&self, origin: [f64; 3], direction: [f64; 3], range: [f64; 2]) -> Option<(f64, u32)> {
        let (origin, direction) = (DVec3::from_array(origin), DVec3::from_array(direction));
        let inverse = direction.recip();
        let [after, mut before] = range;
        let mut found = None;
        let mut stack = [(0_u32, 0.0_f64); STACK];
        let mut waiting = 0;
        if let Some(at) = self.nodes.first().and_then(|root| box_entry(root, origin, inverse, range)) {
            stack[0] = (0, at);
            waiting = 1;
        }
        while waiting > 0 {
            waiting -= 1;
            let (index, at) = stack[waiting];
            if at > before {
                continue;
            }
            let node = &self.nodes[index as usize];
            let start = node.start as usize;
            if node.count > 0 {
                for i in start..start + node.count as usize {
                    let corners = self.triangles[i].map(|v| self.positions[v as usize]);
                    let hit = triangle_hit(origin, direction, corners);
                    if let Some(t) = hit.filter(|t| *t > after && *t < before) {
                        before = t;
                        found = Some((t, self.ids[i]));
                    }
                }
                continue;
            }
            let entered = [start, start + 1].map(|child| {
                let at = box_entry(&self.nodes[child], origin, inverse, [after, before]);
                at.map(|at| (child as u32, at))
            });
            let mut push = |child| {
                stack[waiting] = child;
                waiting += 1;
            };
            match entered {
                // The nearer one on top.
                [Some(a), Some(b)] if a.1 <= b.1 => [b, a].into_iter().for_each(&mut push),
                children => children.into_iter().flatten().for_each(&mut push),
            }
        }
        found
    }
}

/// Entry parameter of a ray into a box, if within the range (Kay and Kajiya, "Ray tracing complex scenes", 1986).
fn box_entry(node: &Node, origin: DVec3, inverse: DVec3, [after, before]: [f64; 2]) -> Option<f64> {
    let (mut near, mut far) = (after, before);
    for axis in 0..3 {
        let [a, b] =
            [node.low, node.high].map(|corner| (f64::from(corner[axis]) - origin[axis]) * inverse[axis]);
        // `min` and `max` ignore NaN, which occurs for a ray within a side of the box.
        near = near.max(a.min(b));
        far = far.min(a.max(b));
    }
    (near <= far).then_some(near)
}

fn triangle_hit(origin: DVec3, direction: DVec3, [a, b, c]: [DVec3; 3]) -> Option<f64> {
    let (ab, ac) = (b - a, c - a);
    let across = direction.cross(ac);
    let volume = ab.dot(across);
    let from = origin - a;
    let u = from.dot(across) / volume;
    let other = from.cross(ab);
    let v = direction.dot(other) / volume;
    // Written so that NaN means no intersection.
    (u >= 0.0 && v >= 0.0 && u + v <= 1.0).then(|| ac.dot(other) / volume)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn a_ray_meets_the_nearest_in_its_range_from_both_sides() {
        let square = |z: f64| [[-1.0, -1.0, z], [1.0, -1.0, z], [0.0, 2.0, z]];
        let positions: Vec<[f64; 3]> = [1.0, 2.0, 3.0].into_iter().flat_map(square).collect();
        let bvh = TriangleBvh::new(&positions, &[[0, 1, 2], [5, 4, 3], [6, 7, 8]]);
        let up = [0.0, 0.0, 0.5];
        assert_eq!(bvh.first_hit([0.0; 3], up, [0.0, 9.0]), Some((2.0, 0)));
        assert_eq!(bvh.first_hit([0.0; 3], up, [2.0, 9.0]), Some((4.0, 1)));
        assert_eq!(bvh.first_hit([0.0; 3], up, [0.0, 2.0]), None);
        assert_eq!(bvh.first_hit([0.0, 0.0, 9.0], [0.0, 0.0, -1.0], [0.0, 99.0]), Some((6.0, 2)));
        assert_eq!(bvh.first_hit([5.0, 0.0, 0.0], up, [0.0, 9.0]), None);
        assert_eq!(bvh.first_hit([f64::NAN; 3], up, [0.0, 9.0]), None);
        assert_eq!(TriangleBvh::new(&[], &[]).first_hit([0.0; 3], up, [0.0, 9.0]), None);
    }

    proptest! {
        #[test]
        fn the_tree_agrees_with_brute_force(
            positions in prop::collection::vec(prop::array::uniform3(-4_i32..=4), 3..40),
            picks in prop::collection::vec(prop::array::uniform3(any::<u32>()), 1..120),
            rays in prop::collection::vec((prop::array::uniform3(-5.0..5.0_f64), prop::array::uniform3(-1_i32..=1)), 1..20),
        ) {
            let positions: Vec<[f64; 3]> = positions.iter().map(|p| p.map(f64::from)).collect();
            let n = positions.len() as u32;
            let triangles: Vec<[u32; 3]> = picks.iter().map(|t| t.map(|i| i % n)).collect();
            let bvh = TriangleBvh::new(&positions, &triangles);
            for (origin, direction) in rays {
                // Axis directions too, where slabs divide by zero.
                let direction = direction.map(f64::from);
                let (from, along) = (DVec3::from_array(origin), DVec3::from_array(direction));
                let of = |t: &[u32; 3]| triangle_hit(from, along, t.map(|v| DVec3::from_array(positions[v as usize])));
                let nearest = triangles.iter().filter_map(of).filter(|t| *t > 0.0 && *t < 20.0).reduce(f64::min);
                let found = bvh.first_hit(origin, direction, [0.0, 20.0]).map(|(t, _)| t);
                prop_assert_eq!(found, nearest);
            }
        }
    }
}
