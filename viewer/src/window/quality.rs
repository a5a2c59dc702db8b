//! How well a frame is drawn while the camera moves: as well as the device can at [`LEAST_FPS`], and in full once it
//! rests.

mod table;

use std::time::Duration;

use table::STEPS;
pub(super) use table::{FULL, Step, all_of};

/// Frames a second that a moving camera needs.
const LEAST_FPS: f64 = 15.0;
/// Time of a frame that is aimed at: some below what is needed, since frames differ.
const AIM_S: f64 = 0.85 / LEAST_FPS;
/// A finer step is taken while moving where it would fit into this share of the time, for so many frames in a row.
const ROOM: f64 = 0.6;
const ROOM_FRAMES: u32 = 8;
/// Frames by which shadows may be late while more of the scene is on its way.
const LATE_WHILE_COMING: u32 = 3;
/// The camera rests when it has not moved for so long.
const REST: Duration = Duration::from_millis(200);

/// Chooses the step of each frame.
#[derive(Clone, Debug)]
pub(super) struct Quality {
    step: usize,
    moved: Option<Duration>,
    /// What the last frame says that one in full takes, in seconds, by the table's costs.
    full_s: f64,
    /// Frames in a row in which a finer step would have fitted.
    roomy: u32,
}

impl Quality {
    /// On a device that is known to be `slow` the first frames are drawn as fast as can be; on others in full.
    pub(super) fn new(slow: bool) -> Self {
        Self { step: if slow { STEPS.len() - 1 } else { 0 }, moved: None, full_s: 0.0, roomy: 0 }
    }

    /// The camera has moved. Where it rested before, the first frame need not be slow to show that frames are.
    pub(super) fn moved(&mut self, now: Duration) {
        if !self.is_moving(now) && self.full_s * self.step().cost > 1.0 / LEAST_FPS {
            self.step = self.enough().max(self.step);
        }
        self.moved = Some(now);
    }

    /// Whether the camera counts as moving.
    pub(super) fn is_moving(&self, now: Duration) -> bool {
        self.moved.is_some_and(|at| now < at + REST)
    }

    /// Takes note of a frame with the scene in it, which took `frame_s` seconds from when it was `begun` on: whether the
    /// camera moves is what counted then, since a slow frame outlasts [`REST`].
    pub(super) fn drawn(&mut self, begun: Duration, frame_s: f64) {
        self.full_s = frame_s / self.step().cost;
        if !self.is_moving(begun) {
            // Two at a time, or half of them: each is a frame that the user waits for.
            self.step = self.step.saturating_sub(2).min(self.step / 2);
            self.roomy = 0;
            return;
        }
        if frame_s > 1.0 / LEAST_FPS {
            // Where the estimate says that the present step is enough and it was not, one more.
            self.step = self.enough().max((self.step + 1).min(STEPS.len() - 1));
            self.roomy = 0;
        } else if self.step > 0 && self.full_s * STEPS[self.step - 1].cost <= ROOM * AIM_S {
            self.roomy += 1;
            if self.roomy >= ROOM_FRAMES {
                self.step -= 1;
                self.roomy = 0;
            }
        } else {
            self.roomy = 0;
        }
    }

    /// The best step that should be fast enough; the last one if none is.
    fn enough(&self) -> usize {
        STEPS.iter().position(|step| self.full_s * step.cost <= AIM_S).unwrap_or(STEPS.len() - 1)
    }

    /// What the next frame is drawn with.
    pub(super) const fn step(&self) -> Step {
        STEPS[self.step]
    }

    /// Time of the next frame over that of one in full, as the table says.
    #[cfg(test)]
    pub(super) const fn cost(&self) -> f64 {
        self.step().cost
    }

    /// Frames for which maps of shadows may show things as they were while more of the scene is on its way: some on a
    /// device that is too slow to draw all anew each time.
    pub(super) fn late_shadows(&self) -> u32 {
        if self.full_s > 1.0 / LEAST_FPS { LATE_WHILE_COMING } else { 0 }
    }

    /// When another frame is due for a better picture: never, at once, or once the camera counts as resting.
    pub(super) fn due(&self, now: Duration) -> Option<Duration> {
        if self.step == 0 {
            return None;
        }
        Some(self.moved.map_or(Duration::ZERO, |at| (at + REST).saturating_sub(now)))
    }

    /// Whether nothing is given up.
    pub(super) const fn is_full(&self) -> bool {
        self.step == 0
    }

    /// For the overlay.
    pub(super) fn describe(&self) -> String {
        if self.is_full() {
            return "full".into();
        }
        let given_up = self.step().given_up().join(", ");
        format!("step {} of {}: {given_up}", self.step, STEPS.len() - 1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use lodestream_render::{AntiAliasing, MAX_LIGHTS, Settings};

    /// A device that takes `full_s` for a frame in full, and for others as the table says but for a `bias` of its own.
    struct Device {
        full_s: f64,
        bias: f64,
    }

    /// Frames of a camera that moves from 1 s to 5 s: (when done, time taken, step).
    fn frames(device: &Device, quality: &mut Quality) -> Vec<(f64, f64, usize)> {
        let (mut now, mut all) = (0.0, Vec::new());
        while now < 10.0 {
            let begun = Duration::from_secs_f64(now);
            if (1.0..5.0).contains(&now) {
                quality.moved(begun);
            }
            let drawn_with = quality.step;
            let took = device.full_s * STEPS[drawn_with].cost.powf(device.bias);
            now += took.max(1.0 / 60.0);
            quality.drawn(begun, took);
            all.push((now, took, drawn_with));
        }
        all
    }

    #[test]
    fn a_slow_device_flies_at_fifteen_frames_a_second_and_rests_in_full() {
        // Estimates are off by as much as devices differ: where pixels cost nothing, and where they cost all.
        for bias in [0.8, 1.0, 1.3] {
            let device = Device { full_s: 0.4, bias };
            let mut quality = Quality::new(false);
            let all = frames(&device, &mut quality);
            let flying: Vec<_> = all.iter().filter(|(at, ..)| (2.5..5.0).contains(at)).collect();
            assert!(flying.iter().all(|(_, took, _)| *took <= 1.0 / LEAST_FPS), "{bias}: {flying:?}");
            let first = all.iter().find(|(at, took, _)| *at - took >= 1.0).expect("it moves");
            assert!(first.2 > 1, "{bias}: the first frame under way is drawn in full: {first:?}");
            let changes = flying.windows(2).filter(|pair| pair[0].2 != pair[1].2).count();
            assert!(changes <= 1, "{bias}: quality goes to and fro: {flying:?}");
            let rest: Vec<usize> = all.iter().filter(|(at, ..)| *at > 5.3).map(|(.., step)| *step).collect();
            assert!(rest.is_sorted_by(|a, b| a >= b) && quality.is_full(), "{bias}: {rest:?}");
        }
    }

    #[test]
    fn a_fast_device_never_gives_anything_up() {
        let mut quality = Quality::new(false);
        assert!(
            frames(&Device { full_s: 0.01, bias: 1.0 }, &mut quality).iter().all(|(.., step)| *step == 0)
        );
    }

    #[test]
    fn a_device_known_to_be_slow_begins_with_its_fastest_frame_and_ends_in_full() {
        let mut quality = Quality::new(true);
        assert_eq!(quality.due(Duration::ZERO), Some(Duration::ZERO));
        let mut steps = vec![quality.step];
        for frame in 1..=3 {
            quality.drawn(Duration::from_secs(frame), 0.1);
            steps.push(quality.step);
        }
        assert_eq!(steps, [9, 4, 2, 0]);
        assert_eq!(quality.due(Duration::from_secs(9)), None);
    }

    /// A part of the quality by its name, and whether a step gives it up.
    type Part = (&'static str, fn(&Step) -> bool);

    /// The order in which parts begin to be given up.
    const PARTS: [Part; 9] = [
        ("scale", |step| step.render_scale < 1.0),
        ("cascades", |step| step.cascades < 4),
        ("temporal", |step| step.anti_aliasing < AntiAliasing::Temporal),
        ("edges", |step| step.anti_aliasing == AntiAliasing::None),
        ("samples", |step| step.samples < 16),
        ("punctual lights", |step| step.punctual_lights < MAX_LIGHTS as u32),
        ("occlusion", |step| step.samples == 0),
        ("fewest punctual lights", |step| step.punctual_lights < 64),
        ("relief", |step| !step.of(&Settings::default()).relief),
    ];

    /// A camera that keeps moving on a device of which each frame in full takes `factor` of the time of that before, from
    /// `full_s` on: the steps taken.
    fn drift(quality: &mut Quality, full_s: f64, factor: f64, frames: i32) -> Vec<usize> {
        let mut now = 0.0;
        (0..frames)
            .map(|frame| {
                let took = full_s * factor.powi(frame) * quality.step().cost;
                quality.moved(Duration::from_secs_f64(now));
                quality.drawn(Duration::from_secs_f64(now), took);
                now += took;
                quality.step
            })
            .collect()
    }

    /// How many parts of the order a step gives up, from the first on.
    fn parts(step: usize) -> usize {
        let given_up: Vec<bool> = PARTS.iter().map(|(_, is)| is(&STEPS[step])).collect();
        assert!(
            given_up.is_sorted_by(|a, b| a >= b),
            "step {step} leaves one out: {given_up:?} of {PARTS:?}"
        );
        given_up.into_iter().filter(|is| *is).count()
    }

    #[test]
    fn a_device_that_gets_slower_takes_each_step_and_one_that_gets_faster_takes_them_back() {
        let mut quality = Quality::new(false);
        let down = drift(&mut quality, 0.05, 1.03, 200);
        assert!(down.is_sorted() && (0..STEPS.len()).all(|step| down.contains(&step)), "{down:?}");
        assert!(down.iter().map(|step| parts(*step)).is_sorted());
        assert_eq!(parts(quality.step), PARTS.len());
        let up = drift(&mut quality, 0.05 * 1.03_f64.powi(200), 0.99, 900);
        assert!(up.is_sorted_by(|a, b| a >= b) && quality.is_full(), "{up:?}");
        // One at a time: in the reverse order.
        assert!(up.windows(2).all(|pair| pair[0] - pair[1] <= 1), "{up:?}");
        assert!(up.iter().map(|step| parts(*step)).is_sorted_by(|a, b| a >= b));
    }

    #[test]
    fn a_camera_that_rests_gets_parts_back_in_the_reverse_order() {
        let mut quality = Quality::new(true);
        let mut given_up = vec![parts(quality.step)];
        for frame in 1..=4 {
            quality.drawn(Duration::from_secs(frame), 0.5);
            given_up.push(parts(quality.step));
        }
        assert!(given_up.is_sorted_by(|a, b| a >= b) && given_up.last() == Some(&0), "{given_up:?}");
    }

    /// Times about the bound do not move a step up and down: up takes far less time than down allows.
    #[test]
    fn frames_that_take_now_more_and_now_less_keep_their_step() {
        for full_s in [0.12, 0.2, 0.33, 0.5] {
            let (mut quality, mut now) = (Quality::new(false), 0.0);
            let mut steps = Vec::new();
            for frame in 0..400 {
                let noise = [1.0, 1.12, 0.9, 0.85, 1.05][frame % 5];
                let took = full_s * noise * quality.step().cost;
                quality.moved(Duration::from_secs_f64(now));
                quality.drawn(Duration::from_secs_f64(now), took);
                now += took;
                steps.push(quality.step);
            }
            let settled = &steps[20..];
            assert!(settled.iter().all(|step| step == &settled[0]), "{full_s}: {steps:?}");
        }
    }

    #[test]
    fn edges_are_smoothed_over_time_then_in_one_frame_then_not_by_how_long_frames_take() {
        let temporal = Settings { anti_aliasing: AntiAliasing::Temporal, ..Settings::default() };
        let mut quality = Quality::new(false);
        let mut ways: Vec<AntiAliasing> = drift(&mut quality, 0.05, 1.03, 200)
            .into_iter()
            .map(|step| STEPS[step].of(&temporal).anti_aliasing)
            .collect();
        ways.dedup();
        assert_eq!(ways, [AntiAliasing::Temporal, AntiAliasing::Spatial, AntiAliasing::None]);
    }

    #[test]
    fn what_is_given_up_is_said() {
        let mut quality = Quality::new(true);
        assert_eq!(
            quality.describe(),
            "step 9 of 9: ground 16× as coarse, shadows up to 12 frames late, 25 % of the pixels' sides, 2 shadow \
             maps, edges not smoothed, meshes 4× as coarse, no occlusion, the 16 brightest punctual_lights, maps of 1024 texels \
             a side, no relief"
        );
        quality.step = 7;
        assert!(quality.describe().ends_with("meshes 2× as coarse, 4 samples of occlusion"));
        quality.step = 0;
        assert_eq!(quality.describe(), "full");
        // Steps that are nearer to each other would be jumped over.
        assert!(STEPS.windows(2).all(|pair| pair[0].cost * AIM_S * LEAST_FPS > pair[1].cost));
    }
}
