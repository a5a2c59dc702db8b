//! Turntable: the camera slowly circles its target, by real time and independent of the frame rate.

use std::time::Duration;

use crate::CameraController;

/// Seconds that a whole turn takes.
const TURN_S: f64 = 12.0;

/// A turntable; it rests at first.
#[derive(Clone, Copy, Debug, Default)]
pub struct Turntable {
    /// Time up to which the camera has been moved; `None` while it rests.
    turned_until: Option<Duration>,
}

impl Turntable {
    /// Starts or stops at `now`.
    pub fn toggle(&mut self, now: Duration) {
        self.turned_until = self.turned_until.is_none().then_some(now);
    }

    /// Stops: the camera is moved by hand.
    pub fn stop(&mut self) {
        self.turned_until = None;
    }

    /// Whether it turns.
    #[must_use]
    pub const fn is_turning(&self) -> bool {
        self.turned_until.is_some()
    }

    /// Moves the camera for the time since the last call. A clock that goes back moves nothing.
    pub fn advance(&mut self, now: Duration, controller: &mut CameraController) {
        if let Some(until) = &mut self.turned_until {
            let seconds = now.saturating_sub(*until).as_secs_f64();
            *until = now.max(*until);
            controller.circle(std::f64::consts::TAU * (seconds / TURN_S).fract());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;
    use lodestream_scene::description::Camera;

    fn seconds(seconds: f64) -> Duration {
        Duration::from_secs_f64(seconds)
    }

    #[test]
    fn a_turn_takes_twelve_seconds_however_long_frames_are() {
        let camera =
            Camera { eye: [1.0, 2.0, 10.0], target: [1.0, 0.0, 0.0], up: [0.0, 1.0, 0.0], fov_y: 1.0 };
        for frame_s in [0.25, 1.0, 3.0] {
            let (mut controller, mut table) = (CameraController::new(camera), Turntable::default());
            table.advance(seconds(5.0), &mut controller);
            assert_eq!(controller.camera(), camera, "it rests at first");
            table.toggle(seconds(5.0));
            let mut turned_s = 0.0;
            for (after_s, eye) in [
                (3.0, DVec3::new(11.0, 2.0, 0.0)),
                (6.0, DVec3::new(1.0, 2.0, -10.0)),
                (12.0, DVec3::new(1.0, 2.0, 10.0)),
            ] {
                while turned_s < after_s {
                    turned_s += frame_s;
                    table.advance(seconds(5.0 + turned_s), &mut controller);
                }
                let there = controller.pose().eye;
                assert!((there - eye).length() < 1e-6, "{frame_s} s a frame, after {after_s} s: {there}");
            }
            assert!(table.is_turning());
            table.toggle(seconds(17.0));
            let rest = controller.camera();
            table.advance(seconds(20.0), &mut controller);
            assert_eq!((controller.camera(), table.is_turning()), (rest, false));
            // The rest is not made up for.
            table.toggle(seconds(30.0));
            table.advance(seconds(30.0), &mut controller);
            assert_eq!(controller.pose().eye, DVec3::from(rest.eye));
            table.stop();
            assert!(!table.is_turning());
        }
    }
}
