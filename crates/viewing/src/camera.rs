//! Camera controller: orbit around a point, or free flight.

use glam::{DQuat, DVec3, Vec3};
use lodestream_scene::description::Camera;
use lodestream_scene::pose::Pose;
use lodestream_scene::view::View;

/// Radians per pixel of drag.
const TURN_PER_PX: f64 = 0.005;
/// Change of distance per line of the wheel.
const DOLLY_PER_LINE: f64 = 0.88;
/// Smallest angle between the view and up.
const POLE: f64 = 0.02;
/// Angle of the view from above to the vertical: the picture's upper side stays defined.
const TOP_ANGLE: f64 = 1e-3;
/// Room around what the camera is fitted to, as a factor.
const FIT_MARGIN: f64 = 1.1;

/// Mode of the camera controller.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mode {
    /// Around a point.
    Orbit,
    /// Free flight.
    Fly,
}

/// Side from which the target is looked at. With y up these are along −z, −x and −y.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    /// From the front.
    Front,
    /// From the right.
    Right,
    /// From above, the front at the picture's lower side.
    Top,
}

/// Directions of the keys held, each −1, 0 or 1: right, up, forward.
pub type Push = [f64; 3];

/// Camera that mouse and keys move.
#[derive(Clone, Copy, Debug)]
pub struct CameraController {
    /// The mode.
    pub mode: Mode,
    /// Parallel projection, which shows the target in the same size; what is moved is the camera in perspective. The wheel
    /// then changes the height of the picture.
    pub orthographic: bool,
    start: Camera,
    now: Camera,
    /// World units per second of flight.
    speed: f64,
}

impl CameraController {
    /// A controller that starts at a camera.
    #[must_use]
    pub fn new(start: Camera) -> Self {
        let up = Vec3::from(start.up).normalize_or(Vec3::Y).to_array();
        let now = Camera { up, ..start };
        let this = Self { mode: Mode::Orbit, orthographic: false, start, now, speed: 0.0 };
        Self { speed: 0.5 * this.distance(), ..this }
    }

    /// Returns to the start.
    pub fn reset(&mut self) {
        *self = Self { mode: self.mode, orthographic: self.orthographic, ..Self::new(self.start) };
    }

    /// Changes between parallel projection and perspective; what is at the target keeps its size.
    pub fn toggle_projection(&mut self) {
        self.orthographic = !self.orthographic;
    }

    /// Changes the mode without moving.
    pub fn toggle(&mut self) {
        self.mode = match self.mode {
            Mode::Orbit => Mode::Fly,
            Mode::Fly => Mode::Orbit,
        };
    }

    fn eye(&self) -> DVec3 {
        self.now.eye.into()
    }

    fn target(&self) -> DVec3 {
        self.now.target.into()
    }

    fn up(&self) -> DVec3 {
        Vec3::from(self.now.up).as_dvec3().normalize()
    }

    /// Moves to a camera, from which [`CameraController::reset`] still returns to the start.
    pub fn place(&mut self, camera: Camera) {
        let start = self.start;
        *self = Self { mode: self.mode, orthographic: self.orthographic, start, ..Self::new(camera) };
    }

    /// The camera now, in perspective.
    #[must_use]
    pub const fn camera(&self) -> Camera {
        self.now
    }

    fn distance(&self) -> f64 {
        (self.target() - self.eye()).length()
    }

    fn forward(&self) -> DVec3 {
        (self.target() - self.eye()).normalize_or(DVec3::NEG_Z)
    }

    fn right(&self) -> DVec3 {
        self.forward().cross(self.up()).normalize_or(self.up().any_orthonormal_vector())
    }

    /// Moves eye and target.
    fn shift(&mut self, by: DVec3) {
        self.now.eye = (self.eye() + by).into();
        self.now.target = (self.target() + by).into();
    }

    /// The turn of a drag.
    fn turn_of(&self, dx: f64, dy: f64) -> DQuat {
        // Limited at the poles, so that up stays up.
        let angle = self.forward().angle_between(self.up());
        let pitch = (-dy * TURN_PER_PX).max(angle - std::f64::consts::PI + POLE).min(angle - POLE);
        DQuat::from_axis_angle(self.up(), -dx * TURN_PER_PX) * DQuat::from_axis_angle(self.right(), pitch)
    }

    /// A drag of so many pixels to the right and down turns the view: in orbit about the target, in flight about the
    /// eye.
    pub fn turn(&mut self, dx: f64, dy: f64) {
        let turned = self.turn_of(dx, dy) * self.forward();
        let distance = self.distance();
        match self.mode {
            Mode::Orbit => self.now.eye = (self.target() - turned * distance).into(),
            Mode::Fly => self.now.target = (self.eye() + turned * distance).into(),
        }
    }

    /// As [`Self::turn`], in orbit about `pivot`, which stays at its place in the picture.
    pub fn turn_about(&mut self, pivot: DVec3, dx: f64, dy: f64) {
        if self.mode == Mode::Fly || !pivot.is_finite() {
            return self.turn(dx, dy);
        }
        let (turn, forward, distance) = (self.turn_of(dx, dy), self.forward(), self.distance());
        let eye = pivot + turn * (self.eye() - pivot);
        self.now.eye = eye.into();
        self.now.target = (eye + turn * forward * distance).into();
    }

    /// A drag that moves the scene with the pointer.
    pub fn pan(&mut self, dx: f64, dy: f64, height_px: f64) {
        let per_px = 2.0 * self.distance() * (f64::from(self.now.fov_y) * 0.5).tan() / height_px.max(1.0);
        let right = self.right();
        let up = right.cross(self.forward());
        self.shift((right * -dx + up * dy) * per_px);
    }

    /// Turns of the wheel: changes the distance to the target, or the speed of flight.
    pub fn wheel(&mut self, lines: f64) {
        let factor = DOLLY_PER_LINE.powf(lines.clamp(-20.0, 20.0));
        match self.mode {
            Mode::Orbit => {
                let distance = (self.distance() * factor).clamp(1e-9, 1e12);
                self.now.eye = (self.target() - self.forward() * distance).into();
            }
            Mode::Fly => self.speed = (self.speed / factor).clamp(1e-9, 1e12),
        }
    }

    /// As [`Self::wheel`], in orbit nearer to `pivot`, which stays at its place in the picture.
    pub fn wheel_to(&mut self, pivot: DVec3, lines: f64) {
        let factor = DOLLY_PER_LINE.powf(lines.clamp(-20.0, 20.0));
        if self.mode == Mode::Fly
            || !pivot.is_finite()
            || !(1e-9..=1e12).contains(&(self.distance() * factor))
        {
            return self.wheel(lines);
        }
        self.now.eye = (pivot + (self.eye() - pivot) * factor).into();
        self.now.target = (pivot + (self.target() - pivot) * factor).into();
    }

    /// Moves by keys held for `seconds`; in parallel projection, forward magnifies.
    pub fn push(&mut self, push: Push, fast: bool, seconds: f64) {
        let [right, up, mut forward] = push;
        let length = self.speed * seconds * if fast { 4.0 } else { 1.0 };
        if self.orthographic {
            // Forward is larger, as it is in perspective.
            let distance = (self.distance() * (-forward * length / self.distance()).exp()).clamp(1e-9, 1e12);
            self.now.eye = (self.target() - self.forward() * distance).into();
            forward = 0.0;
        }
        let direction = self.right() * right + self.up() * up + self.forward() * forward;
        self.shift(direction.normalize_or_zero() * length);
    }

    /// Moves, without turning, to where a sphere just fits into a picture `aspect` times as wide as high, and orbits
    /// about its centre.
    pub fn fit(&mut self, centre: DVec3, radius: f64, aspect: f64) {
        let up = (f64::from(self.now.fov_y) * 0.5).tan();
        let least = up.min(up * aspect).atan();
        let share = if self.orthographic { least.tan() } else { least.sin() };
        let distance = (FIT_MARGIN * radius / share).clamp(1e-9, 1e12);
        if !centre.is_finite() || !distance.is_finite() {
            return;
        }
        self.now.eye = (centre - self.forward() * distance).into();
        self.now.target = centre.into();
        self.speed = 0.5 * distance;
    }

    /// Looks at the target from a side and its present distance.
    pub fn look_from(&mut self, side: Side) {
        let towards_eye = match side {
            Side::Front => DVec3::Z,
            Side::Right => DVec3::X,
            Side::Top => DVec3::new(0.0, TOP_ANGLE.cos(), TOP_ANGLE.sin()),
        };
        let up = DQuat::from_rotation_arc(DVec3::Y, self.up());
        self.now.eye = (self.target() + up * towards_eye * self.distance()).into();
    }

    /// Moves the eye around the target by an angle in radians, counterclockwise seen from above.
    pub fn circle(&mut self, radians: f64) {
        let turned = DQuat::from_axis_angle(self.up(), radians) * (self.eye() - self.target());
        self.now.eye = (self.target() + turned).into();
    }

    /// Moves eye and target up.
    pub fn lift(&mut self, up: f64) {
        self.shift(DVec3::Y * up);
    }

    /// The camera now, with its projection.
    fn projected(&self) -> Camera {
        if self.orthographic { self.now.orthographic() } else { self.now }
    }

    /// The view to send to the server.
    #[must_use]
    pub fn view(&self, viewport_px: [u32; 2], target_px: f32) -> View {
        self.projected().view(viewport_px, target_px)
    }

    /// The pose to draw from.
    #[must_use]
    pub fn pose(&self) -> Pose {
        self.projected().pose()
    }

    /// The camera in the format of `--camera`, in perspective.
    #[must_use]
    pub fn describe(&self) -> String {
        let point = |[x, y, z]: [f64; 3]| format!("{x:.3},{y:.3},{z:.3}");
        let fov = f64::from(self.now.fov_y).to_degrees();
        format!("eye={};target={};fov={fov:.1}", point(self.now.eye), point(self.now.target))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn controller() -> CameraController {
        CameraController::new(Camera {
            eye: [0.0, 0.0, 10.0],
            target: [0.0; 3],
            up: [0.0, 1.0, 0.0],
            fov_y: 1.0,
        })
    }

    #[test]
    fn orbiting_keeps_the_distance_and_the_target() {
        let mut controller = controller();
        for (dx, dy) in [(30.0, 12.0), (-500.0, 900.0), (4.0, -3000.0)] {
            controller.turn(dx, dy);
            assert!((controller.distance() - 10.0).abs() < 1e-9);
            assert_eq!(controller.target(), DVec3::ZERO);
            let angle = controller.forward().angle_between(controller.up());
            assert!((POLE * 0.9..=std::f64::consts::PI - POLE * 0.9).contains(&angle), "{angle}");
            assert!(controller.view([64, 36], 1.0).check().is_ok());
        }
        // Dragging to the right turns the scene to the right: the eye goes left.
        let mut controller = self::controller();
        controller.turn(50.0, 0.0);
        assert!(controller.eye().x < 0.0);
    }

    #[test]
    fn a_fitted_sphere_fills_the_picture_without_turning() {
        for aspect in [0.5, 1.0, 2.0] {
            let mut controller = controller();
            controller.turn(120.0, -40.0);
            let (forward, centre) = (controller.forward(), DVec3::new(1e6, -3.0, 7.0));
            controller.fit(centre, 2.0, aspect);
            assert!((controller.forward() - forward).length() < 1e-6);
            assert_eq!(controller.target(), centre);
            // Half the angle that the sphere takes, against the narrower half field of view.
            let seen = (2.0 / controller.distance()).asin();
            let (x, y) = controller.pose().tan_half_fov((1000.0 * aspect) as u32, 1000);
            let narrow = x.min(y).atan();
            assert!(seen < narrow && seen > 0.85 * narrow, "{aspect}: {seen} {narrow}");
            controller.fit(DVec3::NAN, 1.0, 1.0);
            assert_eq!(controller.target(), centre);
        }
    }

    #[test]
    fn sides_are_looked_at_from_the_present_distance_with_up_kept_up() {
        let mut controller = controller();
        controller.shift(DVec3::new(3.0, -2.0, 1.0));
        controller.turn(120.0, -40.0);
        controller.wheel(3.0);
        let (target, distance) = (controller.target(), controller.distance());
        for (side, forward, up) in [
            (Side::Right, DVec3::NEG_X, DVec3::Y),
            (Side::Top, DVec3::NEG_Y, DVec3::NEG_Z),
            (Side::Front, DVec3::NEG_Z, DVec3::Y),
        ] {
            controller.look_from(side);
            assert_eq!(controller.target(), target);
            assert!((controller.distance() - distance).abs() < 1e-9);
            assert!((controller.forward() - forward).length() < 2.0 * TOP_ANGLE, "{side:?}");
            let of_picture = controller.pose().rotation * DVec3::Y;
            assert!((of_picture - up).length() < 2.0 * TOP_ANGLE, "{side:?}: {of_picture}");
        }
        // From above too, a drag turns the scene with the pointer.
        controller.look_from(Side::Top);
        controller.turn(0.0, -200.0);
        assert!((controller.forward().angle_between(DVec3::NEG_Y) - 1.0).abs() < 0.01);
        // Another up axis turns the sides with it.
        let camera = Camera { up: [0.0, 0.0, 1.0], ..self::controller().camera() };
        let mut tilted = CameraController::new(camera);
        tilted.look_from(Side::Front);
        assert!((tilted.forward() - DVec3::Y).length() < 1e-9, "{}", tilted.forward());
    }

    /// Where a point is in view space, over its depth.
    fn seen(controller: &CameraController, point: DVec3) -> DVec3 {
        let local = controller.pose().rotation.conjugate() * (point - controller.eye());
        local / -local.z
    }

    #[test]
    fn a_pivot_stays_at_its_place_in_the_picture() {
        let (pivot, mut controller) = (DVec3::new(2.0, -1.0, 3.0), controller());
        for (dx, dy) in [(40.0, -15.0), (-300.0, 60.0), (5.0, 5.0)] {
            let (before, distance) = (seen(&controller, pivot), controller.distance());
            controller.turn_about(pivot, dx, dy);
            assert!((seen(&controller, pivot) - before).length() < 1e-6, "{dx} {dy}");
            assert!((controller.distance() - distance).abs() < 1e-9);
            for lines in [2.0, -1.0] {
                let (before, away) = (seen(&controller, pivot), controller.eye().distance(pivot));
                controller.wheel_to(pivot, lines);
                assert!((seen(&controller, pivot) - before).length() < 1e-6, "{lines}");
                assert_eq!(controller.eye().distance(pivot) < away, lines > 0.0);
            }
        }
        // About the target it is the usual turn.
        let mut usual = self::controller();
        let mut about = usual;
        usual.turn(30.0, 20.0);
        about.turn_about(about.target(), 30.0, 20.0);
        assert!((usual.eye() - about.eye()).length() < 1e-9 && about.target().length() < 1e-9);
        // Never through it.
        for _ in 0..10_000 {
            controller.wheel_to(pivot, 20.0);
        }
        assert!(controller.distance() > 0.0 && controller.eye().is_finite());
    }

    #[test]
    fn parallel_projection_keeps_the_size_at_the_target_through_every_movement() {
        let per_unit = |controller: &CameraController| {
            let (pose, target) = (controller.pose(), controller.target());
            let right = pose.rotation * DVec3::X;
            let across = |at: DVec3| {
                let seen = pose.rotation.conjugate() * (at - pose.eye);
                seen.x / -seen.z / pose.tan_half_fov(1280, 720).0 * 640.0
            };
            (across(target + right) - across(target), controller.view([1280, 720], 1.0).scale_px())
        };
        let mut perspective = controller();
        let mut parallel = controller();
        parallel.toggle_projection();
        assert!(parallel.orthographic && parallel.pose().is_orthographic());
        let steps: [fn(&mut CameraController); 7] = [
            |_| {},
            |controller| controller.turn(80.0, -30.0),
            |controller| controller.wheel(4.0),
            |controller| controller.pan(30.0, -200.0, 720.0),
            |controller| controller.look_from(Side::Right),
            |controller| controller.circle(1.0),
            |controller| controller.wheel(-9.0),
        ];
        for step in steps {
            step(&mut perspective);
            step(&mut parallel);
            assert_eq!(perspective.camera(), parallel.camera());
            let ((seen, scale_px), (same, far_scale_px)) = (per_unit(&perspective), per_unit(&parallel));
            assert!((seen / same - 1.0).abs() < 1e-5, "{seen} {same}");
            // What selection measures errors with: pixels per world unit at the target.
            let away = |controller: &CameraController| (controller.pose().eye - controller.target()).length();
            let (px, far_px) = (scale_px / away(&perspective), far_scale_px / away(&parallel));
            assert!((px / far_px - 1.0).abs() < 1e-5, "{px} {far_px}");
            assert!(parallel.view([1280, 720], 1.0).check().is_ok());
        }
        // A tenth is left around a sphere that the camera is fitted to.
        parallel.fit(DVec3::X, 2.0, 1.0);
        assert!((per_unit(&parallel).0 * 2.0 * FIT_MARGIN - 360.0).abs() < 0.01);
        parallel.reset();
        assert!(parallel.orthographic);
        parallel.toggle_projection();
        assert_eq!(parallel.pose(), controller().pose());
    }

    #[test]
    fn flying_turns_about_the_eye_and_moves_where_it_looks() {
        let mut controller = controller();
        controller.toggle();
        controller.turn(50.0, 0.0);
        assert_eq!(controller.eye(), DVec3::new(0.0, 0.0, 10.0));
        assert!(controller.forward().x > 0.0, "dragging to the right looks to the right");
        let mut parallel = controller;
        parallel.orthographic = true;
        let (target, distance) = (parallel.target(), parallel.distance());
        parallel.push([0.0, 0.0, 1.0], false, 2.0);
        assert!(
            parallel.target() == target && (parallel.distance() / distance - (-1.0_f64).exp()).abs() < 1e-9
        );
        let before = controller.eye();
        controller.push([0.0, 0.0, 1.0], false, 2.0);
        assert!(
            ((controller.eye() - before).length() - 10.0).abs() < 1e-9,
            "half the initial distance per second"
        );
        controller.reset();
        assert_eq!((controller.eye(), controller.mode), (DVec3::new(0.0, 0.0, 10.0), Mode::Fly));
    }

    #[test]
    fn the_wheel_never_passes_the_target() {
        let mut controller = controller();
        for _ in 0..1000 {
            controller.wheel(5.0);
        }
        assert!(controller.distance() > 0.0 && controller.forward().z < -0.99);
    }
}
