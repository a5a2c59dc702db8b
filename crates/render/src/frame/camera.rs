//! Camera matrices: a reversed-Z projection without a far plane.

use glam::{DMat3, DVec3, Mat4, Vec4};
use lodestream_scene::pose::Pose;

/// Projection from view space to clip space: `clip = (x/tx, y/ty, near, −z)`, so depth is
/// `near / −z` (Lapidous and Jiao, "Optimal depth buffer for low-cost graphics hardware", 1999;
/// Upchurch and Desbrun, "Tightening the precision of perspective rendering", 2012).
#[must_use]
pub fn clip_from_view(pose: &Pose, near: f64, (width_px, height_px): (u32, u32)) -> Mat4 {
    let (tx, ty) = pose.tan_half_fov(width_px, height_px);
    Mat4::from_cols(
        Vec4::new((1.0 / tx) as f32, 0.0, 0.0, 0.0),
        Vec4::new(0.0, (1.0 / ty) as f32, 0.0, 0.0),
        Vec4::new(0.0, 0.0, 0.0, -1.0),
        Vec4::new(0.0, 0.0, near as f32, 0.0),
    )
}

/// Rotation from world to view space. There is no translation: everything on the GPU is relative to the eye.
pub(crate) fn view_from_world(pose: &Pose) -> Mat4 {
    Mat4::from_quat(pose.rotation.conjugate().as_quat())
}

/// Where a sphere is, as a camera sees it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Side {
    /// Outside the frustum.
    Out,
    /// Neither, or not a number.
    Across,
    /// Within the frustum.
    In,
}

/// The frustum of a camera, relative to the eye.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Frustum {
    view_from_world: DMat3,
    /// Tangents of half the angles of view, and the lengths of the side planes' normals.
    tangents: [f64; 2],
    lengths: [f64; 2],
}

impl Frustum {
    pub(crate) fn new(pose: &Pose, (width_px, height_px): (u32, u32)) -> Self {
        let (tx, ty) = pose.tan_half_fov(width_px, height_px);
        let view_from_world = DMat3::from_quat(pose.rotation.conjugate());
        Self { view_from_world, tangents: [tx, ty], lengths: [tx.hypot(1.0), ty.hypot(1.0)] }
    }

    /// Where a sphere is (relative to the eye, world units).
    pub(crate) fn side(&self, centre: DVec3, radius: f64) -> Side {
        let c = self.view_from_world * centre;
        // Side planes go through the eye; their inward normals are (∓1, 0, −t) and (0, ∓1, −t).
        let within = |lateral: f64, i: usize| (-c.z * self.tangents[i] - lateral.abs()) / self.lengths[i];
        let within = [-c.z, within(c.x, 0), within(c.y, 1)];
        // A distance that is not a number is neither.
        if within.iter().any(|distance| *distance < -radius) {
            Side::Out
        } else if within.iter().all(|distance| *distance >= radius) {
            Side::In
        } else {
            Side::Across
        }
    }
}

/// Whether a sphere (relative to the eye, world units) may intersect the frustum. A distance that is not a number counts
/// as visible.
pub(crate) fn may_see(pose: &Pose, centre: DVec3, radius: f64, size: (u32, u32)) -> bool {
    Frustum::new(pose, size).side(centre, radius) != Side::Out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cpu_reference::depth;

    #[test]
    fn projection_matches_its_cpu_reference() {
        let near = 0.01;
        let pose = Pose::look_at(DVec3::ZERO, DVec3::NEG_Z, DVec3::Y, 0.9);
        let m = clip_from_view(&pose, near, (320, 180));
        let (tx, ty) = pose.tan_half_fov(320, 180);
        for p in [[0.3, -0.2, -0.5], [-40.0, 7.0, -900.0], [1e5, 2e5, -1e7]] {
            let clip = m * Vec4::new(p[0] as f32, p[1] as f32, p[2] as f32, 1.0);
            let (ndc, d) = depth::project(p, [tx, ty], near);
            assert!((f64::from(clip.x / clip.w) - ndc[0]).abs() < 1e-5);
            assert!((f64::from(clip.y / clip.w) - ndc[1]).abs() < 1e-5);
            assert!((f64::from(clip.z / clip.w) - d).abs() <= d * 1e-6);
        }
    }

    #[test]
    fn sphere_test_keeps_what_touches_the_frustum() {
        let pose = Pose::look_at(DVec3::ZERO, DVec3::NEG_Z, DVec3::Y, 1.0);
        let sees = |x, y, z, r| may_see(&pose, DVec3::new(x, y, z), r, (160, 160));
        assert!(sees(0.0, 0.0, -5.0, 0.1));
        assert!(!sees(0.0, 0.0, 5.0, 0.1));
        assert!(sees(0.0, 0.0, 5.0, 6.0));
        assert!(!sees(10.0, 0.0, -5.0, 1.0));
        assert!(sees(10.0, 0.0, -5.0, 8.0));
        assert!(!sees(0.0, -10.0, -5.0, 1.0));
    }
}
