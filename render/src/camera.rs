//! The camera: a pose in f64 and a reversed-Z projection without a far plane.

use glam::{DQuat, DVec3, Mat4, Vec4};

/// Where the picture is taken from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// Position of the eye in the world.
    pub eye: DVec3,
    /// Turns view space (x right, y up, looking along −z) into the world.
    pub rotation: DQuat,
    /// Vertical field of view in radians, in (0, π).
    pub fov_y: f64,
    /// Distance of the near plane in world units, > 0. Reversed floating-point depth has the same
    /// relative precision everywhere, so this may be tiny: a thousandth of the smallest thing worth
    /// looking at costs nothing.
    pub near: f64,
}

impl Camera {
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
        let rotation = DQuat::from_mat3(&glam::DMat3::from_cols(right, up, -forward)).normalize();
        Self { eye, rotation, fov_y, near: 1e-4 }
    }

    /// `(tan(fov_x / 2), tan(fov_y / 2))` for a picture of the given size. The field of view is
    /// clamped to what a projection can hold.
    #[must_use]
    pub fn tan_half_fov(&self, width_px: u32, height_px: u32) -> (f64, f64) {
        let y = (self.fov_y.clamp(1e-5, std::f64::consts::PI - 1e-3) * 0.5).tan();
        (y * f64::from(width_px.max(1)) / f64::from(height_px.max(1)), y)
    }

    /// Projection from view space to clip space: `clip = (x/tx, y/ty, near, −z)`, so depth is
    /// `near / −z` (Lapidous and Jiao, "Optimal depth buffer for low-cost graphics hardware", 1999;
    /// Upchurch and Desbrun, "Tightening the precision of perspective rendering", 2012).
    #[must_use]
    pub fn clip_from_view(&self, width_px: u32, height_px: u32) -> Mat4 {
        let (tx, ty) = self.tan_half_fov(width_px, height_px);
        Mat4::from_cols(
            Vec4::new((1.0 / tx) as f32, 0.0, 0.0, 0.0),
            Vec4::new(0.0, (1.0 / ty) as f32, 0.0, 0.0),
            Vec4::new(0.0, 0.0, 0.0, -1.0),
            Vec4::new(0.0, 0.0, self.near as f32, 0.0),
        )
    }

    /// Turns directions of the world into view space (no translation: everything on the GPU is
    /// relative to the eye).
    #[must_use]
    pub fn view_from_world(&self) -> Mat4 {
        Mat4::from_quat(self.rotation.conjugate().as_quat())
    }

    /// True unless the sphere (relative to the eye, world units) lies wholly outside the frustum.
    #[must_use]
    pub fn may_see(&self, centre: DVec3, radius: f64, width_px: u32, height_px: u32) -> bool {
        let c = self.rotation.conjugate() * centre;
        let (tx, ty) = self.tan_half_fov(width_px, height_px);
        // Side planes go through the eye; their inward normals are (∓1, 0, −t) and (0, ∓1, −t),
        // not normalised. A distance that is not a number counts as visible.
        let outside = |lateral: f64, t: f64| (-c.z * t - lateral.abs()) / t.hypot(1.0) < -radius;
        !(-c.z < -radius || outside(c.x, tx) || outside(c.y, ty))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::twin::depth;

    #[test]
    fn look_at_puts_the_target_on_the_axis() {
        let camera = Camera::look_at(DVec3::new(1.0, 2.0, 3.0), DVec3::new(-4.0, 0.5, 9.0), DVec3::Y, 1.0);
        let v = camera.rotation.conjugate() * (DVec3::new(-4.0, 0.5, 9.0) - camera.eye);
        assert!(v.x.abs() < 1e-12 && v.y.abs() < 1e-12 && v.z < 0.0, "{v}");
        let up = camera.rotation * DVec3::Y;
        assert!(up.y > 0.9);
    }

    #[test]
    fn degenerate_directions_give_a_valid_pose() {
        for (eye, at) in [(DVec3::ZERO, DVec3::ZERO), (DVec3::ZERO, DVec3::Y), (DVec3::NAN, DVec3::Y)] {
            let camera = Camera::look_at(eye, at, DVec3::Y, 1.0);
            assert!(camera.rotation.is_finite() && camera.rotation.is_normalized());
        }
    }

    #[test]
    fn projection_matches_its_twin() {
        let camera = Camera { near: 0.01, ..Camera::look_at(DVec3::ZERO, DVec3::NEG_Z, DVec3::Y, 0.9) };
        let m = camera.clip_from_view(320, 180);
        let (tx, ty) = camera.tan_half_fov(320, 180);
        for p in [[0.3, -0.2, -0.5], [-40.0, 7.0, -900.0], [1e5, 2e5, -1e7]] {
            let clip = m * Vec4::new(p[0] as f32, p[1] as f32, p[2] as f32, 1.0);
            let (ndc, d) = depth::project(p, [tx, ty], camera.near);
            assert!((f64::from(clip.x / clip.w) - ndc[0]).abs() < 1e-5);
            assert!((f64::from(clip.y / clip.w) - ndc[1]).abs() < 1e-5);
            assert!((f64::from(clip.z / clip.w) - d).abs() <= d * 1e-6);
        }
    }

    #[test]
    fn sphere_test_keeps_what_touches_the_frustum() {
        let camera = Camera::look_at(DVec3::ZERO, DVec3::NEG_Z, DVec3::Y, 1.0);
        let sees = |x, y, z, r| camera.may_see(DVec3::new(x, y, z), r, 160, 160);
        assert!(sees(0.0, 0.0, -5.0, 0.1));
        assert!(!sees(0.0, 0.0, 5.0, 0.1));
        assert!(sees(0.0, 0.0, 5.0, 6.0));
        assert!(!sees(10.0, 0.0, -5.0, 1.0));
        assert!(sees(10.0, 0.0, -5.0, 8.0));
        assert!(!sees(0.0, -10.0, -5.0, 1.0));
    }
}
