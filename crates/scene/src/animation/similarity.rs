//! The nearest similarity of an affine map: translation, rotation and one scale.

use glam::{DAffine3, DMat3, DQuat};

use crate::parts::{PART_SCALES, PartTransform};

/// Steps of the iteration for the nearest rotation: it converges quadratically, and similarities need one.
const MAX_STEPS: usize = 24;
/// Change of a step, in the largest component, that ends the iteration.
const SETTLED: f64 = 1e-14;

/// The similarity that is nearest to a map: the rotation is that of its polar decomposition (Higham, "Computing the polar
/// decomposition", 1986, eq. 3.5), the scale keeps its volume. A map without volume, or that mirrors, leaves a point: what
/// has the least scale.
pub(super) fn nearest(map: &DAffine3) -> PartTransform {
    let determinant = map.matrix3.determinant();
    let (scale, rotation) = if determinant > 0.0 && determinant.is_finite() {
        let scale = determinant.cbrt();
        (scale, rotation_of(map.matrix3 * scale.recip()))
    } else {
        (0.0, DQuat::IDENTITY)
    };
    let scale = scale.clamp(*PART_SCALES.start(), *PART_SCALES.end());
    // What is out of range stays where it is.
    PartTransform::new(map.translation, rotation, scale).unwrap_or(PartTransform::IDENTITY)
}

fn rotation_of(mut matrix: DMat3) -> DQuat {
    for _ in 0..MAX_STEPS {
        let next = (matrix + matrix.inverse().transpose()) * 0.5;
        let change = (next - matrix).to_cols_array().into_iter().fold(0.0_f64, |most, x| most.max(x.abs()));
        matrix = next;
        if change.is_nan() || change < SETTLED {
            break;
        }
    }
    if matrix.is_finite() { DQuat::from_mat3(&matrix).normalize() } else { DQuat::IDENTITY }
}

/// Whether a linear map turns and scales evenly, within a relative tolerance.
#[must_use]
pub fn is_similarity(linear: &DMat3, tolerance: f64) -> bool {
    let determinant = linear.determinant();
    if !(determinant > 0.0 && determinant.is_finite()) {
        return false;
    }
    let scale = determinant.cbrt();
    let axes = [linear.x_axis, linear.y_axis, linear.z_axis];
    let even = axes.iter().all(|axis| (axis.length() - scale).abs() <= tolerance * scale);
    let across = [(0, 1), (1, 2), (2, 0)]
        .iter()
        .all(|&(i, j)| axes[i].dot(axes[j]).abs() <= tolerance * scale * scale);
    even && across
}
