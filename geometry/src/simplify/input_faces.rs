//! Input to coarse, between the samples: input faces that lie over several coarse faces.
//!
//! Over one coarse face the distance is largest at a corner, and across an edge of the coarse surface it is
//! about that of the edge. But where an input face's corners are near coarse faces that do not meet, the
//! coarse surface may be open between these: its middle and those of its edges are looked at, and more of it
//! where one is far.

use crate::mesh::vec3::{Vec3, dot, length, sub};
use crate::simplify::deviation::{
    DENSE, Deviation, LEAP, LEAST_DENSE, MOST_DENSE, Own, SUSPICIOUS, between, middle, on_face,
};
use crate::simplify::surroundings::{ROUNDING, Surroundings, distance_to};

impl Deviation {
    /// Looks at the input faces around the samples whose corners are near several coarse faces, one of them
    /// `placed` anew: adds those that may be far and answers the largest distance, at least `error`. A face
    /// that lies over several regions counts in each: its middle may be far while any of them is missing.
    pub(crate) fn faces(
        &self,
        region: &Surroundings<'_>,
        placed: &impl Fn(u32) -> bool,
        samples: Own<'_>,
        exact: bool,
        far: &mut Vec<u32>,
        mut error: f64,
    ) -> f64 {
        let live = region.live;
        let vertices = live.positions.len();
        for &sample in samples.list.iter().take_while(|&&s| (s as usize) < vertices) {
            // Most of a coarse level's are nearer than what is known: no face need be looked at.
            if self.all_around_within(sample, SUSPICIOUS * error) {
                continue;
            }
            for &face in self.input_faces.row(sample) {
                let corners = self.input.triangles()[face as usize];
                let [a, b, c] = corners.map(|v| self.attached[v as usize]);
                if (a == b && b == c) || !corners.into_iter().any(placed) {
                    continue;
                }
                // Once per region: from its first corner that is among the samples.
                let first = corners.into_iter().find(|&v| samples.contains(v));
                if first != Some(sample)
                    || corners.into_iter().any(|v| self.all_around_within(v, SUSPICIOUS * error))
                {
                    continue;
                }
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
        let limit = SUSPICIOUS * error;
        let points = corners.map(|v| self.input.position(v));
        // What a corner is near is no farther from a point than the corner and the way there.
        let reach = corners.map(|v| limit - self.last_distance(v) * ROUNDING);
        let at_hand = |point| {
            (0..3).any(|k| {
                let way = sub(point, points[k]);
                reach[k] > 0.0 && dot(way, way) * ROUNDING <= reach[k] * reach[k]
            })
        };
        let triangles = near.map(|f| live.triangle(f as usize));
        let far_from = error.max(self.mean_edge) * LEAP;
        let over = Over { region, near, triangles, nearest_beyond: if exact { 0.0 } else { far_from } };
        let suspicious = |point, order| !at_hand(point) && over.farther(point, order, limit).is_some();
        let edges = [(0, 1), (1, 2), (2, 0)];
        let halfway = |(i, j): (usize, usize)| between(points[i], points[j], 1, 2);
        let mut apart = edges.into_iter().filter(|&(i, j)| near[i] != near[j]);
        if !suspicious(middle(points), [0, 1, 2])
            && !apart.any(|(i, j)| suspicious(halfway((i, j)), [i, j, 3 - i - j]))
        {
            return 0.0;
        }
        let mut most = limit;
        let edges = edges.map(|(i, j)| (points[i], points[j]));
        let longest = edges.iter().map(|&(a, b)| length(sub(b, a))).fold(0.0, f64::max);
        let n = ((DENSE * longest / self.mean_edge).ceil() as usize).clamp(LEAST_DENSE, MOST_DENSE);
        for i in 1..n - 1 {
            over.row(&|j| on_face(points, n, i, j), (1, n - i - 1), &mut most);
        }
        for (a, b) in edges {
            over.row(&|i| between(a, b, i, n), (1, n - 1), &mut most);
        }
        most
    }
}

/// An input face over the coarse faces that its corners are near.
struct Over<'a> {
    region: &'a Surroundings<'a>,
    near: [u32; 3],
    /// The corners of these.
    triangles: [[Vec3; 3]; 3],
    /// Points that are farther than this from what is around are compared with the nearest coarse face of all.
    nearest_beyond: f64,
}

impl Over<'_> {
    /// How far a point is, if that is more than `enough`; the nearest face may lie in another region. The corners' faces
    /// are asked in the given order.
    fn farther(&self, point: Vec3, order: [usize; 3], enough: f64) -> Option<f64> {
        let mut distances = [0.0; 3];
        for k in order {
            distances[k] = distance_to(point, self.triangles[k]);
            if distances[k] <= enough {
                return None;
            }
        }
        self.farther_than_those(point, distances, enough)
    }

    /// The same where the distances from the corners' faces are known, and are more.
    fn farther_than_those(&self, point: Vec3, distances: [f64; 3], enough: f64) -> Option<f64> {
        let mut best = (distances[0], self.near[0]);
        for nearer in distances.into_iter().zip(self.near).skip(1) {
            if nearer.0 < best.0 {
                best = nearer;
            }
        }
        best = self.region.walk_over(&|_| true, point, best, enough);
        if best.0 > enough && best.0 > self.nearest_beyond {
            best.0 = self.region.nearer(point, best.0);
        }
        (best.0 > enough).then_some(best.0)
    }

    fn distances(&self, point: Vec3) -> [f64; 3] {
        self.triangles.map(|triangle| distance_to(point, triangle))
    }

    /// Raises `most` to the largest distance of the points `point(from)` to `point(to)`, which lie on a line.
    fn row(&self, point: &impl Fn(usize) -> Vec3, (from, to): (usize, usize), most: &mut f64) {
        let ends = [from, to].map(|i| self.distances(point(i)));
        for (i, distances) in [(from, ends[0]), (to, ends[1])].into_iter().take(1 + usize::from(to > from)) {
            self.raise(point(i), distances, most);
        }
        self.between(point, (from, to), ends, most);
    }

    /// The same but for the ends. The distance from a triangle is convex, so between two points it is no larger than at
    /// the ends: most of a row is passed over.
    fn between(
        &self,
        point: &impl Fn(usize) -> Vec3,
        (from, to): (usize, usize),
        ends: [[f64; 3]; 2],
        most: &mut f64,
    ) {
        let enough = |k: usize| ends[0][k].max(ends[1][k]) * ROUNDING <= *most;
        if to - from < 2 || (0..3).any(enough) {
            return;
        }
        let middle = from + (to - from) / 2;
        let distances = self.distances(point(middle));
        self.raise(point(middle), distances, most);
        self.between(point, (from, middle), [ends[0], distances], most);
        self.between(point, (middle, to), [distances, ends[1]], most);
    }

    fn raise(&self, point: Vec3, distances: [f64; 3], most: &mut f64) {
        if distances.iter().all(|distance| distance > most)
            && let Some(distance) = self.farther_than_those(point, distances, *most)
        {
            *most = distance;
        }
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
            let samples = deviation.by_region(&[0, 1, 2], 3);
            let (faces, inside) = ([region], |f: u32| f == region);
            let around = Surroundings::new(&live, &faces, &inside);
            let mut far = Vec::new();
            let error = deviation.faces(&around, &|_| true, samples.of(region as usize), true, &mut far, 0.0);
            assert_eq!(far, [0], "region {region}");
            assert!(error > half, "region {region}: {error}");
        }
    }
}
