//! The error of root proxies that are made for the start camera.
//!
//! Such a root errs by a number of pixels wherever the start camera sees it, thus by a length that grows with the
//! distance. What the camera does not see errs [`UNSEEN`] times as much.

use glam::{DVec3, Vec3};
use lodestream_scene::description::Camera;
use lodestream_scene::proxy::{START_VIEWPORT_PX, UNSEEN};
use lodestream_scene::view::Frustum;

/// Distance by which the error counts as larger, per distance of the eye from the start camera's: what is near comes out
/// from behind other things soonest.
const PER_MOVE: f64 = 16.0;
/// Error in what has no textures of its own, as a share of the radius of what it stands for.
const APPEARANCE: f32 = 1.0 / 16.0;

/// Errors of a scene's roots.
#[derive(Clone, Copy, Debug)]
pub struct RootError {
    eye: DVec3,
    frustum: Frustum,
    slope: f64,
}

impl RootError {
    /// Those of a scene by its start camera and [`root_slope`](lodestream_scene::description::SceneHeader::root_slope); `None` if its roots have one error everywhere.
    #[must_use]
    pub fn new(start: &Camera, slope: f32) -> Option<Self> {
        let view = start.view(START_VIEWPORT_PX, 1.0);
        let slope = f64::from(slope);
        (slope > 0.0).then(|| Self { eye: DVec3::from(view.eye), frustum: view.frustum(), slope })
    }

    /// Error of a root in the middle of a sphere in the world as an eye sees it, in world units: an estimate, since what
    /// the start camera sees is known by its frustum alone.
    #[must_use]
    #[expect(clippy::cast_possible_truncation, reason = "an estimate")]
    pub fn error(&self, eye: [f64; 3], center: [f64; 3], radius: f32) -> f32 {
        let (eye, center) = (DVec3::from(eye), DVec3::from(center));
        let relative = center - self.eye;
        let unseen = if self.frustum.sees(relative.as_vec3(), radius) { 1.0 } else { UNSEEN };
        let distance = relative.length().max(f64::from(radius)) + PER_MOVE * eye.distance(self.eye);
        (self.slope * distance * unseen) as f32
    }

    /// As [`Self::error`], with what is missing since a root has colours at vertices and no textures.
    #[must_use]
    pub fn error_with_appearance(&self, eye: [f64; 3], center: [f64; 3], radius: f32) -> f32 {
        self.error(eye, center, radius).max(APPEARANCE * radius)
    }
}

/// Middle of a sphere that is relative to an asset's origin, for an asset that is placed as it is.
pub(crate) fn middle(origin: [f64; 3], center: [f32; 3]) -> DVec3 {
    DVec3::from(origin) + Vec3::from(center).as_dvec3()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_error_grows_with_distance_and_where_the_start_camera_does_not_see() {
        let camera = Camera { eye: [1.0, 0.0, 0.0], target: [0.0; 3], up: [0.0, 1.0, 0.0], fov_y: 1.0 };
        let error = RootError::new(&camera, 0.01).unwrap();
        let at = |x: f64| error.error(camera.eye, [x, 0.0, 0.0], 0.5);
        assert!((at(-9.0) - 0.1).abs() < 1e-6);
        assert!((at(-99.0) - 1.0).abs() < 1e-6);
        assert!((at(11.0) - 6.4).abs() < 1e-5, "behind");
        let moved = error.error([1.0, 0.0, 1.0], [-9.0, 0.0, 0.0], 0.5);
        assert!((moved - 0.26).abs() < 1e-6);
        assert!(RootError::new(&camera, 0.0).is_none());
    }
}
