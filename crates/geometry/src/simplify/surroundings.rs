//! Nearest-face queries on a region during its collapses.

use std::cell::OnceCell;

use glam::DVec3;

use crate::mesh::distance::{TriangleBvh, box_is_beyond, closest_point_on_triangle};
use crate::mesh::vec3::Vec3;
use crate::simplify::live::Live;

/// Factor that covers rounding of distances.
pub(crate) const ROUNDING: f64 = 1.0 + 1e-6;

/// A region during its collapses.
pub(crate) struct Surroundings<'a> {
    pub(crate) live: &'a Live<'a>,
    /// The region's faces at the level's start, ascending.
    pub(crate) faces: &'a [u32],
    /// Whether a face is in the region.
    pub(crate) inside: &'a dyn Fn(u32) -> bool,
    /// A hierarchy over the region's remaining faces; built on first use.
    nearest: OnceCell<(TriangleBvh, Vec<u32>)>,
}

impl<'a> Surroundings<'a> {
    pub(crate) fn new(live: &'a Live<'a>, faces: &'a [u32], inside: &'a dyn Fn(u32) -> bool) -> Self {
        Self { live, faces, inside, nearest: OnceCell::new() }
    }

    /// The nearest remaining face with its distance, which is at most about `bound`.
    pub(crate) fn nearest(&self, point: Vec3, bound: f64) -> Option<(f64, u32)> {
        let (bvh, left) = self.left();
        let found = bvh.nearest(point, bound * ROUNDING).or_else(|| bvh.nearest(point, f64::INFINITY));
        found.map(|(distance, face)| (distance, left[face as usize]))
    }

    /// The distance of the nearest remaining face, or `bound` if none is nearer.
    pub(crate) fn nearer(&self, point: Vec3, bound: f64) -> f64 {
        self.left().0.nearest(point, bound).map_or(bound, |(distance, _)| distance)
    }

    /// The remaining faces.
    fn left(&self) -> &(TriangleBvh, Vec<u32>) {
        self.nearest.get_or_init(|| {
            let live = self.live;
            let left: Vec<u32> = self.faces.iter().copied().filter(|&f| live.alive[f as usize]).collect();
            let triangles: Vec<[u32; 3]> = left.iter().map(|&f| live.face_vertices[f as usize]).collect();
            let (positions, triangles) = compact(&live.positions, &triangles);
            (TriangleBvh::new(&positions, &triangles), left)
        })
    }

    /// The nearest successor of `face` for a point that was at it: the face itself, or a face around the vertices
    /// that its corners were collapsed to; the first within `enough`. Infinitely far if the region has none.
    pub(crate) fn successor(&self, face: u32, point: Vec3, enough: f64) -> (f64, u32) {
        let live = self.live;
        if live.alive[face as usize] {
            return (distance_to(point, live.triangle(face as usize)), face);
        }
        let mut best = (f64::INFINITY, face);
        for vertex in live.face_vertices[face as usize] {
            let successor = live.successor(vertex);
            for other in live.stars.corners(successor).map(|c| c / 3).filter(|&f| (self.inside)(f)) {
                let distance = distance_to(point, live.triangle(other as usize));
                if distance < best.0 {
                    best = (distance, other);
                    if distance <= enough {
                        return best;
                    }
                }
            }
            if best.0.is_finite() {
                break;
            }
        }
        best
    }

    /// Walks from a face to ever nearer adjacent ones, until one is within `enough` or none is nearer.
    pub(crate) fn walk(&self, point: Vec3, best: (f64, u32), enough: f64) -> (f64, u32) {
        self.walk_over(self.inside, point, best, enough)
    }

    /// The walk over the faces that satisfy `over`.
    pub(crate) fn walk_over(
        &self,
        over: &dyn Fn(u32) -> bool,
        point: Vec3,
        mut best: (f64, u32),
        enough: f64,
    ) -> (f64, u32) {
        let live = self.live;
        loop {
            let from = best.1;
            for vertex in live.face_vertices[from as usize] {
                for other in live.stars.corners(vertex).map(|c| c / 3) {
                    if other != from && over(other) {
                        let triangle = live.triangle(other as usize);
                        if box_is_beyond(DVec3::from(point), triangle.map(DVec3::from), best.0 * best.0) {
                            continue;
                        }
                        let distance = distance_to(point, triangle);
                        if distance < best.0 {
                            best = (distance, other);
                            if distance <= enough {
                                return best;
                            }
                        }
                    }
                }
            }
            if best.1 == from {
                return best;
            }
        }
    }
}

/// Distance of a point from a triangle.
pub(crate) fn distance_to(point: Vec3, triangle: [Vec3; 3]) -> f64 {
    let p = DVec3::from(point);
    closest_point_on_triangle(p, triangle.map(DVec3::from)).distance(p)
}

/// The positions that triangles use, with the triangles renumbered.
pub(crate) fn compact(positions: &[Vec3], triangles: &[[u32; 3]]) -> (Vec<Vec3>, Vec<[u32; 3]>) {
    let mut used: Vec<u32> = triangles.iter().flatten().copied().collect();
    used.sort_unstable();
    used.dedup();
    let renumber = |v: u32| used.binary_search(&v).map_or(0, |i| i as u32);
    (
        used.iter().map(|&v| positions[v as usize]).collect(),
        triangles.iter().map(|t| t.map(renumber)).collect(),
    )
}
