//! Adaptive quality: while the camera moves, frames are drawn as well as the device can at a frame rate; once it rests, at
//! full quality.

mod table;

use std::time::Duration;

pub use table::{FULL, STEPS, Step, limited_settings};

/// Frames a second while the camera moves, unless the user chooses: of a software driver, and of a graphics processor.
const SOFTWARE_FPS: f64 = 30.0;
const PROCESSOR_FPS: f64 = 60.0;
/// Target time of a frame over the time that the frame rate leaves, since frames differ.
const TARGET: f64 = 0.85;
/// A graphics processor's frames wait for the screen: they count as late if they take this much longer than the frame rate
/// leaves, so that the screen missed one.
const WAITED: f64 = 1.25;
/// A finer step is taken while moving if it is estimated to fit into this share of the target time for
/// [`HEADROOM_FRAMES`].
const HEADROOM: f64 = 0.6;
/// Frames in a row with headroom before a finer step is taken.
const HEADROOM_FRAMES: u32 = 8;
/// Frames by which shadows may be out of date while more of the scene arrives.
const LATE_WHILE_STREAMING: u32 = 3;
/// Time without movement after which the camera counts as resting.
const REST: Duration = Duration::from_millis(200);

/// Chooses each frame's step of quality by the measured time of frames.
#[derive(Clone, Debug)]
pub struct Quality {
    step: usize,
    /// Target time of a frame, and the time above which it is late, in seconds.
    target_s: f64,
    late_s: f64,
    moved_at: Option<Duration>,
    /// Estimated time of a frame at full quality, in seconds, from the last frame and the table's costs.
    full_s: f64,
    /// Frames in a row with headroom for a finer step.
    headroom_frames: u32,
}

impl Quality {
    /// For a software driver the first frames are drawn at the lowest quality, for others at full quality. `fps`: frames a
    /// second to aim for, positive; by default 30 for a software driver, else 60.
    pub fn new(software: bool, fps: Option<f64>) -> Self {
        let frame_s = 1.0 / fps.unwrap_or(if software { SOFTWARE_FPS } else { PROCESSOR_FPS });
        Self {
            step: if software { STEPS.len() - 1 } else { 0 },
            target_s: TARGET * frame_s,
            late_s: if software { frame_s } else { WAITED * frame_s },
            moved_at: None,
            full_s: 0.0,
            headroom_frames: 0,
        }
    }

    /// Records a movement of the camera. After a rest, the step is chosen from the estimate, so that not even the first
    /// frame is slow.
    pub fn moved(&mut self, now: Duration) {
        if !self.is_moving(now) && self.full_s * self.step().cost > self.late_s {
            self.step = self.fast_enough().max(self.step);
        }
        self.moved_at = Some(now);
    }

    /// Whether the camera counts as moving.
    pub fn is_moving(&self, now: Duration) -> bool {
        self.moved_at.is_some_and(|at| now < at + REST)
    }

    /// Records a frame of the scene that took `frame_s` seconds. Whether the camera moves is judged at its beginning
    /// (`begun`), since a slow frame outlasts a rest.
    pub fn drawn(&mut self, begun: Duration, frame_s: f64) {
        self.full_s = frame_s / self.step().cost;
        if !self.is_moving(begun) {
            // Restores two steps at once, or half of those left, since the user waits for each of these frames.
            self.step = self.step.saturating_sub(2).min(self.step / 2);
            self.headroom_frames = 0;
            return;
        }
        if frame_s > self.late_s {
            // One step faster, or more if the estimate says so.
            self.step = self.fast_enough().max((self.step + 1).min(STEPS.len() - 1));
            self.headroom_frames = 0;
        } else if self.step > 0 && self.full_s * STEPS[self.step - 1].cost <= HEADROOM * self.target_s {
            self.headroom_frames += 1;
            if self.headroom_frames >= HEADROOM_FRAMES {
                self.step -= 1;
                self.headroom_frames = 0;
            }
        } else {
            self.headroom_frames = 0;
        }
    }

    /// The best step that is estimated to be fast enough; the last one if none is.
    fn fast_enough(&self) -> usize {
        STEPS.iter().position(|step| self.full_s * step.cost <= self.target_s).unwrap_or(STEPS.len() - 1)
    }

    /// The next frame's step.
    pub const fn step(&self) -> Step {
        STEPS[self.step]
    }

    /// The next frame's cost relative to full quality, from the table.
    #[must_use]
    pub const fn cost(&self) -> f64 {
        self.step().cost
    }

    /// Frames by which shadow maps may be out of date while more of the scene arrives: more than 0 on a device that is
    /// too slow to draw them anew each time.
    pub fn late_shadows(&self) -> u32 {
        if self.full_s > self.late_s { LATE_WHILE_STREAMING } else { 0 }
    }

    /// Time until another frame improves the quality: at once or when the camera counts as resting; `None` at full
    /// quality.
    pub fn due(&self, now: Duration) -> Option<Duration> {
        if self.step == 0 {
            return None;
        }
        Some(self.moved_at.map_or(Duration::ZERO, |at| (at + REST).saturating_sub(now)))
    }

    /// Whether frames are drawn at full quality.
    pub const fn is_full(&self) -> bool {
        self.step == 0
    }

    /// Text for the overlay.
    pub fn describe(&self) -> String {
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

    /// A device that takes `full_s` for a frame at full quality; costs of other steps are the table's to the power of
    /// `bias`.
    struct Device {
        full_s: f64,
        bias: f64,
    }

    /// A software driver that begins at full quality.
    fn from_full(fps: f64) -> Quality {
        Quality { step: 0, ..Quality::new(true, Some(fps)) }
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
            now += took.max(1.0 / 120.0);
            quality.drawn(begun, took);
            all.push((now, took, drawn_with));
        }
        all
    }

    #[test]
    fn a_slow_device_flies_at_the_frame_rate_and_rests_in_full() {
        // The costs of steps differ between devices: from those whose time does not depend on pixels to those where it
        // does.
        for (fps, bias) in
            [15.0, 30.0, 60.0].into_iter().flat_map(|fps| [0.8, 1.0, 1.3].map(|bias| (fps, bias)))
        {
            let device = Device { full_s: 6.0 / fps, bias };
            let mut quality = from_full(fps);
            let all = frames(&device, &mut quality);
            let flying: Vec<_> = all.iter().filter(|(at, ..)| (2.5..5.0).contains(at)).collect();
            assert!(flying.iter().all(|(_, took, _)| *took <= 1.0 / fps), "{fps}, {bias}: {flying:?}");
            let first = all.iter().find(|(at, took, _)| *at - took >= 1.0).expect("it moves");
            assert!(first.2 > 1, "{fps}, {bias}: the first moving frame is drawn at full quality: {first:?}");
            let changes = flying.windows(2).filter(|pair| pair[0].2 != pair[1].2).count();
            assert!(changes <= 1, "{fps}, {bias}: quality oscillates: {flying:?}");
            let rest: Vec<usize> = all.iter().filter(|(at, ..)| *at > 5.3).map(|(.., step)| *step).collect();
            assert!(rest.is_sorted_by(|a, b| a >= b) && quality.is_full(), "{fps}, {bias}: {rest:?}");
        }
    }

    #[test]
    fn a_fast_device_always_draws_at_full_quality() {
        let mut quality = Quality::new(false, None);
        assert!(
            frames(&Device { full_s: 0.01, bias: 1.0 }, &mut quality).iter().all(|(.., step)| *step == 0)
        );
    }

    /// Frames that wait for a screen of the frame rate are a little late each time.
    #[test]
    fn frames_that_wait_for_the_screen_are_not_late() {
        let mut quality = Quality::new(false, None);
        let begun = Duration::from_secs(1);
        for number in 0..100 {
            quality.moved(begun);
            quality.drawn(begun, if number % 2 == 0 { 1.1 } else { 0.9 } / PROCESSOR_FPS);
        }
        assert!(quality.is_full());
        quality.drawn(begun, 2.0 / PROCESSOR_FPS);
        assert!(!quality.is_full());
    }

    #[test]
    fn a_device_known_to_be_slow_begins_with_its_fastest_frame_and_ends_in_full() {
        let mut quality = Quality::new(true, None);
        assert_eq!(quality.due(Duration::ZERO), Some(Duration::ZERO));
        let mut steps = vec![quality.step];
        for frame in 1..=3 {
            quality.drawn(Duration::from_secs(frame), 0.1);
            steps.push(quality.step);
        }
        assert_eq!(steps, [10, 5, 2, 0]);
        assert_eq!(quality.due(Duration::from_secs(9)), None);
    }

    /// A reduction by its name, and whether a step makes it.
    type Part = (&'static str, fn(&Step) -> bool);

    /// Reductions in the order in which steps begin to make them.
    const PARTS: [Part; 9] = [
        ("scale", |step| step.render_scale < 1.0),
        ("cascades", |step| step.cascades < 4),
        ("temporal", |step| step.anti_aliasing < AntiAliasing::Temporal),
        ("edges", |step| step.anti_aliasing == AntiAliasing::None),
        ("samples", |step| step.samples < 16),
        ("punctual lights", |step| step.punctual_lights < MAX_LIGHTS as u32),
        ("occlusion", |step| step.samples == 0),
        ("fewest punctual lights", |step| step.punctual_lights < 64),
        ("relief", |step| !step.limit(&Settings::default()).relief),
    ];

    /// The steps of a camera that keeps moving on a device whose frames at full quality take `full_s` at first, and
    /// each
    /// `factor` times as long as the one before.
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

    /// Number of reductions that a step makes; they must be the first ones.
    fn parts(step: usize) -> usize {
        let given_up: Vec<bool> = PARTS.iter().map(|(_, is)| is(&STEPS[step])).collect();
        assert!(
            given_up.is_sorted_by(|a, b| a >= b),
            "step {step} makes them out of order: {given_up:?} of {PARTS:?}"
        );
        given_up.into_iter().filter(|is| *is).count()
    }

    #[test]
    fn a_device_that_gets_slower_takes_each_step_and_one_that_gets_faster_takes_them_back() {
        let mut quality = from_full(15.0);
        let down = drift(&mut quality, 0.05, 1.03, 200);
        assert!(down.is_sorted() && (0..STEPS.len()).all(|step| down.contains(&step)), "{down:?}");
        assert!(down.iter().map(|step| parts(*step)).is_sorted());
        assert_eq!(parts(quality.step), PARTS.len());
        let up = drift(&mut quality, 0.05 * 1.03_f64.powi(200), 0.99, 900);
        assert!(up.is_sorted_by(|a, b| a >= b) && quality.is_full(), "{up:?}");
        // One step at a time, in the reverse order.
        assert!(up.windows(2).all(|pair| pair[0] - pair[1] <= 1), "{up:?}");
        assert!(up.iter().map(|step| parts(*step)).is_sorted_by(|a, b| a >= b));
    }

    #[test]
    fn a_camera_that_rests_gets_parts_back_in_the_reverse_order() {
        let mut quality = Quality::new(true, None);
        let mut given_up = vec![parts(quality.step)];
        for frame in 1..=4 {
            quality.drawn(Duration::from_secs(frame), 0.5);
            given_up.push(parts(quality.step));
        }
        assert!(given_up.is_sorted_by(|a, b| a >= b) && given_up.last() == Some(&0), "{given_up:?}");
    }

    /// Frame times near the bound do not change the step back and forth: a finer step needs a much shorter time than
    /// the bound for a coarser one.
    #[test]
    fn frame_times_around_the_bound_keep_the_step() {
        for full_s in [0.12, 0.2, 0.33, 0.5] {
            let (mut quality, mut now) = (from_full(15.0), 0.0);
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
    fn anti_aliasing_is_reduced_as_frame_times_grow() {
        let temporal = Settings { anti_aliasing: AntiAliasing::Temporal, ..Settings::default() };
        let mut quality = from_full(15.0);
        let mut ways: Vec<AntiAliasing> = drift(&mut quality, 0.05, 1.03, 200)
            .into_iter()
            .map(|step| STEPS[step].limit(&temporal).anti_aliasing)
            .collect();
        ways.dedup();
        assert_eq!(ways, [AntiAliasing::Temporal, AntiAliasing::Spatial, AntiAliasing::None]);
    }

    #[test]
    fn the_description_lists_what_is_given_up() {
        let mut quality = Quality::new(true, None);
        assert_eq!(
            quality.describe(),
            "step 10 of 10: ground 16× as coarse, shadows up to 12 frames late, 20 % of the pixels' sides, 2 shadow \
             maps, edges not smoothed, meshes 16× as coarse, textures softer at grazing angles, no occlusion, the 16 brightest punctual lights, maps of 1024 texels \
             a side, no relief"
        );
        quality.step = 7;
        assert!(quality.describe().ends_with("textures softer at grazing angles, 4 samples of occlusion"));
        quality.step = 0;
        assert_eq!(quality.describe(), "full");
        // Steps with more similar costs would be skipped.
        assert!(STEPS.windows(2).all(|pair| pair[0].cost * TARGET > pair[1].cost));
    }
}
