//! Position, orientation and field of view of a camera, for computation in f64.

use glam::{DMat3, DQuat, DVec3};

/// Vertical field of view of orthographic cameras, in radians: 0.086°, narrower than scenes may state. Parallel projection
/// is drawn with a long lens: over a depth of the picture's height, nothing in 1280×720 pixels moves by more than one. A
/// longer lens would leave fewer bits of f32 for differences of depths, of which this one resolves a fifteenth of a pixel in 720 lines.
pub const ORTHOGRAPHIC_FOV_Y: f32 = 0.0015;
/// Half the field of view of the camera to which an orthographic one compares, where sizes are shares of the depth: its
/// tangent, of 25°.
const USUAL_TANGENT: f64 = 0.466_307_658_154_998_6;

/// A camera as it is drawn from: position, orientation and field of view, in f64.
///
/// View space is right-handed with x to the right, y up and the view along −z. A [`Camera`] is what scenes, paths and
/// people state: it also has the point to orbit about, and no rotation that would have to agree with it. A [`View`] is
/// what selection needs and clients send: it also has the picture's size and target error, and its rotation is in f32,
/// as sent. Both convert to a pose, a camera without rounding.
///
/// [`Camera`]: crate::description::Camera
/// [`View`]: crate::view::View
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// Position of the eye in the world.
    pub eye: DVec3,
    /// Turns view space into the world: a unit quaternion.
    pub rotation: DQuat,
    /// Vertical field of view in radians, in (0, π).
    pub fov_y: f64,
}

impl Pose {
    /// A camera at `eye` that looks at `target`; `up` need not be perpendicular. Where the
    /// direction is degenerate (eye on target, or looking along `up`), any valid pose is taken.
    #[must_use]
    pub fn look_at(eye: DVec3, target: DVec3, up: DVec3, fov_y: f64) -> Self {
        let forward = (target - eye).try_normalize().unwrap_or(DVec3::NEG_Z);
        let right = forward
            .cross(up)
            .try_normalize()
            .filter(|r| r.is_finite())
            .unwrap_or_else(|| forward.any_orthonormal_vector());
        let up = right.cross(forward);
        let rotation = DQuat::from_mat3(&DMat3::from_cols(right, up, -forward)).normalize();
        Self { eye, rotation, fov_y }
    }

    /// `(tan(fov_x / 2), tan(fov_y / 2))` for a picture of the given size. The field of view is
    /// clamped to what a projection can hold.
    #[must_use]
    pub fn tan_half_fov(&self, width_px: u32, height_px: u32) -> (f64, f64) {
        let y = (self.fov_y.clamp(1e-5, std::f64::consts::PI - 1e-3) * 0.5).tan();
        (y * f64::from(width_px.max(1)) / f64::from(height_px.max(1)), y)
    }

    /// Whether this stands for a parallel projection: its field of view is at most [`ORTHOGRAPHIC_FOV_Y`].
    #[must_use]
    pub fn is_orthographic(&self) -> bool {
        self.fov_y <= f64::from(ORTHOGRAPHIC_FOV_Y)
    }

    /// Factor on lengths that are stated as shares of the depth, such as tolerances: 1, but for an orthographic camera,
    /// which stands far away, what gives these lengths the size in pixels that they have at a field of view of 50°.
    #[must_use]
    pub fn depth_factor(&self) -> f64 {
        if self.is_orthographic() { self.tan_half_fov(1, 1).1 / USUAL_TANGENT } else { 1.0 }
    }

    /// Direction from the eye through a place of a picture, in pixels from its upper left corner; world axes, not of
    /// unit length.
    #[must_use]
    pub fn direction(&self, [x, y]: [f64; 2], (width_px, height_px): (u32, u32)) -> DVec3 {
        let (across, up) = self.tan_half_fov(width_px, height_px);
        let right = 2.0 * x / f64::from(width_px.max(1)) - 1.0;
        let down = 2.0 * y / f64::from(height_px.max(1)) - 1.0;
        self.rotation * DVec3::new(right * across, -down * up, -1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::description::Camera;

    #[test]
    fn look_at_puts_the_target_on_the_axis() {
        let pose = Pose::look_at(DVec3::new(1.0, 2.0, 3.0), DVec3::new(-4.0, 0.5, 9.0), DVec3::Y, 1.0);
        let v = pose.rotation.conjugate() * (DVec3::new(-4.0, 0.5, 9.0) - pose.eye);
        assert!(v.x.abs() < 1e-12 && v.y.abs() < 1e-12 && v.z < 0.0, "{v}");
        let up = pose.rotation * DVec3::Y;
        assert!(up.y > 0.9);
    }

    #[test]
    fn directions_lead_through_pixels() {
        let pose = Pose::look_at(DVec3::Z, DVec3::ZERO, DVec3::Y, std::f64::consts::FRAC_PI_2);
        let off = |at, want: [f64; 3]| (pose.direction(at, (200, 100)) - DVec3::from(want)).length();
        assert!(off([100.0, 50.0], [0.0, 0.0, -1.0]) < 1e-12);
        assert!(off([0.0, 0.0], [-2.0, 1.0, -1.0]) < 1e-12);
        assert!(off([150.0, 100.0], [1.0, -1.0, -1.0]) < 1e-12);
    }

    #[test]
    fn degenerate_directions_give_a_valid_pose() {
        for (eye, at) in [(DVec3::ZERO, DVec3::ZERO), (DVec3::ZERO, DVec3::Y), (DVec3::NAN, DVec3::Y)] {
            let pose = Pose::look_at(eye, at, DVec3::Y, 1.0);
            assert!(pose.rotation.is_finite() && pose.rotation.is_normalized());
        }
    }

    #[test]
    fn camera_and_view_give_the_same_pose() {
        let camera =
            Camera { eye: [3.0, -2.0, 5.0], target: [0.5, 1.0, -4.0], up: [0.0, 1.0, 0.0], fov_y: 0.9 };
        let (exact, sent) = (camera.pose(), camera.view([64, 36], 1.0).pose());
        assert_eq!((exact.eye, exact.fov_y), (sent.eye, sent.fov_y));
        // A view's rotation has 24 bits.
        assert!(exact.rotation.angle_between(sent.rotation) < 1e-6);
    }
}
