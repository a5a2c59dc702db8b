//! Rays against a refined mesh, and where its parts are.

use crate::mesh::skin::Skin;
use crate::mesh::vec3::{Vec3, cross, dot, sub};
use crate::refine::active::ActiveMesh;

/// Where a ray meets a face.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FaceHit {
    /// Distance from the ray's origin, in lengths of its direction.
    pub distance: f64,
    /// Part of the face.
    pub part: u32,
}

impl ActiveMesh {
    /// The nearest face that a ray meets from either side, no farther than `farthest` lengths of its direction. Origin
    /// and direction are in the asset's units, relative to [`crate::mesh::Grid::origin`]. Parts that `skip` names are
    /// left out; of equally near parts the lowest counts. Morphs and transparency are ignored. Cost: a pass over the
    /// faces.
    pub fn cast_ray(
        &self,
        origin: [f64; 3],
        direction: [f64; 3],
        farthest: f64,
        skip: impl FnMut(u32) -> bool,
    ) -> Option<FaceHit> {
        self.cast_ray_of_each(|_| [origin, direction], farthest, skip)
    }

    /// As [`Self::cast_ray`], with an origin and a direction for each part: those that are seen from a part that was
    /// moved. Distances are in lengths of the directions, so these must be turned and scaled with their parts.
    pub fn cast_ray_of_each(
        &self,
        mut ray: impl FnMut(u32) -> [[f64; 3]; 2],
        farthest: f64,
        skip: impl FnMut(u32) -> bool,
    ) -> Option<FaceHit> {
        let meets = |(part, corners): (u32, [Vec3; 3])| {
            let [origin, direction] = ray(part);
            Some((part, meeting(origin, direction, corners)?))
        };
        nearest(self.drawn_faces(|_, place| place).filter_map(meets), farthest, skip)
    }

    /// As [`Self::cast_ray`], with each vertex where `moved` takes it by its skin, from a place relative to
    /// [`crate::mesh::Grid::origin`] to another.
    pub fn cast_ray_posed(
        &self,
        [origin, direction]: [[f64; 3]; 2],
        farthest: f64,
        skip: impl FnMut(u32) -> bool,
        moved: impl Fn(Skin, [f64; 3]) -> [f64; 3],
    ) -> Option<FaceHit> {
        let faces = self.drawn_faces(|vertex, place| moved(self.skin(vertex).unwrap_or_default(), place));
        let met = faces.filter_map(|(part, corners)| Some((part, meeting(origin, direction, corners)?)));
        nearest(met, farthest, skip)
    }

    /// Corners of the faces of a part where `moved` takes them, as in [`Self::cast_ray_posed`]; none for a part without
    /// faces at this refinement. Cost: a pass over all faces.
    pub fn part_corners<'a>(
        &'a self,
        part: u32,
        moved: impl Fn(Skin, [f64; 3]) -> [f64; 3] + 'a,
    ) -> impl Iterator<Item = [f64; 3]> + 'a {
        let moved = move |vertex, place| moved(self.skin(vertex).unwrap_or_default(), place);
        self.drawn_faces(moved).filter(move |(own, _)| *own == part).flat_map(|(_, corners)| corners)
    }

    /// Part and corners of each face, each where `moved` takes the vertex.
    fn drawn_faces<'a>(
        &'a self,
        moved: impl Fn(u32, Vec3) -> Vec3 + 'a,
    ) -> impl Iterator<Item = (u32, [Vec3; 3])> + 'a {
        let step = self.grid.step;
        let used = self.indices.iter().flatten().filter(|face| **face != [0; 3]);
        used.map(move |face| {
            let vertices = face.map(|wedge| self.wedges[wedge as usize].vertex);
            let at =
                |vertex: u32| moved(vertex, self.positions[vertex as usize].map(|q| f64::from(q) * step));
            (self.part(vertices[0]), vertices.map(at))
        })
    }
}

/// The nearest of some faces' parts with their distances; of equally near parts the lowest.
fn nearest(
    met: impl Iterator<Item = (u32, f64)>,
    farthest: f64,
    mut skip: impl FnMut(u32) -> bool,
) -> Option<FaceHit> {
    let mut nearest: Option<FaceHit> = None;
    for (part, distance) in met {
        let most = nearest.map_or(farthest, |hit| hit.distance);
        let nearer = nearest.is_none_or(|hit| distance < hit.distance || part < hit.part);
        if distance <= most && nearer && !skip(part) {
            nearest = Some(FaceHit { distance, part });
        }
    }
    nearest
}

/// Distance at which a ray meets a triangle, in lengths of its direction (Möller and Trumbore, "Fast, Minimum Storage
/// Ray/Triangle Intersection", 1997). Rays along the triangle's plane meet nothing.
fn meeting(origin: Vec3, direction: Vec3, [a, b, c]: [Vec3; 3]) -> Option<f64> {
    let (ab, ac) = (sub(b, a), sub(c, a));
    let across = cross(direction, ac);
    let det = dot(ab, across);
    if det == 0.0 {
        return None;
    }
    let from_a = sub(origin, a);
    let u = dot(from_a, across) / det;
    let up = cross(from_a, ab);
    let v = dot(direction, up) / det;
    let distance = dot(ac, up) / det;
    // Comparisons with NaN are false.
    (u >= 0.0 && v >= 0.0 && u + v <= 1.0 && distance >= 0.0 && distance.is_finite()).then_some(distance)
}

#[cfg(test)]
mod tests {
    use super::*;

    const TRIANGLE: [Vec3; 3] = [[0.0, 0.0, -2.0], [1.0, 0.0, -2.0], [0.0, 1.0, -2.0]];

    #[test]
    fn a_ray_meets_a_triangle_from_both_sides_and_nothing_behind_it() {
        let at = |x, y, z, dz| meeting([x, y, z], [0.0, 0.0, dz], TRIANGLE);
        assert_eq!(at(0.25, 0.25, 0.0, -0.5), Some(4.0));
        assert_eq!(at(0.25, 0.25, -3.0, 1.0), Some(1.0));
        assert_eq!(at(0.25, 0.25, -3.0, -1.0), None);
        assert_eq!(at(0.6, 0.6, 0.0, -1.0), None);
        assert_eq!(at(-0.1, 0.2, 0.0, -1.0), None);
        // Edges and corners belong to it.
        assert_eq!(at(0.0, 0.0, 0.0, -1.0), Some(2.0));
        assert_eq!(at(0.5, 0.5, 0.0, -1.0), Some(2.0));
    }

    #[test]
    fn degenerate_rays_and_triangles_meet_nothing() {
        assert_eq!(meeting([0.1, 0.1, 0.0], [0.0; 3], TRIANGLE), None);
        assert_eq!(meeting([0.1, 0.1, 0.0], [f64::NAN, 0.0, -1.0], TRIANGLE), None);
        assert_eq!(meeting([0.1, 0.1, -2.0], [1.0, 0.0, 0.0], TRIANGLE), None);
        assert_eq!(meeting([0.0; 3], [0.0, 0.0, -1.0], [[0.0, 0.0, -1.0]; 3]), None);
    }
}
