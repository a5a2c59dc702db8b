//! Input to coarse, between the samples: input faces that lie over several coarse faces.
//!
//! Over one coarse face the distance is largest at a corner, and across an edge of the coarse surface it is
//! about that of the edge. But where an input face's corners are near coarse faces that do not meet, the
//! coarse surface may be open between these: its middle and those of its edges are looked at, and more of it
//! where one is far.

use crate::mesh::vec3::{length, sub};
use crate::simplify::deviation::{
    DENSE, Deviation, LEAP, LEAST_DENSE, MOST_DENSE, SUSPICIOUS, between, middle, over_face,
};
use crate::simplify::surroundings::{Surroundings, distance_to};

impl Deviation {
    /// Looks at the input faces around the samples whose corners are near several coarse faces, one of them
    /// `placed` anew: adds those that may be far and answers the largest distance, at least `error`. A face
    /// that lies over several regions counts in each: its middle may be far while any of them is missing.
    /// `samples` ascend.
    pub(crate) fn faces(
        &self,
        region: &Surroundings<'_>,
        placed: &dyn Fn(u32) -> bool,
        samples: &[u32],
        exact: bool,
        far: &mut Vec<u32>,
        mut error: f64,
    ) -> f64 {
        let live = region.live;
        let vertices = live.positions.len();
        for &sample in samples.iter().filter(|&&s| (s as usize) < vertices) {
            for &face in self.input_faces.row(sample) {
                let corners = self.input.triangles()[face as usize];
                // Once per region: from its first corner that is among the samples.
                let first = |v: &&u32| **v == sample || samples.binary_search(v).is_ok();
                if !corners.into_iter().any(placed) || corners.iter().find(first) != Some(&sample) {
                    continue;
                }
                let [a, b, c] = corners.map(|v| self.attached[v as usize]);
                let joints = [(a, b), (b, c), (c, a)].into_iter().filter(|&(f, g)| live.share_an_edge(f, g));
                if joints.count() < 3 {
                    let distance = self.face(region, face, error, exact);
                    if distance > 0.0 {
                        far.push(face);
                        error = error.max(distance);
                    }
                }
            }
        }
        error
    }

    /// Looks again at the input faces of `far`: the largest distance, at least `error`.
    pub(crate) fn faces_again(&self, region: &Surroundings<'_>, far: &[u32], error: f64) -> f64 {
        far.iter().fold(error, |error, &face| error.max(self.face(region, face, error, true)))
    }

    /// The largest distance of an input face, where that may be more than `error`, else 0; from the
    /// nearest coarse faces of all if `exact`, else mostly from those that are nearer than all around them.
    fn face(&self, region: &Surroundings<'_>, face: u32, error: f64, exact: bool) -> f64 {
        let live = region.live;
        let corners = self.input.triangles()[face as usize];
        let near = corners.map(|v| self.attached[v as usize]);
        if !near.iter().all(|&f| live.alive[f as usize]) {
            return 0.0;
        }
        // Of a point, or of none farther than `enough`; the nearest face may lie in another region.
        let distance = |point, enough: f64| {
            let mut best = (f64::INFINITY, near[0]);
            for face in near {
                let distance = distance_to(point, live.triangle(face as usize));
                if distance <= enough {
                    return distance;
                }
                if distance < best.0 {
                    best = (distance, face);
                }
            }
            best = region.walk_over(&|_| true, point, best, enough);
            let closely = best.0 > enough && (exact || best.0 > LEAP * error.max(self.mean_edge));
            if closely { region.nearer(point, best.0) } else { best.0 }
        };
        let limit = SUSPICIOUS * error;
        let suspicious = |point| distance(point, limit) > limit;
        let points = corners.map(|v| self.input.position(v));
        let edges = [(0, 1), (1, 2), (2, 0)];
        let halfway = |(i, j): (usize, usize)| between(points[i], points[j], 1, 2);
        let mut apart = edges.into_iter().filter(|&(i, j)| near[i] != near[j]);
        if !suspicious(middle(points)) && !apart.any(|edge| suspicious(halfway(edge))) {
            return 0.0;
        }
        let mut most = limit;
        let mut look = |point| most = most.max(distance(point, most));
        let edges = edges.map(|(i, j)| (points[i], points[j]));
        let longest = edges.iter().map(|&(a, b)| length(sub(b, a))).fold(0.0, f64::max);
        let n = ((DENSE * longest / self.mean_edge).ceil() as usize).clamp(LEAST_DENSE, MOST_DENSE);
        over_face(points, n, &mut look);
        for (a, b) in edges {
            (1..n).for_each(|i| look(between(a, b, i, n)));
        }
        most
    }
}

#[cfg(test)]
mod tests {
    use crate::common;
    use crate::mesh::{Corner, SourceMesh};
    use crate::simplify::deviation::Deviation;
    use crate::simplify::live::Live;
    use crate::simplify::surroundings::Surroundings;

    /// While only the region around its second corner is missing, its middle is that region's fault.
    #[test]
    fn an_input_face_over_two_regions_counts_in_both() {
        // A long triangle, and a small one around each of its ends, which are left and do not meet.
        let triangles = [
            [[0.0, 0.0], [10.0, 0.0], [10.0, 0.5]],
            [[-0.1, -0.1], [0.2, 0.0], [0.0, 0.2]],
            [[9.8, -0.1], [10.2, -0.1], [10.0, 0.8]],
        ];
        let mut mesh = SourceMesh::default();
        for (i, triangle) in (0..).zip(triangles) {
            mesh.positions.extend(triangle.map(|[x, y]| [x, y, 0.0]));
            mesh.faces.push([3 * i, 3 * i + 1, 3 * i + 2].map(Corner::at));
            mesh.materials.push(0);
        }
        let mesh = common::quantised(&mesh);
        let live = Live::new(&mesh);
        let mut deviation = Deviation::new(&live, mesh.uv_grid);
        let start = mesh.wedges[mesh.faces[0].wedges[0] as usize].vertex;
        for vertex in mesh.faces[0].wedges.map(|w| mesh.wedges[w as usize].vertex) {
            let face = if vertex == start { 1 } else { 2 };
            deviation.attach(&[(vertex, face, 0.0)]);
        }
        let half = 4.0 / mesh.grid.step;
        for region in [1, 2] {
            let samples: Vec<u32> =
                (0..live.positions.len() as u32).filter(|&v| deviation.face_near(v) == region).collect();
            let (faces, inside) = ([region], |f: u32| f == region);
            let around = Surroundings::new(&live, &faces, &inside);
            let mut far = Vec::new();
            let error = deviation.faces(&around, &|_| true, &samples, true, &mut far, 0.0);
            assert_eq!(far, [0], "region {region}");
            assert!(error > half, "region {region}: {error}");
        }
    }
}
