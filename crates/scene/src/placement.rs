//! Placement of an object in the world: position, rotation and uniform scale.

use glam::{DQuat, DVec3, Quat};

/// Where an object stands: `world = translation + rotation · (scale · point)`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placement {
    /// World position of the object's (0, 0, 0).
    pub translation: [f64; 3],
    /// Unit quaternion x, y, z, w from the object's axes to world axes.
    pub rotation: [f32; 4],
    /// World units per unit of the object, above zero. A mirrored object is another object.
    pub scale: f32,
}

impl Default for Placement {
    fn default() -> Self {
        Self::at([0.0; 3])
    }
}

impl Placement {
    /// A placement without rotation and scale.
    #[must_use]
    pub const fn at(translation: [f64; 3]) -> Self {
        Self { translation, rotation: [0.0, 0.0, 0.0, 1.0], scale: 1.0 }
    }

    /// A placement from a position and a rotation in f64, which is rounded.
    #[must_use]
    pub fn new(translation: DVec3, rotation: DQuat, scale: f32) -> Self {
        Self { translation: translation.to_array(), rotation: rotation.as_quat().to_array(), scale }
    }

    /// Rotation from the object's axes to world axes.
    #[must_use]
    pub fn orientation(&self) -> Quat {
        let q = Quat::from_array(self.rotation);
        if q.length_squared() > 0.0 { q.normalize() } else { Quat::IDENTITY }
    }

    /// The rotation normalised in f64, for computing further placements.
    #[must_use]
    pub fn orientation_f64(&self) -> DQuat {
        DQuat::from_array(self.rotation.map(f64::from)).normalize()
    }

    /// World position of a point of the object.
    #[must_use]
    pub fn to_world(&self, point: DVec3) -> DVec3 {
        DVec3::from(self.translation) + self.orientation().as_dquat() * (point * f64::from(self.scale))
    }

    /// The placement in the world of a part with this placement in an object that is placed by `object`.
    #[must_use]
    #[expect(clippy::cast_possible_truncation, reason = "to the nearest f32")]
    pub fn within(&self, object: &Self) -> Self {
        let (rotation, scale) = (object.orientation_f64(), f64::from(object.scale));
        Self::new(
            DVec3::from(object.translation) + rotation * (DVec3::from(self.translation) * scale),
            rotation * self.orientation_f64(),
            (scale * f64::from(self.scale)) as f32,
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_are_placed_in_double_precision() {
        let half_turn = [0.0, 1.0, 0.0, 0.0];
        let placement = Placement { translation: [1e7, 0.0, 0.0], rotation: half_turn, scale: 2.0 };
        let world = placement.to_world(DVec3::new(0.375, 1.0, 0.0));
        assert!((world - DVec3::new(1e7 - 0.75, 2.0, 0.0)).length() < 1e-6, "{world}");
    }

    #[test]
    fn a_part_of_a_placed_object_is_where_both_placements_put_it() {
        let object = Placement::new(DVec3::new(1.0, -2.0, 3.0), DQuat::from_rotation_x(0.7), 2.0);
        let part = Placement::new(DVec3::new(-4.0, 0.5, 0.0), DQuat::from_rotation_z(-1.9), 0.25);
        let point = DVec3::new(0.3, 0.4, -0.5);
        let (both, whole) = (object.to_world(part.to_world(point)), part.within(&object).to_world(point));
        assert!((both - whole).length() < 1e-6, "{both} {whole}");
    }

    #[test]
    fn a_rotation_of_zero_length_is_none() {
        let placement = Placement { rotation: [0.0; 4], ..Placement::default() };
        assert_eq!(placement.to_world(DVec3::ONE), DVec3::ONE);
    }
}
