//! Points distributed evenly over triangles, at least ten on each face of the input.

use glam::DVec3;
use lodestream_geometry::distance::TriangleBvh;

use crate::measure::Surface;

/// Subdivision of an input face's edges: 15 points per face, including corners and edges.
const SUBDIVISION: usize = 4;
/// Largest subdivision of a face.
const MOST_SUBDIVISION: usize = 100;

/// Calls `visit` for a lattice of points on a triangle, including corners and edges. Triangles larger than `area`, the
/// mean face of the input, get about 15 points per `area`.
pub(super) fn over(triangle: [DVec3; 3], area: f64, visit: &mut dyn FnMut(DVec3)) {
    let [a, b, c] = triangle;
    let own = 0.5 * (b - a).cross(c - a).length();
    let faces = if area > 0.0 { (own / area).sqrt().max(1.0) } else { 1.0 };
    let n = ((faces * SUBDIVISION as f64).ceil() as usize).clamp(SUBDIVISION, MOST_SUBDIVISION);
    let share = 1.0 / n as f64;
    for i in 0..=n {
        for j in 0..=n - i {
            let (u, v) = (i as f64 * share, j as f64 * share);
            visit(a * u + b * v + c * (1.0 - u - v));
        }
    }
}

/// A surface with its search structure.
pub(super) struct Target<'a> {
    surface: &'a Surface,
    bvh: TriangleBvh,
}

impl<'a> Target<'a> {
    pub(super) fn new(surface: &'a Surface) -> Self {
        Self { surface, bvh: TriangleBvh::new(&surface.positions, &surface.triangles) }
    }

    pub(super) fn triangle(&self, face: usize) -> [DVec3; 3] {
        self.surface.triangles[face].map(|v| DVec3::from_array(self.surface.positions[v as usize]))
    }

    /// Mean area of the faces.
    pub(super) fn mean_area(&self) -> f64 {
        let count = self.surface.triangles.len();
        let total: f64 = (0..count)
            .map(|face| {
                let [a, b, c] = self.triangle(face);
                0.5 * (b - a).cross(c - a).length()
            })
            .sum();
        total / count.max(1) as f64
    }

    /// Calls `visit` with every lattice point of a face, its distance to `other` and the nearest face of `other`.
    pub(super) fn distances(
        &self,
        face: usize,
        area: f64,
        other: &Target<'_>,
        visit: &mut dyn FnMut(DVec3, f64, u32),
    ) {
        let mut previous: Option<(DVec3, f64)> = None;
        over(self.triangle(face), area, &mut |point| {
            // The triangle inequality bounds the search; the slack covers rounding.
            let bound = previous.map_or(f64::INFINITY, |(p, d)| (d + p.distance(point)) * (1.0 + 1e-9));
            let query = point.to_array();
            let nearest = other.bvh.nearest(query, bound).or_else(|| other.bvh.nearest(query, f64::INFINITY));
            let (distance, nearest) = nearest.unwrap_or((f64::INFINITY, 0));
            previous = Some((point, distance));
            visit(point, distance, nearest);
        });
    }

    pub(super) fn faces(&self) -> usize {
        self.surface.triangles.len()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn large_faces_get_more_points() {
        let count = |size: f64| {
            let mut points = Vec::new();
            over([DVec3::ZERO, DVec3::X * size, DVec3::Y * size], 0.5, &mut |p| points.push(p));
            assert!(points.iter().all(|p| p.min_element() >= 0.0 && p.x + p.y <= size + 1e-12));
            points.len()
        };
        assert_eq!(count(0.01), 15);
        assert_eq!(count(1.0), 15);
        assert_eq!(count(3.0), 13 * 14 / 2);
    }

    #[test]
    fn distances_name_the_nearest_face() {
        let far = Surface {
            positions: vec![[0.0, 0.0, 2.0], [1.0, 0.0, 2.0], [0.0, 1.0, 2.0]],
            triangles: vec![[0, 1, 2]],
        };
        let mut two = far.clone();
        two.positions.extend(far.positions.iter().map(|p| [p[0], p[1], 1.0]));
        two.triangles.push([3, 4, 5]);
        let mut near = far.clone();
        near.positions.iter_mut().for_each(|p| p[2] = 0.0);
        let (near, two) = (Target::new(&near), Target::new(&two));
        let mut seen = 0;
        near.distances(0, near.mean_area(), &two, &mut |_, distance, face| {
            seen += 1;
            assert!((distance - 1.0).abs() < 1e-12);
            assert_eq!(face, 1);
        });
        assert_eq!(seen, 15);
    }
}
