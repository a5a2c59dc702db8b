//! Camera paths: the camera of a run as a function of time, from the scene's start camera on.

use glam::{DQuat, DVec3, Vec3};
use lodestream_scene::description::Camera;

/// Motion of the camera. Angles turn about the camera's own up vector.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Motion {
    /// None: the start view.
    Still,
    /// Around the point in the middle of the picture, looking at it.
    Orbit {
        /// Total angle.
        degrees: f64,
    },
    /// Straight ahead, through the point in the middle of the picture and possibly beyond.
    FlyThrough {
        /// Distance, in multiples of the distance from the start to that point.
        distance: f64,
    },
    /// A jump along the orbit.
    Teleport {
        /// Angle of the jump.
        degrees: f64,
    },
    /// In place, looking to one side, to the other, and back, as a sine.
    Swing {
        /// Largest angle to each side.
        degrees: f64,
        /// Number of periods.
        times: f64,
    },
}

/// When a path begins.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Start {
    /// Once every visible instance can be drawn.
    FirstFrame,
    /// Once the start view has reached its target quality.
    Settled,
    /// At a time since the connect call.
    At {
        /// The time.
        seconds: f64,
    },
}

/// A camera path: a motion, its duration and its start.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CameraPath {
    /// The motion.
    pub motion: Motion,
    /// Duration; 0 for a jump.
    pub seconds: f64,
    /// Start condition.
    pub start: Start,
}

impl CameraPath {
    /// The start view.
    pub const STILL: Self = Self { motion: Motion::Still, seconds: 0.0, start: Start::FirstFrame };

    /// Whether the camera moves at all.
    #[must_use]
    pub fn moves(&self) -> bool {
        self.motion != Motion::Still
    }

    /// The camera at `seconds` after the start of the path; it stays at the path's end.
    #[must_use]
    pub fn camera(&self, start: &Camera, seconds: f64) -> Camera {
        let progress = if self.seconds > 0.0 { (seconds / self.seconds).clamp(0.0, 1.0) } else { 1.0 };
        let (eye, target) = (DVec3::from(start.eye), DVec3::from(start.target));
        let turn = |degrees: f64| {
            let up = Vec3::from(start.up).as_dvec3().normalize_or(DVec3::Y);
            DQuat::from_axis_angle(up, degrees.to_radians())
        };
        let (eye, target) = match self.motion {
            Motion::Still => (eye, target),
            Motion::Orbit { degrees } => (target + turn(degrees * progress) * (eye - target), target),
            Motion::Teleport { degrees } => (target + turn(degrees) * (eye - target), target),
            Motion::FlyThrough { distance } => {
                let way = (target - eye) * (distance * progress);
                (eye + way, target + way)
            }
            Motion::Swing { degrees, times } => {
                let side = (std::f64::consts::TAU * times * progress).sin();
                (eye, eye + turn(degrees * side) * (target - eye))
            }
        };
        Camera { eye: eye.to_array(), target: target.to_array(), ..*start }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const START: Camera =
        Camera { eye: [0.0, 1.0, 4.0], target: [0.0, 1.0, 0.0], up: [0.0, 1.0, 0.0], fov_y: 0.8 };

    fn at(motion: Motion, seconds: f64) -> ([f64; 3], [f64; 3]) {
        let camera = CameraPath { motion, seconds: 8.0, start: Start::FirstFrame }.camera(&START, seconds);
        assert_eq!((camera.up, camera.fov_y), (START.up, START.fov_y));
        (camera.eye, camera.target)
    }

    fn close(found: [f64; 3], expected: [f64; 3]) {
        let off = (DVec3::from(found) - DVec3::from(expected)).length();
        assert!(off < 1e-12, "{found:?}, expected {expected:?}");
    }

    #[test]
    fn every_path_starts_at_the_start_and_goes_where_it_should() {
        let orbit = Motion::Orbit { degrees: 360.0 };
        let fly = Motion::FlyThrough { distance: 1.5 };
        let swing = Motion::Swing { degrees: 90.0, times: 1.0 };
        for motion in [Motion::Still, orbit, fly, swing] {
            let (eye, target) = at(motion, 0.0);
            close(eye, START.eye);
            close(target, START.target);
        }
        // A quarter around, counter-clockwise from above: from +z to +x.
        close(at(orbit, 2.0).0, [4.0, 1.0, 0.0]);
        close(at(orbit, 2.0).1, START.target);
        close(at(orbit, 8.0).0, START.eye);
        // Half of one and a half distances of 4; the direction stays.
        close(at(fly, 4.0).0, [0.0, 1.0, 1.0]);
        close(at(fly, 4.0).1, [0.0, 1.0, -3.0]);
        close(at(fly, 80.0).0, [0.0, 1.0, -2.0]);
        // To one side (left: −x), through the middle, to the other side.
        close(at(swing, 2.0).1, [-4.0, 1.0, 4.0]);
        close(at(swing, 4.0).1, START.target);
        close(at(swing, 6.0).1, [4.0, 1.0, 4.0]);
        close(at(swing, 6.0).0, START.eye);
    }

    #[test]
    fn a_teleport_takes_no_time() {
        let path =
            CameraPath { motion: Motion::Teleport { degrees: 180.0 }, seconds: 0.0, start: Start::Settled };
        close(path.camera(&START, 0.0).eye, [0.0, 1.0, -4.0]);
        assert!(path.moves() && !CameraPath::STILL.moves());
    }
}
