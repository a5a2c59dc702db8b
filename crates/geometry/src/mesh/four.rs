//! Conservative proximity tests in single precision, of four points against a triangle or four triangles against a
//! point.
//!
//! Any point of the triangle gives an upper bound on the distance, however inexactly it was found; the rounding of
//! the bound itself is accounted for in the comparison. So a positive answer is certain; a negative one is not.

use glam::{DVec3, Vec4};

/// Relative error of a distance, as a share of the largest coordinate: 24 bits give 6e-8 per operation, and fewer
/// than forty operations lead to a distance.
const ROUNDING: f32 = 2.5e-6;
/// Relative error of a squared distance.
const SQUARE_ROUNDING: f32 = 1e-5;

/// Three coordinates of four points.
type Lanes = [Vec4; 3];

/// Four points, relative to a nearby origin.
pub(crate) struct FourPoints {
    origin: DVec3,
    at: Lanes,
    /// Largest coordinate.
    size: f32,
}

impl FourPoints {
    /// The first of the points is the origin.
    pub(crate) fn new(points: [[f64; 3]; 4]) -> Self {
        let origin = DVec3::from_array(points[0]);
        let [a, b, c, d] = points.map(|p| (DVec3::from_array(p) - origin).as_vec3());
        let size = a.abs().max(b.abs()).max(c.abs()).max(d.abs()).max_element();
        Self { origin, at: [0, 1, 2].map(|k| Vec4::new(a[k], b[k], c[k], d[k])), size }
    }

    /// Bit mask of the points that are certainly within `limit` of the triangle.
    pub(crate) fn within(&self, triangle: [[f64; 3]; 3], limit: f64) -> u32 {
        let [a, b, c] = triangle.map(|corner| (DVec3::from_array(corner) - self.origin).as_vec3());
        let size = a.abs().max(b.abs()).max(c.abs()).max_element().max(self.size);
        let (ab, ac) = (b - a, c - a);
        let all = |k: usize| (self.at[k] - a[k], Vec4::splat(ab[k]), Vec4::splat(ac[k]));
        let [x, y, z] = [all(0), all(1), all(2)];
        let squared = nearest_squared([x.0, y.0, z.0], [x.1, y.1, z.1], [x.2, y.2, z.2]);
        certainly_within(squared, limit as f32, Vec4::splat(size))
    }
}

/// A point, for triangles whose corners are exact in single precision.
pub(crate) struct PointOfFour {
    rounded: [f32; 3],
    rest: [f32; 3],
}

impl PointOfFour {
    pub(crate) fn new(point: [f64; 3]) -> Self {
        let rounded = point.map(|x| x as f32);
        Self { rounded, rest: [0, 1, 2].map(|k| (point[k] - f64::from(rounded[k])) as f32) }
    }

    /// Bit mask of the triangles that are certainly within `limit` of the point, and of those whose bounding box is
    /// within √`square`.
    pub(crate) fn within(&self, triangles: [[[f32; 3]; 3]; 4], limit: f64, square: f64) -> (u32, u32) {
        let corner = |i: usize| {
            [0, 1, 2].map(|k| {
                let [s, t, u, v] = triangles.map(|triangle| triangle[i][k]);
                Vec4::new(s, t, u, v) - self.rounded[k] - self.rest[k]
            })
        };
        let [a, b, c] = [corner(0), corner(1), corner(2)];
        let (mut size, mut beyond) = (Vec4::ZERO, Vec4::ZERO);
        for k in 0..3 {
            let (low, high) = (a[k].min(b[k]).min(c[k]), a[k].max(b[k]).max(c[k]));
            let outside = low.max(-high).max(Vec4::ZERO);
            beyond += outside * outside;
            size = size.max(high.max(-low));
        }
        let less = |p: &Lanes, q: &Lanes| [p[0] - q[0], p[1] - q[1], p[2] - q[2]];
        let near =
            certainly_within(nearest_squared(a.map(|x| -x), less(&b, &a), less(&c, &a)), limit as f32, size);
        // Coordinates and distances have relative errors.
        let square = (square as f32) * (1.0 + SQUARE_ROUNDING);
        (near, beyond.cmple(Vec4::splat(square)).bitmask())
    }
}

/// Bit mask of the squared distances that are certainly at most `limit`; `size` is the largest coordinate involved.
fn certainly_within(squared: Vec4, limit: f32, size: Vec4) -> u32 {
    let limit = limit - size * ROUNDING;
    // Comparisons with NaN are false.
    (limit.cmpgt(Vec4::ZERO) & squared.cmple(limit * limit * (1.0 - SQUARE_ROUNDING))).bitmask()
}

/// Squared distances between points and approximately nearest points of triangles, given the points relative to the
/// triangles' first corners, and the edge vectors from there.
fn nearest_squared(point: Lanes, ab: Lanes, ac: Lanes) -> Vec4 {
    let dot = |p: &Lanes, q: &Lanes| p[0] * q[0] + p[1] * q[1] + p[2] * q[2];
    let less = |p: &Lanes, q: &Lanes| [p[0] - q[0], p[1] - q[1], p[2] - q[2]];
    let (from_b, bc) = (less(&point, &ab), less(&ac, &ab));
    let (ab_ab, ac_ac, bc_bc, ab_ac) = (dot(&ab, &ab), dot(&ac, &ac), dot(&bc, &bc), dot(&ab, &ac));
    // A degenerate edge is represented by its first point, a triangle without area by its edges.
    let inverse = |x: Vec4| Vec4::ONE / x.max(Vec4::splat(f32::MIN_POSITIVE));
    let edge = |p: &Lanes, way: &Lanes, along: Vec4, square: Vec4| {
        let t = (along * inverse(square)).clamp(Vec4::ZERO, Vec4::ONE);
        let rest = [p[0] - t * way[0], p[1] - t * way[1], p[2] - t * way[2]];
        dot(&rest, &rest)
    };
    let (on_ab, on_ac) = (dot(&point, &ab), dot(&point, &ac));
    let edges = edge(&point, &ab, on_ab, ab_ab).min(edge(&point, &ac, on_ac, ac_ac)).min(edge(
        &from_b,
        &bc,
        dot(&from_b, &bc),
        bc_bc,
    ));
    let inverse = inverse(ab_ab * ac_ac - ab_ac * ab_ac);
    let v = (on_ab * ac_ac - on_ac * ab_ac) * inverse;
    let w = (on_ac * ab_ab - on_ab * ab_ac) * inverse;
    let inside = v.cmpge(Vec4::ZERO) & w.cmpge(Vec4::ZERO) & (v + w).cmple(Vec4::ONE);
    let rest = [0, 1, 2].map(|k| point[k] - v * ab[k] - w * ac[k]);
    Vec4::select(inside, dot(&rest, &rest).min(edges), edges)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::distance::closest_point_on_triangle;
    use proptest::prelude::*;

    /// Grid cells around the middle, few of them frequent, so corners coincide and triangles degenerate.
    fn cell() -> impl Strategy<Value = f64> {
        prop_oneof![
            (-4_i32..=4).prop_map(f64::from),
            (-2048_i32..2048).prop_map(f64::from),
            (-8_388_608_i32..=8_388_607).prop_map(f64::from)
        ]
    }

    fn point() -> impl Strategy<Value = [f64; 3]> {
        [cell(), cell(), cell()]
    }

    proptest! {
        #[test]
        fn positive_answers_are_correct(
            triangle in [point(), point(), point()],
            weights in [[-0.5..1.5_f64, -0.5..1.5], [0.0..1.0, 0.0..1.0], [-0.1..0.1, 0.0..1.0], [0.4..0.6, 0.4..0.6]],
            ways in [[-3.0..3.0_f64, -3.0..3.0, -3.0..3.0], [-0.1..0.1, -0.1..0.1, -0.1..0.1],
                [-99.0..99.0, -99.0..99.0, -99.0..99.0], [0.0..1e-6, 0.0..1e-6, 0.0..1e-6]],
            share in 0.5..2.0_f64,
        ) {
            let [a, b, c] = triangle.map(DVec3::from_array);
            let points = [0, 1, 2, 3].map(|i| {
                let [v, w] = weights[i];
                a + (b - a) * v + (c - a) * w + DVec3::from_array(ways[i])
            });
            let distance = |p: DVec3| p.distance(closest_point_on_triangle(p, [a, b, c]));
            let four = FourPoints::new(points.map(|p| p.to_array()));
            for limit in points.map(|p| distance(p) * share).into_iter().chain(points.map(distance)) {
                let near = four.within(triangle, limit);
                for (i, &p) in points.iter().enumerate() {
                    prop_assert!(near >> i & 1 == 0 || distance(p) <= limit, "{} > {limit}", distance(p));
                    let one = PointOfFour::new(p.to_array());
                    let corners = triangle.map(|corner| corner.map(|x| x as f32));
                    let triangles = [corners, [[0.0; 3]; 3], corners, corners];
                    let (near, open) = one.within(triangles, limit, limit * limit);
                    prop_assert!(open & 0b1101 == 0b1101 || distance(p) > limit, "{} < {limit}", distance(p));
                    prop_assert!(open & 0b0010 == 0b0010 || p.length() > limit, "{} < {limit}", p.length());
                    prop_assert!(near & 0b1101 == 0 || distance(p) <= limit, "{} > {limit}", distance(p));
                    prop_assert!(near & 0b0010 == 0 || p.length() <= limit, "{} > {limit}", p.length());
                }
            }
        }
    }

    #[test]
    fn clearly_near_points_are_found() {
        let triangle = [[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [0.0, 4.0, 0.0]];
        // In front of the face, an edge and a corner, and beyond the longest edge.
        let four = FourPoints::new([[1.0, 1.0, 0.9], [2.0, -0.9, 0.0], [-0.6, -0.6, 0.0], [3.0, 2.5, 0.0]]);
        assert_eq!(four.within(triangle, 1.0), 0b0111);
        assert_eq!(four.within(triangle, 1.1), 0b1111);
        assert_eq!(four.within(triangle, 0.0), 0);
        assert_eq!(four.within(triangle, f64::NAN), 0);
        let corners = triangle.map(|corner| corner.map(|x| x as f32));
        let away = corners.map(|[x, y, _]| [x, y, 2.0]);
        let point = PointOfFour::new([1.0, 1.0, 0.9]);
        let triangles = [corners, away, [[9.0; 3]; 3], [corners[0]; 3]];
        assert_eq!(point.within(triangles, 1.0, 1.0), (0b0001, 0b0001));
        assert_eq!(point.within(triangles, 2.0, 1.0), (0b1011, 0b0001));
        assert_eq!(point.within(triangles, 1.0, 2.0), (0b0001, 0b0011));
        assert_eq!(point.within(triangles, 1.0, f64::INFINITY), (0b0001, 0b1111));
        let four = FourPoints::new([[f64::NAN; 3]; 4]);
        assert_eq!(four.within(triangle, f64::INFINITY), 0);
    }
}
