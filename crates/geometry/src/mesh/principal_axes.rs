//! Principal axes of a set of points.

use crate::mesh::vec3::{Vec3, add, scale, sub};

/// Sweeps over the three coordinate planes; half as many diagonalise a symmetric matrix to rounding.
const SWEEPS: usize = 12;
/// Off-diagonal entries below this share of the diagonal are treated as zero.
const NEGLIGIBLE: f64 = 1e-12;

/// Orthonormal eigenvectors of the points' covariance, in no order, by Jacobi rotations (Golub and Van Loan, "Matrix
/// Computations", 4th ed., §8.5). For equal eigenvalues any basis is returned.
pub(crate) fn principal_axes(points: impl Iterator<Item = Vec3> + Clone) -> [Vec3; 3] {
    let mut covariance = covariance(points);
    // Rows are the axes.
    let mut axes = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    for _ in 0..SWEEPS {
        for (p, q) in [(0, 1), (0, 2), (1, 2)] {
            let least = NEGLIGIBLE * (covariance[p][p] + covariance[q][q]);
            if covariance[p][q].abs() > least {
                rotate(&mut covariance, &mut axes, p, q);
            }
        }
    }
    axes
}

fn covariance(points: impl Iterator<Item = Vec3> + Clone) -> [Vec3; 3] {
    let share = 1.0 / points.clone().count().max(1) as f64;
    let middle = points.clone().fold([0.0; 3], |sum, p| add(sum, scale(p, share)));
    points.fold([[0.0; 3]; 3], |sum, point| {
        let off = sub(point, middle);
        [0, 1, 2].map(|row| add(sum[row], scale(off, off[row] * share)))
    })
}

/// Rotates the plane of two axes so that `matrix` becomes diagonal there.
fn rotate(matrix: &mut [Vec3; 3], axes: &mut [Vec3; 3], p: usize, q: usize) {
    let theta = (matrix[q][q] - matrix[p][p]) / (2.0 * matrix[p][q]);
    let tangent = theta.signum() / (theta.abs() + (theta * theta + 1.0).sqrt());
    let cosine = 1.0 / (tangent * tangent + 1.0).sqrt();
    let sine = tangent * cosine;
    for row in matrix.iter_mut() {
        let (a, b) = (row[p], row[q]);
        (row[p], row[q]) = (cosine * a - sine * b, sine * a + cosine * b);
    }
    for rows in [matrix, axes] {
        let (a, b) = (rows[p], rows[q]);
        rows[p] = sub(scale(a, cosine), scale(b, sine));
        rows[q] = add(scale(a, sine), scale(b, cosine));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::vec3::{dot, length};

    #[test]
    fn the_corners_of_a_turned_box_lie_along_its_sides() {
        let sides = [[0.36, 0.48, -0.8], [-0.8, 0.6, 0.0], [0.48, 0.64, 0.6]];
        let corners = (0..8).map(|corner: u32| {
            (0..3).fold([300.0, -20.0, 7.0], |at, k| {
                let sign = if corner >> k & 1 == 1 { 1.0 } else { -1.0 };
                add(at, scale(sides[k], sign * [5.0, 1.0, 0.2][k]))
            })
        });
        let axes = principal_axes(corners);
        for (k, axis) in axes.iter().enumerate() {
            assert!((length(*axis) - 1.0).abs() < 1e-9, "{axes:?}");
            assert!(dot(*axis, axes[(k + 1) % 3]).abs() < 1e-9, "{axes:?}");
            assert!(sides.iter().any(|side| dot(*side, *axis).abs() > 1.0 - 1e-9), "{axes:?}");
        }
    }

    #[test]
    fn points_without_extent_have_axes_too() {
        for points in [vec![], vec![[3.0, 4.0, 5.0]], vec![[1.0; 3]; 4]] {
            let axes = principal_axes(points.into_iter());
            assert!(axes.iter().all(|axis| (length(*axis) - 1.0).abs() < 1e-9), "{axes:?}");
        }
    }
}
