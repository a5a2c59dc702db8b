//! The similarity (rotation, uniform scale, translation, perhaps a mirror) that maps one list of points to another best,
//! point by point.
//!
//! Rotation: Horn, "Closed-form solution of absolute orientation using unit quaternions", 1987: the eigenvector of the
//! largest eigenvalue of a symmetric 4×4 matrix, here by cyclic Jacobi rotations. Scale: the symmetric one of the same
//! paper (§2.D), the ratio of the root mean squares about the centroids, which needs no rotation.

use glam::{DMat3, DMat4, DQuat, DVec3};

/// Most sweeps of Jacobi rotations; they converge quadratically, so that five are usual.
const MAX_SWEEPS: usize = 24;

/// The map from `from` to `to` with the least sum of squared distances: a mirror image if `mirrored`, which then is a
/// rotation of the points' negatives. `None` for lists of different or no length, points that all coincide, and numbers
/// that are not finite. Cost: linear.
pub(super) fn fit(from: &[[f64; 3]], to: &[[f64; 3]], mirrored: bool) -> Option<DMat4> {
    if from.len() != to.len() || from.is_empty() {
        return None;
    }
    let (from_centre, to_centre) = (centroid(from), centroid(to));
    let sign = if mirrored { -1.0 } else { 1.0 };
    // Sums of products of coordinates: row of `from`, column of `to`.
    let mut products = [[0.0; 3]; 3];
    let (mut from_square, mut to_square) = (0.0, 0.0);
    for (&a, &b) in from.iter().zip(to) {
        let a = (DVec3::from(a) - from_centre) * sign;
        let b = DVec3::from(b) - to_centre;
        from_square += a.length_squared();
        to_square += b.length_squared();
        for (row, a) in products.iter_mut().zip(a.to_array()) {
            row.iter_mut().zip(b.to_array()).for_each(|(sum, b)| *sum += a * b);
        }
    }
    let scale = (to_square / from_square).sqrt();
    if !(scale.is_finite() && scale > 0.0) {
        return None;
    }
    let rotation = rotation(&products)?;
    let linear = DMat3::from_quat(rotation) * (scale * sign);
    let map = DMat4::from_mat3_translation(linear, to_centre - linear * from_centre);
    map.is_finite().then_some(map)
}

/// The mean of some points.
pub(super) fn centroid(points: &[[f64; 3]]) -> DVec3 {
    // About the first, which keeps the digits of points far from the origin.
    let first = points.first().map_or(DVec3::ZERO, |&point| DVec3::from(point));
    let sum: DVec3 = points.iter().map(|&point| DVec3::from(point) - first).sum();
    first + sum / points.len().max(1) as f64
}

/// The largest distance of a mapped point from where it should be.
pub(super) fn largest_distance(map: &DMat4, from: &[[f64; 3]], to: &[[f64; 3]]) -> f64 {
    let distance =
        |(&a, &b): (&[f64; 3], &[f64; 3])| (map.transform_point3(DVec3::from(a)) - DVec3::from(b)).length();
    from.iter().zip(to).map(distance).fold(0.0, f64::max)
}

/// Horn 1987, §4.A: the rotation with the largest sum of products of rotated and given points.
fn rotation(products: &[[f64; 3]; 3]) -> Option<DQuat> {
    let [[xx, xy, xz], [yx, yy, yz], [zx, zy, zz]] = *products;
    let mut matrix = [
        [xx + yy + zz, yz - zy, zx - xz, xy - yx],
        [yz - zy, xx - yy - zz, xy + yx, zx + xz],
        [zx - xz, xy + yx, yy - xx - zz, yz + zy],
        [xy - yx, zx + xz, yz + zy, zz - xx - yy],
    ];
    let size = matrix.iter().flatten().fold(0.0, |most: f64, x| most.max(x.abs()));
    if !(size > 0.0 && size.is_finite()) {
        return None;
    }
    matrix.iter_mut().flatten().for_each(|x| *x /= size);
    let vectors = eigenvectors(&mut matrix);
    // The first of equal ones: any of them maps degenerate points equally well.
    let mut best = 0;
    for i in 1..4 {
        if matrix[i][i] > matrix[best][best] {
            best = i;
        }
    }
    let [w, x, y, z] = vectors.map(|row| row[best]);
    Some(DQuat::from_xyzw(x, y, z, w).normalize()).filter(|q| q.is_finite())
}

/// Diagonalises a symmetric matrix (Golub and Van Loan, "Matrix Computations", §8.5) and returns its eigenvectors as
/// columns; the diagonal then has the eigenvalues.
fn eigenvectors(matrix: &mut [[f64; 4]; 4]) -> [[f64; 4]; 4] {
    let mut vectors = [[0.0; 4]; 4];
    (0..4).for_each(|i| vectors[i][i] = 1.0);
    for _ in 0..MAX_SWEEPS {
        let off: f64 =
            (0..4).flat_map(|i| (0..i).map(move |j| (i, j))).map(|(i, j)| matrix[i][j].abs()).sum();
        if off < 1e-300 {
            break;
        }
        for p in 0..3 {
            for q in p + 1..4 {
                if matrix[p][q] == 0.0 {
                    continue;
                }
                let theta = (matrix[q][q] - matrix[p][p]) / (2.0 * matrix[p][q]);
                let tangent = theta.signum() / (theta.abs() + (theta * theta + 1.0).sqrt());
                let cosine = 1.0 / (tangent * tangent + 1.0).sqrt();
                let sine = tangent * cosine;
                let turn = |a: &mut f64, b: &mut f64| {
                    (*a, *b) = (cosine * *a - sine * *b, sine * *a + cosine * *b);
                };
                for row in matrix.iter_mut().chain(&mut vectors) {
                    let (left, right) = row.split_at_mut(q);
                    turn(&mut left[p], &mut right[0]);
                }
                let (above, below) = matrix.split_at_mut(q);
                above[p].iter_mut().zip(&mut below[0]).for_each(|(a, b)| turn(a, b));
            }
        }
    }
    vectors
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::meshopt::tests::Random;

    fn points(random: &mut Random, count: usize, flat: bool) -> Vec<[f64; 3]> {
        let mut number = || random.below(1 << 20) as f64 / 1e5;
        (0..count).map(|_| [number(), number(), if flat { 2.0 } else { number() }]).collect()
    }

    fn placed(points: &[[f64; 3]], map: &DMat4) -> Vec<[f64; 3]> {
        points.iter().map(|&point| map.transform_point3(DVec3::from(point)).to_array()).collect()
    }

    #[test]
    fn rotated_scaled_moved_and_mirrored_points_are_fitted() {
        let mut random = Random(7);
        for round in 0..200 {
            let some = points(&mut random, 3 + round % 40, round % 5 == 0);
            let mirror = if round % 2 == 1 { -1.0 } else { 1.0 };
            let turn = f64::from(round as u32) * 0.37;
            let rotation = DQuat::from_euler(glam::EulerRot::XYZ, turn, 1.7 * turn, -0.3 * turn);
            let scale = DVec3::new(mirror, 1.0, 1.0) * (0.01 + turn);
            let map =
                DMat4::from_scale_rotation_translation(scale, rotation, DVec3::new(4e5, -3.0, -4e6 + turn));
            let moved = placed(&some, &map);
            let found = fit(&some, &moved, mirror < 0.0).unwrap();
            let distance = largest_distance(&found, &some, &moved);
            assert!(distance < 1e-8 * (1.0 + 10.0 * turn), "{round}: {distance}");
            assert_eq!(found.determinant() < 0.0, mirror < 0.0);
        }
    }

    #[test]
    fn turns_by_half_and_the_identity_are_fitted() {
        let some = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 3.0]];
        for axis in [DVec3::X, DVec3::Y, DVec3::Z, DVec3::ONE.normalize()] {
            for turn in [0.0, 90.0_f64, 180.0] {
                let moved = placed(&some, &DMat4::from_axis_angle(axis, turn.to_radians()));
                let found = fit(&some, &moved, false).unwrap();
                assert!(largest_distance(&found, &some, &moved) < 1e-12, "{axis} {turn}");
            }
        }
    }

    #[test]
    fn other_shapes_are_far_from_their_fit_and_points_without_extent_have_none() {
        let some = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 3.0]];
        let other = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 3.1]];
        assert!(largest_distance(&fit(&some, &other, false).unwrap(), &some, &other) > 0.02);
        let mirror = some.map(|[x, y, z]| [-x, y, z]);
        assert!(largest_distance(&fit(&some, &mirror, false).unwrap(), &some, &mirror) > 0.5);
        assert_eq!(fit(&some, &[[1.0; 3]; 4], false), None);
        assert_eq!(fit(&[[1.0; 3]; 4], &some, false), None);
        assert_eq!(fit(&some, &some[..3], false), None);
        assert_eq!(fit(&[], &[], false), None);
        assert_eq!(fit(&some, &some.map(|_| [f64::NAN; 3]), false), None);
        // Points on a line: any turn about it will do.
        let line = [[0.0, 0.0, 0.0], [1.0, 1.0, 0.0], [3.0, 3.0, 0.0]];
        let turned = [[5.0, 0.0, 0.0], [5.0, 0.0, 2.0_f64.sqrt()], [5.0, 0.0, 18.0_f64.sqrt()]];
        assert!(largest_distance(&fit(&line, &turned, true).unwrap(), &line, &turned) < 1e-12);
    }
}
