//! A perspective view: eye, orientation, field of view, viewport and target screen error.

use geometry::screen::scale_px;
use glam::{DQuat, DVec3, Mat3, Quat, Vec3};
use lodestream_geometry as geometry;

use crate::encoding::encode_fields;
use crate::limits::MAX_VIEWPORT_PX;
use crate::pose::Pose;

/// A perspective view of the scene, as clients send it and selection measures errors in it: a camera with the size of
/// its picture and the error to refine to. [`View::pose`] is for drawing.
///
/// View space is right-handed with x to the right, y up and the view along −z. There is no far plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    /// Position of the eye, in world units.
    pub eye: [f64; 3],
    /// Rotation from view space to world space: unit quaternion x, y, z, w.
    pub rotation: [f32; 4],
    /// Vertical field of view in radians, in (0, π).
    pub fov_y: f32,
    /// Width and height of the picture, in pixels.
    pub viewport_px: [u32; 2],
    /// Screen error to refine to, in pixels.
    pub target_px: f32,
}

encode_fields!(View { eye, rotation, fov_y, viewport_px, target_px });

/// A view with a value out of range.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ViewError {
    /// The eye is not a finite point.
    #[error("the eye is not a finite point")]
    Eye,
    /// The rotation is not a unit quaternion.
    #[error("the view's rotation is not a unit quaternion")]
    Rotation,
    /// The field of view is not in (0, π).
    #[error("the field of view is not within (0, pi)")]
    FieldOfView,
    /// The viewport has no pixels, or more than [`MAX_VIEWPORT_PX`] a side.
    #[error("the viewport is empty or too large")]
    Viewport,
    /// The target is not a finite number above 0.
    #[error("the target screen error is not a positive number")]
    Target,
}

impl View {
    /// A view from `eye` towards `target`, with `up` roughly up (any other axis where they align).
    #[must_use]
    pub fn look_at(eye: [f64; 3], target: [f64; 3], up: [f32; 3], fov_y: f32, viewport_px: [u32; 2]) -> Self {
        let rotation = look_rotation(DVec3::from(eye), DVec3::from(target), Vec3::from(up));
        Self { eye, rotation: rotation.to_array(), fov_y, viewport_px, target_px: 1.0 }
    }

    /// Checks the ranges of all values.
    ///
    /// # Errors
    /// The first value that is out of range.
    pub fn check(&self) -> Result<(), ViewError> {
        if !self.eye.iter().all(|x| x.is_finite()) {
            return Err(ViewError::Eye);
        }
        let length = self.rotation.iter().map(|x| x * x).sum::<f32>();
        if !(0.9..=1.1).contains(&length) {
            return Err(ViewError::Rotation);
        }
        if !(self.fov_y > 1e-4 && self.fov_y < std::f32::consts::PI - 1e-4) {
            return Err(ViewError::FieldOfView);
        }
        if !self.viewport_px.iter().all(|x| (1..=MAX_VIEWPORT_PX).contains(x)) {
            return Err(ViewError::Viewport);
        }
        if !(self.target_px > 0.0 && self.target_px.is_finite()) {
            return Err(ViewError::Target);
        }
        Ok(())
    }

    /// The camera of the view.
    #[must_use]
    pub fn pose(&self) -> Pose {
        Pose {
            eye: DVec3::from(self.eye),
            rotation: DQuat::normalize(self.orientation().as_dquat()),
            fov_y: f64::from(self.fov_y),
        }
    }

    /// Rotation from view space to world space.
    #[must_use]
    pub fn orientation(&self) -> Quat {
        let q = Quat::from_array(self.rotation);
        if q.length_squared() > 0.0 { q.normalize() } else { Quat::IDENTITY }
    }

    /// Unit vector along which depth is measured.
    #[must_use]
    pub fn forward(&self) -> Vec3 {
        self.orientation() * Vec3::NEG_Z
    }

    /// Width divided by height.
    #[must_use]
    pub fn aspect(&self) -> f32 {
        #[expect(clippy::cast_precision_loss, reason = "sides are at most 65,535 pixels")]
        let [w, h] = self.viewport_px.map(|x| x.max(1) as f32);
        w / h
    }

    /// Pixels per unit of tangent: `height_px / (2 tan(fov_y / 2))`.
    #[must_use]
    pub fn scale_px(&self) -> f64 {
        scale_px(f64::from(self.viewport_px[1]), f64::from(self.fov_y))
    }

    /// The view frustum, in world axes relative to the eye.
    #[must_use]
    pub fn frustum(&self) -> Frustum {
        let ty = (self.fov_y * 0.5).tan();
        let tx = ty * self.aspect();
        let to_world = Mat3::from_quat(self.orientation());
        // Inside a side plane: x + tx·depth ≥ 0 with depth = −z, hence the normal (1, 0, −tx).
        let plane = |x: f32, y: f32, t: f32| to_world * (Vec3::new(x, y, -t) / (1.0 + t * t).sqrt());
        Frustum {
            forward: self.forward(),
            sides: [plane(1.0, 0.0, tx), plane(-1.0, 0.0, tx), plane(0.0, 1.0, ty), plane(0.0, -1.0, ty)],
        }
    }
}

/// Rotation of a view from `eye` towards `target`.
fn look_rotation(eye: DVec3, target: DVec3, up: Vec3) -> Quat {
    let forward = (target - eye).normalize_or(DVec3::NEG_Z).as_vec3();
    let mut right = forward.cross(up);
    if right.length_squared() < 1e-10 {
        right = forward.cross(forward.any_orthonormal_vector());
    }
    let right = right.normalize();
    let up = right.cross(forward);
    Quat::from_mat3(&Mat3::from_cols(right, up, -forward)).normalize()
}

/// A view frustum without near and far plane: four planes through the eye.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frustum {
    /// Unit vector along the view axis.
    pub forward: Vec3,
    /// Unit normals of the left, right, bottom and top planes, pointing inwards.
    pub sides: [Vec3; 4],
}

impl Frustum {
    /// Whether a sphere reaches into the frustum; `center` is relative to the eye.
    ///
    /// Conservative: spheres near an edge may count as visible.
    #[must_use]
    pub fn sees(&self, center: Vec3, radius: f32) -> bool {
        self.forward.dot(center) + radius > 0.0 && self.sides.iter().all(|n| n.dot(center) >= -radius)
    }

    /// The interval of a sphere's path from `center` to `center + way` in which it reaches into the frustum, as
    /// fractions 0 to 1; `None` if it never does. `center` is relative to the eye. Conservative as [`Self::sees`].
    #[must_use]
    pub fn sees_on_path(&self, center: Vec3, radius: f32, way: Vec3) -> Option<[f32; 2]> {
        let [mut from, mut to] = [0.0_f32, 1.0];
        for normal in self.sides.iter().chain([&self.forward]) {
            let (inside, slope) = (normal.dot(center) + radius, normal.dot(way));
            if slope > 0.0 {
                from = from.max(-inside / slope);
            } else if slope < 0.0 {
                to = to.min(-inside / slope);
            } else if inside < 0.0 {
                return None;
            }
        }
        (from <= to).then_some([from, to])
    }

    /// Depth of the nearest point of a sphere along the view axis; may be negative.
    #[must_use]
    pub fn depth(&self, center: Vec3, radius: f32) -> f32 {
        self.forward.dot(center) - radius
    }

    /// The same frustum in axes turned by the inverse of `rotation` (an instance's own axes).
    #[must_use]
    pub fn rotated_into(&self, rotation: Quat) -> Self {
        let inverse = rotation.conjugate();
        Self { forward: inverse * self.forward, sides: self.sides.map(|n| inverse * n) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frustum_agrees_with_projection() {
        let view = View::look_at([3.0, -2.0, 5.0], [0.5, 1.0, -4.0], [0.0, 1.0, 0.0], 1.0, [640, 360]);
        view.check().unwrap();
        let frustum = view.frustum();
        let inverse = view.orientation().conjugate();
        let ty = 0.5_f32.tan();
        let tx = ty * 640.0 / 360.0;
        for i in 0..2000_i16 {
            let f = f32::from(i);
            let p = Vec3::new((f * 0.37).sin() * 9.0, (f * 0.73).cos() * 9.0, (f * 0.11).sin() * 9.0);
            let v = inverse * p;
            let inside = v.z < 0.0 && v.x.abs() <= -v.z * tx && v.y.abs() <= -v.z * ty;
            assert_eq!(frustum.sees(p, 0.0), inside, "{p} {v}");
        }
    }

    #[test]
    fn path_interval_matches_tests_along_the_path() {
        let view = View::look_at([0.0; 3], [0.3, -0.2, -1.0], [0.0, 1.0, 0.0], 1.0, [640, 360]);
        let frustum = view.frustum();
        let mut cases = [0, 0];
        for i in 0..2000_i16 {
            let f = f32::from(i);
            let center = Vec3::new((f * 0.37).sin() * 9.0, (f * 0.73).cos() * 9.0, (f * 0.11).sin() * 9.0);
            let way = Vec3::new((f * 0.29).cos() * 12.0, (f * 0.53).sin() * 12.0, (f * 0.83).cos() * 12.0);
            let radius = 0.5 + f32::from(i % 4) * 0.3;
            let at = |share: f32| frustum.sees(center + way * share, radius);
            let range = frustum.sees_on_path(center, radius, way);
            cases[usize::from(range.is_some())] += 1;
            for step in 0_u16..=100 {
                let share = f32::from(step) / 100.0;
                let within =
                    |slack: f32| range.is_some_and(|[from, to]| share >= from - slack && share <= to + slack);
                assert!(!at(share) || within(1e-4), "{center} {way} {share} {range:?}");
                assert!(at(share) || !within(-1e-4), "{center} {way} {share} {range:?}");
            }
        }
        assert!(cases.iter().all(|&number| number > 200), "{cases:?}");
    }

    #[test]
    fn straight_up_has_an_orientation() {
        let view = View::look_at([0.0; 3], [0.0, 9.0, 0.0], [0.0, 1.0, 0.0], 1.0, [64, 64]);
        view.check().unwrap();
        assert!(view.forward().dot(Vec3::Y) > 0.9999);
    }

    #[test]
    fn invalid_views_are_refused() {
        let good = View::look_at([0.0; 3], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0], 1.0, [64, 64]);
        assert!(View { eye: [f64::NAN, 0.0, 0.0], ..good }.check().is_err());
        assert!(View { rotation: [0.0; 4], ..good }.check().is_err());
        assert!(View { rotation: [f32::NAN; 4], ..good }.check().is_err());
        assert!(View { fov_y: 3.2, ..good }.check().is_err());
        assert!(View { viewport_px: [0, 3], ..good }.check().is_err());
        assert!(View { target_px: -1.0, ..good }.check().is_err());
    }
}
