//! How well a frame is drawn while the camera moves: as well as the device can at [`LEAST_FPS`], and in full once it
//! rests.

use std::time::Duration;

use lodestream_render::{AmbientOcclusion, AntiAliasing, Settings, Shadows};

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

/// What of the quality a step gives up.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Step {
    /// Share of the picture's sides in which it is drawn.
    pub(super) render_scale: f32,
    /// Factor on the ground's screen error.
    pub(super) ground: f32,
    /// Factor on the meshes' screen error.
    pub(super) meshes: f32,
    /// Frames for which a map of shadows may show things as they were.
    pub(super) late_shadows: u32,
    /// Most cascades of shadows.
    pub(super) cascades: u32,
    /// Steps by which each of their maps follows the eye, along its side.
    map_steps: u32,
    /// Most texels along a side of each of their maps.
    map_side: u32,
    /// Whether edges are smoothed, where the picture is not enlarged.
    pub(super) antialias: bool,
    /// Most samples of ambient occlusion per pixel; 0 is none.
    pub(super) samples: u32,
    /// Whether height maps are honoured.
    relief: bool,
    /// Time of a frame over that of the first step, roughly: what decides is measured after the step was taken.
    cost: f64,
}

impl Step {
    /// What is left of a user's settings, but for how late shadows may be.
    pub(super) fn of(&self, settings: &Settings) -> Settings {
        let occlusion = settings.occlusion.filter(|_| self.samples > 0);
        Settings {
            render_scale: self.render_scale,
            anti_aliasing: if self.antialias { settings.anti_aliasing } else { AntiAliasing::None },
            occlusion: occlusion.map(|occlusion| AmbientOcclusion {
                samples: occlusion.samples.min(self.samples),
                ..occlusion
            }),
            relief: settings.relief && self.relief,
            shadows: settings.shadows.map(|shadows| Shadows {
                cascades: shadows.cascades.min(self.cascades),
                steps: shadows.steps.min(self.map_steps),
                map_side: shadows.map_side.min(self.map_side),
                ..shadows
            }),
            ..*settings
        }
    }
}

/// Nothing given up.
pub(super) const FULL: Step = Step {
    render_scale: 1.0,
    ground: 1.0,
    meshes: 1.0,
    late_shadows: 0,
    cascades: u32::MAX,
    map_steps: u32::MAX,
    map_side: u32::MAX,
    antialias: true,
    samples: u32::MAX,
    relief: true,
    cost: 1.0,
};

const UNSEEN: Step = Step { ground: 4.0, late_shadows: 12, cost: 0.75, ..FULL };
const SMALLER: Step = Step { render_scale: 0.7, cost: 0.45, ..UNSEEN };
const HALF: Step = Step { render_scale: 0.5, ground: 8.0, cost: 0.28, ..SMALLER };
const TWO_MAPS: Step = Step { cascades: 2, map_steps: 4, cost: 0.23, ..HALF };
const STAIRS: Step = Step { render_scale: 0.35, meshes: 2.0, antialias: false, cost: 0.17, ..TWO_MAPS };
const FEW_SAMPLES: Step = Step { samples: 4, cost: 0.14, ..STAIRS };
const FASTEST: Step = Step {
    render_scale: 0.25,
    ground: 16.0,
    meshes: 4.0,
    map_side: 1024,
    samples: 0,
    relief: false,
    cost: 0.1,
    ..FEW_SAMPLES
};

/// From the best on. Quality begins to be given up in this order: the ground's error and how soon shadows follow what
/// casts them, which are seen least; pixels; cascades of shadows; smoothed edges, which an enlarged picture lacks
/// already, and the meshes' error, whose chunks have to be undone and applied again; samples of occlusion, at last all
/// of them, relief, which is finer than the pixels then, and texels of shadows.
const STEPS: [Step; 8] = [FULL, UNSEEN, SMALLER, HALF, TWO_MAPS, STAIRS, FEW_SAMPLES, FASTEST];

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
        let step = self.step();
        let Step { render_scale, ground, meshes, late_shadows, cascades, antialias, samples, .. } = step;
        if self.is_full() {
            return "full".into();
        }
        let mut text = format!("step {} of {}: ", self.step, STEPS.len() - 1);
        let scale =
            (render_scale < 1.0).then(|| format!("{:.0} % of the pixels' sides", render_scale * 100.0));
        let error =
            |what: &str, factor: f32| (factor > 1.0).then(|| format!("{what} {factor:.0}× as coarse"));
        let occlusion = match samples {
            0 => Some("no occlusion".to_owned()),
            u32::MAX => None,
            some => Some(format!("{some} samples of occlusion")),
        };
        let parts = [
            scale,
            error("ground", ground),
            error("meshes", meshes),
            (late_shadows > 0).then(|| format!("shadows up to {late_shadows} frames late")),
            (cascades < u32::MAX).then(|| format!("{cascades} shadow maps")),
            (step.map_side < u32::MAX).then(|| format!("of {} texels a side", step.map_side)),
            (!antialias).then(|| "edges not smoothed".to_owned()),
            occlusion,
            (!step.relief).then(|| "no relief".to_owned()),
        ];
        text.push_str(&parts.into_iter().flatten().collect::<Vec<_>>().join(", "));
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
        assert_eq!(steps, [7, 3, 1, 0]);
        assert_eq!(quality.due(Duration::from_secs(9)), None);
    }

    /// The order in which a device that gets slower and slower gives things up, by virtual time.
    #[test]
    fn scale_cascades_edges_samples_and_relief_are_given_up_in_this_order() {
        let (mut quality, mut now) = (Quality::new(false), 0.0);
        let mut given_up: Vec<&str> = Vec::new();
        let mut steps = vec![0];
        for frame in 0..200 {
            // Each frame in full takes 3 % more than the one before.
            let took = 0.05 * 1.03_f64.powi(frame) * quality.step().cost;
            quality.moved(Duration::from_secs_f64(now));
            quality.drawn(Duration::from_secs_f64(now), took);
            now += took;
            let step = quality.step();
            steps.push(quality.step);
            for (what, is) in [
                ("scale", step.render_scale < 1.0),
                ("cascades", step.cascades < 4),
                ("edges", !step.antialias),
                ("samples", step.samples < 16),
                ("occlusion", step.samples == 0),
                ("relief", !step.relief),
            ] {
                if is && !given_up.contains(&what) {
                    given_up.push(what);
                }
            }
        }
        assert_eq!(given_up, ["scale", "cascades", "edges", "samples", "occlusion", "relief"]);
        assert!(steps.is_sorted() && (0..STEPS.len()).all(|step| steps.contains(&step)), "{steps:?}");
    }

    #[test]
    fn what_is_given_up_grows_from_step_to_step_and_is_said() {
        for pair in STEPS.windows(2) {
            assert!(pair[0].render_scale >= pair[1].render_scale && pair[0].ground <= pair[1].ground);
            // Steps that are nearer to each other would be jumped over.
            assert!(pair[0].meshes <= pair[1].meshes && pair[0].cost * AIM_S * LEAST_FPS > pair[1].cost);
            assert!(pair[0].cascades >= pair[1].cascades && pair[0].samples >= pair[1].samples);
            assert!(pair[0].antialias >= pair[1].antialias && pair[0].late_shadows <= pair[1].late_shadows);
            assert!(pair[0].relief >= pair[1].relief && pair[0].map_side >= pair[1].map_side);
            assert!(pair[0].map_steps >= pair[1].map_steps);
        }
        let mut quality = Quality::new(true);
        let fastest = quality.describe();
        assert!(
            fastest.contains("step 7 of 7: 25 % of the pixels' sides, ground 16× as coarse"),
            "{fastest}"
        );
        assert!(
            fastest.ends_with(
                "2 shadow maps, of 1024 texels a side, edges not smoothed, no occlusion, no relief"
            ),
            "{fastest}"
        );
        quality.step = 6;
        assert!(quality.describe().ends_with("edges not smoothed, 4 samples of occlusion"));
        quality.step = 0;
        assert_eq!(quality.describe(), "full");
    }
}
