//! Keys held, the turntable, and the camera movement that they cause, by real time and independent of the frame rate.

use std::collections::BTreeSet;
use std::rc::Rc;
use std::time::Duration;

use winit::keyboard::KeyCode;

use super::actions::Action;
use super::bindings::Bindings;
use lodestream_viewing::{CameraController, Push, Turntable};

/// The keys that are held, and the turntable that a key starts.
#[derive(Clone, Debug)]
pub(in crate::window) struct Keys {
    bindings: Rc<Bindings>,
    held: BTreeSet<KeyCode>,
    /// Time up to which the camera has been moved.
    moved_until: Duration,
    turntable: Turntable,
}

impl Keys {
    /// None is held.
    pub(in crate::window) fn new(bindings: Rc<Bindings>) -> Self {
        Self { bindings, held: BTreeSet::new(), moved_until: Duration::ZERO, turntable: Turntable::default() }
    }

    /// The keys of actions.
    pub(in crate::window) fn bindings(&self) -> Rc<Bindings> {
        Rc::clone(&self.bindings)
    }

    /// The action of a key that has gone down.
    pub(in crate::window) fn action(&self, code: KeyCode) -> Option<Action> {
        self.bindings.action(code, self.is_control_held())
    }

    fn push(&self) -> Push {
        let holds = |action| i8::from(self.bindings.holds(&self.held, action));
        let axis = |plus, minus| f64::from(holds(plus) - holds(minus));
        [
            axis(Action::MoveRight, Action::MoveLeft),
            axis(Action::MoveUp, Action::MoveDown),
            axis(Action::MoveForward, Action::MoveBack),
        ]
    }

    /// Whether keys that are held or the turntable move the camera.
    pub(in crate::window) fn moves_camera(&self) -> bool {
        self.is_pushing() || self.turntable.is_turning()
    }

    fn is_pushing(&self) -> bool {
        self.push() != [0.0; 3]
    }

    /// Whether a control key is held, with which letters are commands and do not move the camera.
    pub(in crate::window) fn is_control_held(&self) -> bool {
        [KeyCode::ControlLeft, KeyCode::ControlRight].iter().any(|key| self.held.contains(key))
    }

    /// Starts or stops the turntable at `now`.
    pub(in crate::window) fn toggle_turntable(&mut self, now: Duration) {
        self.turntable.toggle(now);
    }

    /// Stops the turntable: the camera is moved otherwise.
    pub(in crate::window) fn stop_turntable(&mut self) {
        self.turntable.stop();
    }

    /// Moves the camera for the time since the last call.
    pub(in crate::window) fn advance(&mut self, now: Duration, controller: Option<&mut CameraController>) {
        let seconds = now.saturating_sub(self.moved_until).as_secs_f64();
        self.moved_until = now.max(self.moved_until);
        let Some(controller) = controller else { return };
        if self.is_pushing() {
            self.turntable.stop();
            controller.push(self.push(), self.bindings.holds(&self.held, Action::MoveFast), seconds);
        }
        self.turntable.advance(now, controller);
    }

    /// Records that a key went down or up at `now`, after moving the camera up to then.
    pub(in crate::window) fn set(
        &mut self,
        now: Duration,
        code: KeyCode,
        pressed: bool,
        controller: Option<&mut CameraController>,
    ) {
        self.advance(now, controller);
        if pressed && !self.is_control_held() {
            self.held.insert(code);
        } else {
            self.held.remove(&code);
        }
        if self.is_pushing() {
            self.turntable.stop();
        }
    }

    /// Releases all keys: the window has lost focus.
    pub(in crate::window) fn release(&mut self, now: Duration, controller: Option<&mut CameraController>) {
        self.advance(now, controller);
        self.held.clear();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use lodestream_scene::description::Camera;

    fn usual() -> Keys {
        Keys::new(Rc::new(Bindings::new(&Default::default()).unwrap()))
    }

    /// The position after a key was held from 1 s to 9 s, with frames every `frame_ms`.
    fn flown(frame_ms: u64) -> glam::DVec3 {
        let camera = Camera { eye: [0.0, 0.0, 10.0], target: [0.0; 3], up: [0.0, 1.0, 0.0], fov_y: 1.0 };
        let (mut controller, mut keys) = (CameraController::new(camera), usual());
        let (down, up) = (Duration::from_secs(1), Duration::from_secs(9));
        let (mut pressed, mut released) = (false, false);
        for frame in 0..=12_000 / frame_ms {
            let now = Duration::from_millis(frame * frame_ms);
            if !pressed && now >= down {
                keys.set(down, KeyCode::KeyW, true, Some(&mut controller));
                pressed = true;
            }
            if !released && now >= up {
                keys.set(up, KeyCode::KeyW, false, Some(&mut controller));
                released = true;
            }
            keys.advance(now, Some(&mut controller));
        }
        controller.pose().eye
    }

    /// Long frames move the camera for their whole duration.
    #[test]
    fn flight_distance_does_not_depend_on_frame_time() {
        let smooth = flown(10);
        // The speed is half the initial distance per second, forward.
        assert!((smooth - glam::DVec3::new(0.0, 0.0, 10.0 - 40.0)).length() < 1e-9, "{smooth}");
        for frame_ms in [16, 333, 2000, 4000] {
            assert!((flown(frame_ms) - smooth).length() < 1e-9, "{frame_ms} ms a frame");
        }
    }

    #[test]
    fn a_key_moves_four_times_as_fast_with_shift() {
        let camera = Camera { eye: [0.0, 0.0, 10.0], target: [0.0; 3], up: [0.0, 1.0, 0.0], fov_y: 1.0 };
        let moved = [&[KeyCode::KeyD][..], &[KeyCode::ShiftLeft, KeyCode::KeyD]].map(|held| {
            let (mut controller, mut keys) = (CameraController::new(camera), usual());
            for &code in held {
                keys.set(Duration::from_secs(1), code, true, Some(&mut controller));
            }
            keys.advance(Duration::from_secs(2), Some(&mut controller));
            controller.pose().eye.x
        });
        assert!(moved[0] > 1.0 && (moved[1] - 4.0 * moved[0]).abs() < 1e-9, "{moved:?}");
    }

    #[test]
    fn letters_with_control_do_not_move_the_camera() {
        let mut keys = usual();
        for (code, pressed) in
            [(KeyCode::ControlLeft, true), (KeyCode::KeyS, true), (KeyCode::ControlLeft, false)]
        {
            keys.set(Duration::ZERO, code, pressed, None);
            assert!(!keys.is_pushing());
        }
        keys.set(Duration::ZERO, KeyCode::KeyS, false, None);
        keys.set(Duration::ZERO, KeyCode::KeyS, true, None);
        assert!(keys.is_pushing());
    }

    #[test]
    fn a_key_that_moves_the_camera_stops_the_turntable() {
        let mut keys = usual();
        keys.toggle_turntable(Duration::ZERO);
        assert!(keys.moves_camera() && !keys.is_pushing());
        keys.set(Duration::from_secs(1), KeyCode::KeyW, true, None);
        keys.set(Duration::from_secs(2), KeyCode::KeyW, false, None);
        assert!(!keys.moves_camera());
    }
}
