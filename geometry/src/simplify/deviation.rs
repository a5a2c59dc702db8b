//! Geometric error: how far a simplified region is from the input, both ways.
//!
//! Input to coarse: every sample of the input keeps the face of the simplified mesh that it was found
//! nearest to; when that face changes, the nearest is looked for again among the faces that cover
//! the same region, so the distance can only be overestimated. Coarse to input: points are laid over
//! every face that moved, about as dense as the input's faces, and looked up in a hierarchy over the
//! input. The result is raised by [`MARGIN`] for what lies between the samples.

use glam::DVec3;

use crate::distance::{TriangleBvh, closest_point_on_triangle};
use crate::simplify::live::Live;
use crate::vec3::{Vec3, add, length, scale, sub, triangle_normal};

/// Safety factor for the surface between samples.
pub(crate) const MARGIN: f64 = 1.06;
/// Share of the error known so far beyond which a face is looked at closely.
const SUSPICIOUS: f64 = 0.6;
/// Points per input edge length on such a face, and the bounds of its subdivision.
const DENSITY: f64 = 2.0;
const LEAST_SUBDIVISION: usize = 6;
const MOST_SUBDIVISION: usize = 32;

/// The input surface, its samples, and where the samples are now.
pub(crate) struct Deviation {
    input: TriangleBvh,
    samples: Vec<Vec3>,
    /// Live face that each sample was last found nearest to.
    pub(crate) attached: Vec<u32>,
    distance: Vec<f32>,
    /// Mean area of the input's faces.
    mean_area: f64,
}

/// What measuring one region gave.
pub(crate) struct Measured {
    /// Largest distance, in grid cells, margin included.
    pub(crate) error: f64,
    /// New place of each sample that moved: (sample, face, distance).
    pub(crate) moved: Vec<(u32, u32, f32)>,
}

impl Deviation {
    pub(crate) fn new(live: &Live) -> Self {
        let input = TriangleBvh::new(&live.positions, &live.face_vertices);
        let faces = live.face_vertices.len();
        let mut attached = vec![0_u32; live.positions.len()];
        let mut area = 0.0;
        for face in 0..faces {
            let [a, b, c] = live.triangle(face);
            area += 0.5 * length(triangle_normal(a, b, c));
            for v in live.face_vertices[face] {
                attached[v as usize] = face as u32;
            }
        }
        let mut samples = live.positions.clone();
        for face in 0..faces {
            samples.push(live.centroid(face));
            attached.push(face as u32);
        }
        Self {
            input,
            distance: vec![0.0; samples.len()],
            samples,
            attached,
            mean_area: area / faces.max(1) as f64,
        }
    }

    /// The samples of each region, by the region of the face that they are attached to.
    pub(crate) fn by_region(&self, region_of_face: &[u32], regions: usize) -> Vec<Vec<u32>> {
        let mut lists = vec![Vec::new(); regions];
        for (sample, &face) in self.attached.iter().enumerate() {
            let region = region_of_face[face as usize];
            if let Some(list) = lists.get_mut(region as usize) {
                list.push(sample as u32);
            }
        }
        lists
    }

    /// Measures a region whose live faces are `faces`, of which `touched` changed in this level.
    pub(crate) fn measure(
        &self,
        live: &Live,
        faces: &[u32],
        touched: &dyn Fn(u32) -> bool,
        inside: &dyn Fn(u32) -> bool,
        samples: &[u32],
    ) -> Measured {
        let triangles: Vec<[u32; 3]> = faces.iter().map(|&f| live.face_vertices[f as usize]).collect();
        let (positions, triangles) = compact(&live.positions, &triangles);
        let coarse = TriangleBvh::new(&positions, &triangles);
        let mut error = 0.0_f64;
        let mut moved = Vec::new();
        for &sample in samples {
            let face = self.attached[sample as usize];
            if live.alive[face as usize] && !touched(face) {
                error = error.max(f64::from(self.distance[sample as usize]));
                continue;
            }
            let point = self.samples[sample as usize];
            // What became of the face that the sample was at bounds the search, or makes it needless,
            // since only the largest distance counts.
            let (bound, near) = heir(live, face, point, inside);
            let bound = bound * (1.0 + 1e-9);
            if bound <= error {
                moved.push((sample, near, bound as f32));
                continue;
            }
            if let Some((distance, nearest)) =
                coarse.nearest(point, bound).or_else(|| coarse.nearest(point, f64::INFINITY))
            {
                error = error.max(distance);
                moved.push((sample, faces[nearest as usize], distance as f32));
            }
        }
        // First a few points of each face that moved; then, where one is farther than half of what is
        // known, a dense lattice.
        for &face in faces.iter().filter(|&&f| touched(f)) {
            let triangle = live.triangle(face as usize);
            let [a, b, c] = triangle;
            let middle = scale(add(add(a, b), c), 1.0 / 3.0);
            if self.input.any_within(middle, SUSPICIOUS * error)
                && over_face(triangle, 2, &mut |p| self.input.any_within(p, SUSPICIOUS * error))
            {
                continue;
            }
            over_face(triangle, self.subdivision(triangle), &mut |point| {
                if !self.input.any_within(point, error)
                    && let Some((distance, _)) = self.input.nearest(point, f64::INFINITY)
                {
                    error = error.max(distance);
                }
                true
            });
        }
        Measured { error: error * MARGIN, moved }
    }

    /// Whether the given triangles are within `limit` of the input's samples, and the input of them,
    /// judged by about `budget` of the samples and the middles of the triangles.
    pub(crate) fn within(
        &self,
        positions: &[Vec3],
        triangles: &[[u32; 3]],
        samples: &[u32],
        limit: f64,
        budget: usize,
    ) -> bool {
        let limit = limit / MARGIN;
        let (positions, triangles) = compact(positions, triangles);
        let coarse = TriangleBvh::new(&positions, &triangles);
        let step = (samples.len() / budget.max(1)).max(1);
        samples.iter().step_by(step).all(|&s| coarse.any_within(self.samples[s as usize], limit))
            && triangles.iter().all(|t| {
                let [a, b, c] = t.map(|v| positions[v as usize]);
                self.input.any_within(scale(add(add(a, b), c), 1.0 / 3.0), limit)
            })
    }

    /// Whether a point is within `limit` of the input, margin included.
    pub(crate) fn input_within(&self, point: Vec3, limit: f64) -> bool {
        self.input.any_within(point, limit / MARGIN)
    }

    /// The face that a sample was last found near.
    pub(crate) fn face_near(&self, sample: u32) -> u32 {
        self.attached[sample as usize]
    }

    /// Takes over the new places of samples.
    pub(crate) fn attach(&mut self, moved: &[(u32, u32, f32)]) {
        for &(sample, face, distance) in moved {
            self.attached[sample as usize] = face;
            self.distance[sample as usize] = distance;
        }
    }

    /// Attaches samples whose region has lost all its faces to the nearest face anywhere.
    pub(crate) fn attach_anywhere(&mut self, live: &Live, samples: &[u32]) -> f64 {
        let faces: Vec<u32> = (0..live.alive.len() as u32).filter(|&f| live.alive[f as usize]).collect();
        let measured = self.measure(live, &faces, &|_| true, &|_| true, samples);
        self.attach(&measured.moved);
        measured.moved.iter().map(|m| f64::from(m.2)).fold(0.0, f64::max) * MARGIN
    }

    /// The box of some samples: (least, greatest) coordinates.
    pub(crate) fn bounds(&self, samples: &[u32], bounds: &mut [Vec3; 2]) {
        for &s in samples {
            extend(bounds, self.samples[s as usize]);
        }
    }

    pub(crate) fn farthest(&self, samples: &[u32], center: Vec3) -> f64 {
        samples.iter().map(|&s| length(sub(self.samples[s as usize], center))).fold(0.0, f64::max)
    }

    /// Subdivision of a face's edges that lays about as many points as input faces over it, times
    /// [`DENSITY`] squared.
    fn subdivision(&self, [a, b, c]: [Vec3; 3]) -> usize {
        let area = 0.5 * length(triangle_normal(a, b, c));
        let faces = if self.mean_area > 0.0 { area / self.mean_area } else { 1.0 };
        ((DENSITY * faces.sqrt()).ceil() as usize).clamp(LEAST_SUBDIVISION, MOST_SUBDIVISION)
    }
}

/// Calls `visit` for a lattice of points inside and on the edges of a triangle, until it answers
/// false; answers whether it never did. The corners are left out: they are vertices of the input.
fn over_face([a, b, c]: [Vec3; 3], n: usize, visit: &mut dyn FnMut(Vec3) -> bool) -> bool {
    let inverse = 1.0 / n as f64;
    for i in 0..n {
        for j in 0..=n - i {
            if i == 0 && (j == 0 || j == n) {
                continue;
            }
            let (u, v) = (i as f64 * inverse, j as f64 * inverse);
            let point = add(add(scale(a, u), scale(b, v)), scale(c, 1.0 - u - v));
            if !visit(point) {
                return false;
            }
        }
    }
    true
}

/// Longest chain of collapses that is followed to find what became of a vertex.
const MOST_HOPS: usize = 10_000;

/// The nearest face at hand to a point that was at `face`: the face itself, or one around the vertices
/// that its corners were collapsed to; infinitely far where there is none inside the region.
fn heir(live: &Live, face: u32, point: Vec3, inside: &dyn Fn(u32) -> bool) -> (f64, u32) {
    if live.alive[face as usize] {
        return (distance_to(point, live.triangle(face as usize)), face);
    }
    let mut best = (f64::INFINITY, face);
    for mut vertex in live.face_vertices[face as usize] {
        // Bounded: outlines unlocked on purpose can make two vertices each other's heirs.
        for _ in 0..MOST_HOPS {
            let next = live.moved_to[vertex as usize];
            if next == vertex {
                break;
            }
            vertex = next;
        }
        for other in live.stars.corners(vertex).map(|c| c / 3).filter(|&f| inside(f)) {
            let distance = distance_to(point, live.triangle(other as usize));
            if distance < best.0 {
                best = (distance, other);
            }
        }
        if best.0.is_finite() {
            break;
        }
    }
    best
}

/// Distance of a point from a triangle.
fn distance_to(point: Vec3, triangle: [Vec3; 3]) -> f64 {
    let p = DVec3::from(point);
    closest_point_on_triangle(p, triangle.map(DVec3::from)).distance(p)
}

/// Extends a box by a point.
pub(crate) fn extend(bounds: &mut [Vec3; 2], p: Vec3) {
    for axis in 0..3 {
        bounds[0][axis] = bounds[0][axis].min(p[axis]);
        bounds[1][axis] = bounds[1][axis].max(p[axis]);
    }
}

/// The positions that triangles use, and the triangles renumbered.
fn compact(positions: &[Vec3], triangles: &[[u32; 3]]) -> (Vec<Vec3>, Vec<[u32; 3]>) {
    let mut used: Vec<u32> = triangles.iter().flatten().copied().collect();
    used.sort_unstable();
    used.dedup();
    let renumber = |v: u32| used.binary_search(&v).map_or(0, |i| i as u32);
    (
        used.iter().map(|&v| positions[v as usize]).collect(),
        triangles.iter().map(|t| t.map(renumber)).collect(),
    )
}
