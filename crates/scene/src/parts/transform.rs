//! Where a part is moved to.

use glam::{DMat3, DQuat, DVec3};

use crate::placement::Placement;

/// Smallest and largest scale of a [`PartTransform`].
pub const PART_SCALES: std::ops::RangeInclusive<f64> = 1e-6..=1e6;
/// Largest coordinate of a [`PartTransform`]'s translation, in units of the asset.
pub const MAX_PART_TRANSLATION: f64 = 1e12;

/// Relative tolerance within which the axes of a matrix count as equally long and orthogonal: the rounding of matrices
/// that were composed in f32.
const SIMILARITY: f64 = 1e-4;

/// Where a part is moved to within its instance: `moved = translation + rotation · (scale · place)`, in units of the asset
/// and about its (0, 0, 0). A similarity, so that the part keeps its shape, and its errors scale with it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PartTransform {
    translation: DVec3,
    rotation: DQuat,
    scale: f64,
}

/// Why a part cannot be moved so.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum PartTransformError {
    /// NaN or infinite.
    #[error("a number of the part's transform is not finite; all must be")]
    NotFinite,
    /// A coordinate beyond [`MAX_PART_TRANSLATION`].
    #[error("the part would be moved by {0:e}; at most {MAX_PART_TRANSLATION:e} units are allowed")]
    TooFar(f64),
    /// No volume is left, or its sign changes.
    #[error("the part's matrix is singular or mirrors: its determinant is {0:e}, but must be above 0")]
    Singular(f64),
    /// A scale outside [`PART_SCALES`].
    #[error("the part would be scaled by {0:e}; 1e-6 to 1e6 are allowed")]
    Scale(f64),
    /// Uneven scale or shear.
    #[error("the part's matrix scales unevenly or shears; parts may only be moved, turned and scaled evenly")]
    Uneven,
    /// A projection.
    #[error("the last row of the part's matrix must be 0, 0, 0, 1")]
    Projective,
}

impl PartTransform {
    /// Leaves the part where it is.
    pub const IDENTITY: Self = Self { translation: DVec3::ZERO, rotation: DQuat::IDENTITY, scale: 1.0 };

    /// A move by a distance, in units of the asset.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn by(distance: DVec3) -> Result<Self, PartTransformError> {
        Self::new(distance, DQuat::IDENTITY, 1.0)
    }

    /// A transform from translation, rotation (normalised here) and scale.
    ///
    /// # Errors
    /// Numbers that are not finite or out of range; a rotation whose length is 0 or out of range counts as not finite.
    pub fn new(translation: DVec3, rotation: DQuat, scale: f64) -> Result<Self, PartTransformError> {
        let rotation = rotation * rotation.length_recip();
        if !translation.is_finite() || !rotation.is_finite() || !scale.is_finite() {
            return Err(PartTransformError::NotFinite);
        }
        let farthest = translation.abs().max_element();
        if farthest > MAX_PART_TRANSLATION {
            return Err(PartTransformError::TooFar(farthest));
        }
        if !PART_SCALES.contains(&scale) {
            return Err(PartTransformError::Scale(scale));
        }
        Ok(Self { translation, rotation, scale })
    }

    /// The transform of a matrix, column after column as glTF, WebGL and three.js write them.
    ///
    /// # Errors
    /// Numbers that are not finite or out of range, and matrices that are no similarity with a positive scale.
    pub fn from_matrix(columns: [f64; 16]) -> Result<Self, PartTransformError> {
        if !columns.iter().all(|x| x.is_finite()) {
            return Err(PartTransformError::NotFinite);
        }
        let [ax, ay, az, aw, bx, by, bz, bw, cx, cy, cz, cw, x, y, z, w] = columns;
        if [aw, bw, cw, w] != [0.0, 0.0, 0.0, 1.0] {
            return Err(PartTransformError::Projective);
        }
        let axes = [DVec3::new(ax, ay, az), DVec3::new(bx, by, bz), DVec3::new(cx, cy, cz)];
        let linear = DMat3::from_cols(axes[0], axes[1], axes[2]);
        let determinant = linear.determinant();
        if !(determinant > 0.0 && determinant.is_finite()) {
            return Err(PartTransformError::Singular(determinant));
        }
        let scale = determinant.cbrt();
        let is_even = axes.iter().all(|axis| (axis.length() - scale).abs() <= SIMILARITY * scale);
        let is_square = [(0, 1), (1, 2), (2, 0)]
            .iter()
            .all(|&(i, j)| axes[i].dot(axes[j]).abs() <= SIMILARITY * scale * scale);
        if !is_even || !is_square {
            return Err(PartTransformError::Uneven);
        }
        Self::new(DVec3::new(x, y, z), DQuat::from_mat3(&(linear * scale.recip())), scale)
    }

    /// The share that moves.
    #[must_use]
    pub const fn translation(&self) -> DVec3 {
        self.translation
    }

    /// The share that turns, of unit length.
    #[must_use]
    pub const fn rotation(&self) -> DQuat {
        self.rotation
    }

    /// The share that scales.
    #[must_use]
    pub const fn scale(&self) -> f64 {
        self.scale
    }

    /// Where a place of the part is moved to.
    #[must_use]
    pub fn apply(&self, place: DVec3) -> DVec3 {
        self.translation + self.rotation * (self.scale * place)
    }

    /// The place that is moved to `moved`.
    #[must_use]
    pub fn undo(&self, moved: DVec3) -> DVec3 {
        self.undo_direction(moved - self.translation)
    }

    /// The direction that is turned and scaled to `moved`.
    #[must_use]
    pub fn undo_direction(&self, moved: DVec3) -> DVec3 {
        self.rotation.conjugate() * moved / self.scale
    }

    /// First another transform, then this. What is out of range counts as its own, without the other.
    #[must_use]
    pub fn after(&self, first: &Self) -> Self {
        let (rotation, scale) = (self.rotation * first.rotation, self.scale * first.scale);
        Self::new(self.apply(first.translation), rotation, scale).unwrap_or(*self)
    }

    /// Each of some transforms once, in an order of their numbers.
    #[must_use]
    pub fn distinct<'a>(transforms: impl Iterator<Item = &'a Self>) -> Vec<Self> {
        let numbers = |transform: &Self| {
            let Self { translation, rotation, scale } = transform;
            let [x, y, z] = translation.to_array();
            let [i, j, k, w] = rotation.to_array();
            [x, y, z, i, j, k, w, *scale].map(f64::to_bits)
        };
        let mut all: Vec<Self> = transforms.copied().collect();
        all.sort_by_key(numbers);
        all.dedup_by_key(|transform| numbers(transform));
        all
    }

    /// A sphere about all places that those of a sphere are moved to, and the sphere itself.
    #[must_use]
    pub fn bounds<'a>(
        transforms: impl Iterator<Item = &'a Self>,
        (centre, radius): (DVec3, f64),
    ) -> (DVec3, f64) {
        transforms.fold((centre, radius), |(at, reach), transform| {
            let (moved, its) = (transform.apply(centre), radius * transform.scale);
            let apart = at.distance(moved);
            if apart + its <= reach {
                (at, reach)
            } else if apart + reach <= its {
                (moved, its)
            } else {
                let both = 0.5 * (apart + reach + its);
                (at + (moved - at) * ((both - reach) / apart), both)
            }
        })
    }

    /// The placement in the world of the part, in an instance with this placement.
    #[must_use]
    #[expect(clippy::cast_possible_truncation, reason = "to the nearest f32")]
    pub fn within(&self, instance: &Placement) -> Placement {
        let rotation = instance.orientation_f64() * self.rotation;
        let scale = (f64::from(instance.scale) * self.scale) as f32;
        Placement::new(instance.to_world(self.translation), rotation, scale)
    }
}

#[cfg(test)]
mod tests {
    use glam::DMat4;

    use super::*;

    fn matrix(of: DMat4) -> Result<PartTransform, PartTransformError> {
        PartTransform::from_matrix(of.to_cols_array())
    }

    fn turned() -> DMat4 {
        let rotation = DQuat::from_axis_angle(DVec3::new(1.0, 2.0, -1.0).normalize(), 2.5);
        DMat4::from_scale_rotation_translation(DVec3::splat(2.5), rotation, DVec3::new(1.0, -4.0, 2e6))
    }

    #[test]
    fn a_matrix_is_followed_in_double_precision_and_undone() {
        let (place, to) = (DVec3::new(0.3, -7.0, 4e5), turned());
        let transform = matrix(to).unwrap();
        assert!(transform.apply(place).distance(to.transform_point3(place)) < 1e-8);
        assert!(transform.undo(transform.apply(place)).distance(place) < 1e-8);
        let placement = Placement::new(DVec3::new(5.0, 6.0, 7.0), DQuat::from_rotation_y(1.0), 0.5);
        let (place, both) = (DVec3::new(1.0, 2.0, 3.0), transform.within(&placement));
        assert!(both.to_world(place).distance(placement.to_world(transform.apply(place))) < 0.2);
        assert_eq!(PartTransform::by(DVec3::X).unwrap().apply(DVec3::Y), DVec3::new(1.0, 1.0, 0.0));
        let first = PartTransform::new(DVec3::Y, DQuat::from_rotation_x(0.4), 3.0).unwrap();
        let (both, apart) = (transform.after(&first).apply(place), transform.apply(first.apply(place)));
        assert!(both.distance(apart) < 1e-8, "{both} {apart}");
    }

    #[test]
    fn bounds_hold_where_a_sphere_was_and_where_it_is_moved_to() {
        let transforms = [
            PartTransform::by(DVec3::new(3.0, 0.0, 0.0)).unwrap(),
            PartTransform::by(DVec3::new(0.1, 0.0, 0.0)).unwrap(),
            PartTransform::new(DVec3::ZERO, DQuat::from_rotation_z(2.0), 4.0).unwrap(),
            PartTransform::by(DVec3::new(3.0, 0.0, 0.0)).unwrap(),
        ];
        let distinct = PartTransform::distinct(transforms.iter());
        assert_eq!(distinct.len(), 3);
        let sphere = (DVec3::new(1.0, 2.0, 0.0), 1.5);
        let (centre, radius) = PartTransform::bounds(distinct.iter(), sphere);
        for (at, reach) in
            transforms.map(|t| (t.apply(sphere.0), t.scale() * sphere.1)).into_iter().chain([sphere])
        {
            assert!(centre.distance(at) + reach <= radius * (1.0 + 1e-12));
        }
        let (centre, radius) = PartTransform::bounds(distinct[..0].iter(), sphere);
        assert_eq!((centre, radius), sphere);
    }

    #[test]
    fn whatever_is_no_similarity_is_refused_with_the_reason() {
        use PartTransformError as E;
        let with = |at: usize, value: f64| {
            let mut columns = turned().to_cols_array();
            columns[at] = value;
            PartTransform::from_matrix(columns).unwrap_err()
        };
        for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            assert!((0..16).all(|at| with(at, bad) == E::NotFinite), "{bad}");
            assert_eq!(PartTransform::by(DVec3::splat(bad)), Err(E::NotFinite));
            assert_eq!(PartTransform::new(DVec3::ZERO, DQuat::IDENTITY, bad), Err(E::NotFinite));
        }
        assert_eq!(with(3, 1.0), E::Projective);
        assert_eq!(with(12, -2e12), E::TooFar(2e12));
        let scaled = |x, y, z| matrix(DMat4::from_scale(DVec3::new(x, y, z))).unwrap_err();
        assert_eq!(scaled(0.0, 0.0, 0.0), E::Singular(0.0));
        assert!(matches!(scaled(1.0, 1.0, 0.0), E::Singular(_)));
        assert!(matches!(scaled(-1.0, 1.0, 1.0), E::Singular(_)));
        assert_eq!(scaled(1.0, 1.01, 1.0), E::Uneven);
        assert!(matches!(scaled(1e-9, 1e-9, 1e-9), E::Scale(_)));
        assert!(matches!(scaled(1e120, 1e120, 1e120), E::Singular(_)), "the determinant overflows");
        assert_eq!(
            PartTransform::new(DVec3::ZERO, DQuat::from_xyzw(0.0, 0.0, 0.0, 0.0), 1.0),
            Err(E::NotFinite)
        );
        assert!(PartTransform::new(DVec3::ZERO, DQuat::IDENTITY, -1.0).is_err());
    }
}
