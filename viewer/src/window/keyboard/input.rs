//! Effects of keys on the camera and on the quality of the next frame.
//!
//! Input is handled between frames: the window system delivers it before the next frame, which is already drawn at the
//! quality of a moving camera. The response is visible after the current frame and one quick frame; for a key that is
//! held after two, since it has moved the camera for no time in the first.

use std::time::Duration;

use winit::keyboard::KeyCode;

use super::actions::Action;
use super::held::Keys;
use lodestream_viewing::{CameraController, Quality, Side};

/// Handles a key that went down or up at `now`; returns its action, if it went down and the action is not the camera's.
pub(in crate::window) fn key(
    now: Duration,
    code: KeyCode,
    pressed: bool,
    keys: &mut Keys,
    controller: Option<&mut CameraController>,
    quality: &mut Quality,
) -> Option<Action> {
    let Some(controller) = controller else {
        keys.set(now, code, pressed, None);
        return keys.action(code).filter(|_| pressed);
    };
    keys.set(now, code, pressed, Some(controller));
    let action = keys.action(code).filter(|_| pressed)?;
    let side = match action {
        Action::Fly => {
            controller.toggle();
            return None;
        }
        Action::Orthographic => {
            controller.toggle_projection();
            quality.moved(now);
            return None;
        }
        Action::Turntable => {
            keys.toggle_turntable(now);
            return None;
        }
        Action::Start => None,
        Action::Front => Some(Side::Front),
        Action::Right => Some(Side::Right),
        Action::Top => Some(Side::Top),
        other => return Some(other),
    };
    keys.stop_turntable();
    match side {
        Some(side) => controller.look_from(side),
        None => controller.reset(),
    }
    quality.moved(now);
    None
}

/// Moves the camera by the keys held and the turntable, before a frame that begins at `now`.
pub(in crate::window) fn move_camera(
    now: Duration,
    keys: &mut Keys,
    controller: Option<&mut CameraController>,
    quality: &mut Quality,
) {
    keys.advance(now, controller);
    if keys.moves_camera() {
        quality.moved(now);
    }
}

#[cfg(test)]
mod tests {
    use std::rc::Rc;

    use super::super::bindings::Bindings;
    use super::*;
    use crate::window::steps::{self, Steps};
    use lodestream_scene::description::Camera;
    use lodestream_scene::pose::Pose;

    /// Time of a frame at full quality, as a software driver takes at 1280×720, and of one while the camera moves.
    const FULL_S: f64 = 0.7;
    const QUICK_S: f64 = 1.0 / 15.0;
    /// What the window aims for while the camera moves: one quick frame.
    const FPS: f64 = 15.0;
    /// End of the simulation.
    const LONG: Duration = Duration::from_secs(8);

    /// A window in virtual time, whose frames take as long as the table of steps says.
    struct Window {
        now: Duration,
        keys: Keys,
        controller: CameraController,
        quality: Quality,
        /// The pose that the server received last.
        heard: Option<Pose>,
        /// Frames: start, end, pose.
        shown: Vec<(Duration, Duration, Pose)>,
    }

    impl Steps for Window {
        type Painted = ();

        fn receive(&mut self) -> anyhow::Result<()> {
            Ok(())
        }

        fn move_camera(&mut self) {
            // Receiving takes some time.
            self.now += Duration::from_millis(1);
            move_camera(self.now, &mut self.keys, Some(&mut self.controller), &mut self.quality);
        }

        fn send_view(&mut self) {
            self.heard = Some(self.controller.pose());
        }

        fn paint(&mut self) -> anyhow::Result<()> {
            assert_eq!(
                self.heard,
                Some(self.controller.pose()),
                "the view is sent before the frame is drawn"
            );
            let (begun, took) = (self.now, FULL_S * self.quality.cost());
            self.now += Duration::from_secs_f64(took);
            self.shown.push((begun, self.now, self.controller.pose()));
            self.quality.drawn(begun, took);
            Ok(())
        }
    }

    fn usual() -> Keys {
        Keys::new(Rc::new(Bindings::new(&Default::default()).unwrap()))
    }

    fn start() -> CameraController {
        CameraController::new(Camera {
            eye: [0.0, 0.0, 10.0],
            target: [0.0; 3],
            up: [0.0, 1.0, 0.0],
            fov_y: 1.0,
        })
    }

    /// Draws frames one after another, as while more of the scene arrives. Keys take effect between frames, at the
    /// first opportunity after their time. Returns the end of the frame during which the last key was pressed, and of
    /// the first later frame whose pose satisfies `answer`.
    fn answered(
        controller: CameraController,
        presses: &[(Duration, KeyCode)],
        answer: impl Fn(&Pose) -> bool,
    ) -> (Duration, Duration) {
        let (keys, quality) = (usual(), Quality::new(true, Some(FPS)));
        let mut window =
            Window { now: Duration::ZERO, keys, controller, quality, heard: None, shown: Vec::new() };
        let (mut presses, mut free) = (presses.iter().peekable(), Duration::ZERO);
        while window.now < LONG {
            while let Some((_, code)) = presses.next_if(|(at, _)| *at <= window.now) {
                let Window { now, keys, controller, quality, .. } = &mut window;
                key(*now, *code, true, keys, Some(controller), quality);
                free = *now;
            }
            steps::run(&mut window).unwrap();
        }
        let first = window.shown.iter().find(|(begun, _, pose)| *begun >= free && answer(pose));
        (free, first.expect("it is answered").1)
    }

    #[test]
    fn keys_choose_the_view_and_the_start_view_again() {
        let (mut controller, mut keys, mut quality) = (start(), usual(), Quality::new(true, None));
        let mut press = |code| {
            key(Duration::ZERO, code, true, &mut keys, Some(&mut controller), &mut quality);
            key(Duration::ZERO, code, false, &mut keys, Some(&mut controller), &mut quality);
            (controller.pose().eye, keys.moves_camera())
        };
        for (code, eye) in [
            (KeyCode::Digit3, [10.0, 0.0, 0.0]),
            (KeyCode::Digit7, [0.0, 10.0, 0.01]),
            (KeyCode::Digit1, [0.0, 0.0, 10.0]),
            (KeyCode::Numpad7, [0.0, 10.0, 0.01]),
            (KeyCode::Home, [0.0, 0.0, 10.0]),
        ] {
            assert!(press(KeyCode::Space).1);
            let (there, moves) = press(code);
            assert!((there - glam::DVec3::from(eye)).length() < 1e-3, "{code:?}: {there}");
            assert!(!moves, "{code:?} stops the turntable");
        }
        assert!(press(KeyCode::Space).1 && !press(KeyCode::Space).1);
    }

    /// The frame after a key has the quality of a moving camera, even if the camera rested before.
    #[test]
    fn a_key_takes_effect_one_or_two_quick_frames_after_the_current_one() {
        let (home, mut moved) = (start(), start());
        moved.turn(300.0, 0.0);
        for late_ms in [1, 50, 200, 350, 500, 650, 699] {
            // Long after the first frames: frames are drawn at full quality.
            let at = Duration::from_millis(4000 + late_ms);
            let within = |what: &str, quick: f64, (free, seen): (Duration, Duration)| {
                let under_way = free.saturating_sub(at).as_secs_f64();
                assert!(under_way <= FULL_S + 0.01, "{what}: the key is handled {under_way} s later");
                let took = seen.saturating_sub(free).as_secs_f64();
                assert!(took <= quick * QUICK_S + 0.01, "{what}: shown {took} s later");
            };
            let reset = answered(moved, &[(at, KeyCode::KeyR)], |pose| *pose == home.pose());
            within("reset", 1.0, reset);
            // A key that is held moves the camera from the second frame on.
            let way = |pose: &Pose| (pose.eye - home.pose().eye).length() > 0.1;
            within("push", 2.0, answered(home, &[(at, KeyCode::KeyW)], way));
        }
    }
}
