//! Distance from input to coarse mesh between the samples: input faces over several coarse faces.
//!
//! Over one coarse face the distance is largest at a corner, and across an edge of the coarse surface it is about
//! that of the edge. But if an input face's corners are nearest to coarse faces that do not meet, the coarse surface
//! may be open between these: the face's centre and edge midpoints are examined, and more points where one is far.

use crate::mesh::corner::face_of;
use crate::mesh::four::FourPoints;
use crate::mesh::vec3::{Vec3, dot, length, sub};
use crate::simplify::deviation::{
    DENSE, Deviation, LEAP, MAX_DENSE, MIN_DENSE, RegionSamples, SUSPICIOUS, between, middle, on_face,
};
use crate::simplify::live::Live;
use crate::simplify::surroundings::{ROUNDING, Surroundings, distance_to};

impl Deviation {
    /// Examines the input faces around the samples whose corners are nearest to several coarse faces, at least one of
    /// them newly `placed`. Appends possibly far ones to `far`; returns the largest distance, at least `error`. A
    /// face over several regions counts in each, since its centre may be far while any of them is missing.
    pub(crate) fn faces(
        &self,
        region: &Surroundings<'_>,
        placed: &impl Fn(u32) -> bool,
        samples: RegionSamples<'_>,
        exact: bool,
        far: &mut Vec<u32>,
        mut error: f64,
    ) -> f64 {
        let live = region.live;
        let vertices = live.positions.len();
        for &sample in samples.list.iter().take_while(|&&s| (s as usize) < vertices) {
            // In coarse levels most samples are nearer than the known error, so no face needs examination.
            if self.all_around_within(sample, SUSPICIOUS * error) {
                continue;
            }
            for &face in self.input_faces.row(sample) {
                let corners = self.input.triangles()[face as usize];
                let [a, b, c] = corners.map(|v| self.attached[v as usize]);
                if (a == b && b == c) || !corners.into_iter().any(placed) {
                    continue;
                }
                // Once per region: from its first corner among the samples.
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

    /// Examines the input faces of `far` again: the largest distance, at least `error`.
    pub(crate) fn recheck_faces(&self, region: &Surroundings<'_>, far: &[u32], error: f64) -> f64 {
        far.iter().fold(error, |error, &face| error.max(self.face(region, face, error, true)))
    }

    /// The largest distance of an input face if it may exceed `error`, else 0. With `exact` from the nearest coarse
    /// faces of all, otherwise usually from faces found by descent.
    fn face(&self, region: &Surroundings<'_>, face: u32, error: f64, exact: bool) -> f64 {
        let live = region.live;
        let corners = self.input.triangles()[face as usize];
        let near = corners.map(|v| self.attached[v as usize]);
        if !near.iter().all(|&f| live.alive[f as usize]) {
            return 0.0;
        }
        let limit = SUSPICIOUS * error;
        let points = corners.map(|v| self.input.position(v));
        let triangles = near.map(|f| live.triangle(f as usize));
        // Points between corners with the same nearest face are no farther from it than the corners.
        let is_apart = |i: usize, j: usize| near[i] != near[j];
        let halfway = |i: usize, j: usize| between(points[i], points[j], 1, 2);
        let sample_points = [middle(points), halfway(0, 1), halfway(1, 2), halfway(2, 0)];
        let open = [true, is_apart(0, 1), is_apart(1, 2), is_apart(2, 0)];
        // Nearly all points are near the faces of the corners.
        let mut left = (0..4).filter(|&i| open[i]).fold(0_u32, |bits, i| bits | 1 << i);
        let four = FourPoints::new(sample_points);
        for triangle in triangles {
            if left != 0 {
                left &= !four.within(triangle, limit);
            }
        }
        let mut bridges = Bridges::new(live, near);
        while left != 0
            && let Some(bridge) = bridges.next()
        {
            left &= !four.within(bridge, limit);
        }
        if left == 0 {
            return 0.0;
        }
        // A corner's nearest face is no farther from a point than the corner's distance plus the way to the corner.
        let reach = corners.map(|v| limit - self.last_distance(v) * ROUNDING);
        let at_hand = |point| {
            (0..3).any(|k| {
                let way = sub(point, points[k]);
                reach[k] > 0.0 && dot(way, way) * ROUNDING <= reach[k] * reach[k]
            })
        };
        let far_from = error.max(self.mean_edge) * LEAP;
        let over = InputFace { region, near, triangles, nearest_beyond: if exact { 0.0 } else { far_from } };
        let suspicious = |point, order| !at_hand(point) && over.farther(point, order, limit).is_some();
        let orders = [[0, 1, 2], [0, 1, 2], [1, 2, 0], [2, 0, 1]];
        if !(0..4).any(|i| left >> i & 1 == 1 && suspicious(sample_points[i], orders[i])) {
            return 0.0;
        }
        let edges = [(0, 1), (1, 2), (2, 0)].map(|(i, j)| (points[i], points[j]));
        let longest = edges.iter().map(|&(a, b)| length(sub(b, a))).fold(0.0, f64::max);
        let n = ((DENSE * longest / self.mean_edge).ceil() as usize).clamp(MIN_DENSE, MAX_DENSE);
        let inner = (1..n - 1).flat_map(|i| (1..n - i).map(move |j| on_face(points, n, i, j)));
        let outer = edges.into_iter().flat_map(|(a, b)| (1..n).map(move |i| between(a, b, i, n)));
        over.farthest_of(&inner.chain(outer).collect::<Vec<Vec3>>(), &mut bridges, limit)
    }
}

/// One of this many points is examined first.
const STRIDE: usize = 6;
/// Most faces of [`Bridges`].
const MAX_BRIDGES: usize = 8;

/// Coarse faces that share a vertex with each of the three faces nearest to an input face's corners. A walk from any
/// of these visits the bridges first, so a point near a bridge is near enough. Enumerated lazily, since the first
/// ones often suffice.
struct Bridges<'a> {
    live: &'a Live<'a>,
    near: [u32; 3],
    /// Remaining corners around the current vertex of the first face.
    corners: std::slice::Iter<'a, u32>,
    vertices: std::array::IntoIter<u32, 3>,
    faces: [u32; MAX_BRIDGES],
    triangles: [[Vec3; 3]; MAX_BRIDGES],
    count: usize,
}

impl<'a> Bridges<'a> {
    fn new(live: &'a Live<'a>, near: [u32; 3]) -> Self {
        Self {
            live,
            near,
            corners: [].iter(),
            vertices: live.face_vertices[near[0] as usize].into_iter(),
            faces: [0; MAX_BRIDGES],
            triangles: [[[0.0; 3]; 3]; MAX_BRIDGES],
            count: 0,
        }
    }

    /// Finds the next bridge.
    fn next(&mut self) -> Option<[Vec3; 3]> {
        let live = self.live;
        let others = [1, 2].map(|k| live.face_vertices[self.near[k] as usize]);
        while self.count < MAX_BRIDGES {
            let Some(&corner) = self.corners.next() else {
                self.corners = live.stars.row(self.vertices.next()?).iter();
                continue;
            };
            let face = face_of(corner);
            let own = live.face_vertices[face as usize];
            if others.iter().all(|other| own.iter().any(|v| other.contains(v)))
                && !self.near.contains(&face)
                && !self.faces[..self.count].contains(&face)
            {
                self.faces[self.count] = face;
                self.triangles[self.count] = live.triangle(face as usize);
                self.count += 1;
                return Some(self.triangles[self.count - 1]);
            }
        }
        None
    }

    /// The bridges found so far.
    fn found(&self) -> &[[Vec3; 3]] {
        &self.triangles[..self.count]
    }
}

/// An input face with the coarse faces nearest to its corners.
struct InputFace<'a> {
    region: &'a Surroundings<'a>,
    near: [u32; 3],
    /// The corners of these.
    triangles: [[Vec3; 3]; 3],
    /// Points farther than this from the surrounding faces are compared with the nearest coarse face of all.
    nearest_beyond: f64,
}

impl InputFace<'_> {
    /// The distance of a point if it exceeds `enough`; the nearest face may lie in another region. The corners' faces
    /// are tested in the given order.
    fn farther(&self, point: Vec3, order: [usize; 3], enough: f64) -> Option<f64> {
        let mut distances = [0.0; 3];
        for k in order {
            distances[k] = distance_to(point, self.triangles[k]);
            if distances[k] <= enough {
                return None;
            }
        }
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

    /// The distance of the farthest point if it exceeds `most`, else `most`; independent of the order of the points.
    fn farthest_of(&self, points: &[Vec3], bridges: &mut Bridges<'_>, mut most: f64) -> f64 {
        while bridges.next().is_some() {}
        // Some far points first, so the others can be skipped.
        let some = points.chunks(STRIDE).map(|few| few[0]).collect::<Vec<Vec3>>();
        for four in some.chunks(4).chain(points.chunks(4)) {
            let at = [0, 1, 2, 3].map(|i| four[i.min(four.len() - 1)]);
            let together = FourPoints::new(at);
            let mut left = (1_u32 << four.len()) - 1;
            for &triangle in self.triangles.iter().chain(bridges.found()) {
                if left != 0 {
                    left &= !together.within(triangle, most);
                }
            }
            for (_, &point) in four.iter().enumerate().filter(|(i, _)| left >> i & 1 == 1) {
                most = self.farther(point, [0, 1, 2], most).unwrap_or(most);
            }
        }
        most
    }
}

#[cfg(test)]
mod tests {
    use crate::common;
    use crate::mesh::{Corner, SourceMesh};
    use crate::pool::{MonitoredPool, Serial, Silent};
    use crate::simplify::deviation::Deviation;
    use crate::simplify::live::Live;
    use crate::simplify::surroundings::Surroundings;

    /// While only the region around its second corner is missing, the error at its centre belongs to that region.
    #[test]
    fn an_input_face_over_two_regions_counts_in_both() {
        // A long triangle, and a small one at either end; only the small ones remain, and they do not meet.
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
        let live = Live::new(&mesh, crate::entropy::Codec::Range);
        let mut deviation = Deviation::new(&live, &MonitoredPool::new(&Serial, &Silent, 0)).unwrap();
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
