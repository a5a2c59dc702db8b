//! What a slow device gives up of a frame, step by step: the one table that frames, the overlay's text and
//! `docs/design/drawing.md` go by.

use lodestream_render::{AmbientOcclusion, AntiAliasing, LightCulling, Settings, Shadows};

/// What is left of the quality with a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::window) struct Step {
    /// Factor on the ground's screen error.
    pub(in crate::window) ground: f32,
    /// Frames for which a map of shadows may show things as they were.
    pub(in crate::window) late_shadows: u32,
    /// Share of the picture's sides in which it is drawn.
    pub(in crate::window) render_scale: f32,
    /// Most cascades of shadows.
    pub(in crate::window) cascades: u32,
    /// Steps by which each of their maps follows the eye, along its side.
    pub(super) map_steps: u32,
    /// The best way in which edges are smoothed.
    pub(in crate::window) anti_aliasing: AntiAliasing,
    /// Factor on the meshes' screen error.
    pub(in crate::window) meshes: f32,
    /// Most samples of ambient occlusion per pixel; 0 is none.
    pub(in crate::window) samples: u32,
    /// Most punctual lights: those that are brightest on the screen.
    pub(in crate::window) punctual_lights: u32,
    /// Most texels along a side of each map of shadows.
    pub(super) map_side: u32,
    /// Whether height maps are honoured.
    pub(super) relief: bool,
    /// Time of a frame over that of the first step, roughly: what decides is measured after the step was taken.
    pub(super) cost: f64,
}

/// Nothing given up.
pub(in crate::window) const FULL: Step = Step {
    ground: 1.0,
    late_shadows: 0,
    render_scale: 1.0,
    cascades: u32::MAX,
    map_steps: u32::MAX,
    anti_aliasing: AntiAliasing::Temporal,
    meshes: 1.0,
    samples: u32::MAX,
    punctual_lights: u32::MAX,
    map_side: u32::MAX,
    relief: true,
    cost: 1.0,
};

const UNSEEN: Step = Step { ground: 4.0, late_shadows: 12, cost: 0.75, ..FULL };
const SMALLER: Step = Step { render_scale: 0.7, cost: 0.45, ..UNSEEN };
const HALF: Step = Step { render_scale: 0.5, ground: 8.0, cost: 0.28, ..SMALLER };
const TWO_MAPS: Step = Step { cascades: 2, map_steps: 4, cost: 0.23, ..HALF };
const ONE_FRAME: Step = Step { anti_aliasing: AntiAliasing::Spatial, cost: 0.19, ..TWO_MAPS };
const STAIRS: Step = Step { anti_aliasing: AntiAliasing::None, meshes: 2.0, cost: 0.16, ..ONE_FRAME };
const FEW_SAMPLES: Step = Step { samples: 4, render_scale: 0.35, cost: 0.13, ..STAIRS };
const FEW_PUNCTUAL_LIGHTS: Step = Step { punctual_lights: 64, cost: 0.107, ..FEW_SAMPLES };
const FASTEST: Step = Step {
    render_scale: 0.25,
    ground: 16.0,
    meshes: 4.0,
    samples: 0,
    punctual_lights: 16,
    map_side: 1024,
    relief: false,
    cost: 0.087,
    ..FEW_PUNCTUAL_LIGHTS
};

/// From the best on; each gives up what those before it do. Quality begins to be given up in this order: the ground's
/// error and how soon shadows follow what casts them, which are seen least; pixels; cascades of shadows; edges smoothed
/// over time, then at all, with the meshes' error, whose chunks have to be undone and applied again; samples of occlusion;
/// punctual lights; at last all of occlusion, relief, which is finer than the pixels then, and texels of shadows.
pub(super) const STEPS: [Step; 10] =
    [FULL, UNSEEN, SMALLER, HALF, TWO_MAPS, ONE_FRAME, STAIRS, FEW_SAMPLES, FEW_PUNCTUAL_LIGHTS, FASTEST];

impl Step {
    /// What is left of a user's settings, but for how late shadows may be.
    pub(in crate::window) fn of(&self, settings: &Settings) -> Settings {
        let occlusion = settings.occlusion.filter(|_| self.samples > 0);
        Settings {
            render_scale: self.render_scale,
            anti_aliasing: settings.anti_aliasing.min(self.anti_aliasing),
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
            lights: settings
                .lights
                .map(|lights| LightCulling { most: lights.most.min(self.punctual_lights), ..lights }),
            ..*settings
        }
    }

    /// All that is given up, in words, in the order in which it begins to be.
    pub(super) fn given_up(&self) -> Vec<String> {
        let error =
            |what: &str, factor: f32| (factor > 1.0).then(|| format!("{what} {factor:.0}× as coarse"));
        let parts = [
            error("ground", self.ground),
            (self.late_shadows > 0).then(|| format!("shadows up to {} frames late", self.late_shadows)),
            (self.render_scale < 1.0)
                .then(|| format!("{:.0} % of the pixels' sides", self.render_scale * 100.0)),
            (self.cascades < u32::MAX).then(|| format!("{} shadow maps", self.cascades)),
            match self.anti_aliasing {
                AntiAliasing::Temporal => None,
                AntiAliasing::Spatial => Some("edges smoothed in one frame".to_owned()),
                AntiAliasing::None => Some("edges not smoothed".to_owned()),
            },
            error("meshes", self.meshes),
            match self.samples {
                0 => Some("no occlusion".to_owned()),
                u32::MAX => None,
                some => Some(format!("{some} samples of occlusion")),
            },
            (self.punctual_lights < u32::MAX)
                .then(|| format!("the {} brightest punctual lights", self.punctual_lights)),
            (self.map_side < u32::MAX).then(|| format!("maps of {} texels a side", self.map_side)),
            (!self.relief).then(|| "no relief".to_owned()),
        ];
        parts.into_iter().flatten().collect()
    }
}

/// Settings that are drawn with along the way down from a user's, the best first.
pub(in crate::window) fn all_of(settings: &Settings) -> Vec<Settings> {
    STEPS.iter().map(|step| step.of(settings)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use lodestream_render::MAX_LIGHTS;

    /// What the documents say of a step: what it gives up that the one before did not, or not as far.
    fn row(number: usize) -> String {
        let before = STEPS[number - 1].given_up();
        let new: Vec<String> =
            STEPS[number].given_up().into_iter().filter(|part| !before.contains(part)).collect();
        format!("| {number} | {} | {:.0} % |", new.join(", "), STEPS[number].cost * 100.0)
    }

    #[test]
    fn the_document_has_the_steps_of_this_table_in_their_order() {
        let page = concat!(env!("CARGO_MANIFEST_DIR"), "/../docs/design/drawing.md");
        let page = std::fs::read_to_string(page).unwrap();
        let table: Vec<String> = (1..STEPS.len()).map(row).collect();
        let table = format!("|---|---|---|\n{}\n", table.join("\n"));
        assert!(page.contains(&table), "docs/design/drawing.md lacks:\n{table}");
    }

    /// The order that was asked for.
    #[test]
    fn scale_cascades_anti_aliasing_samples_and_punctual_lights_begin_to_be_given_up_in_this_order() {
        let first = |given_up: fn(&Step) -> bool| STEPS.iter().position(given_up).unwrap();
        let order = [
            first(|step| step.render_scale < 1.0),
            first(|step| step.cascades < 4),
            first(|step| step.anti_aliasing == AntiAliasing::Spatial),
            first(|step| step.anti_aliasing == AntiAliasing::None),
            first(|step| step.samples < 16),
            first(|step| step.punctual_lights < MAX_LIGHTS as u32),
            first(|step| step.samples == 0),
        ];
        assert!(order.is_sorted_by(|a, b| a < b), "{order:?}");
    }

    #[test]
    fn what_is_given_up_grows_from_step_to_step() {
        for [before, after] in STEPS.windows(2).map(|pair| [pair[0], pair[1]]) {
            assert!(before.render_scale >= after.render_scale && before.ground <= after.ground);
            assert!(before.meshes <= after.meshes && before.late_shadows <= after.late_shadows);
            assert!(before.cascades >= after.cascades && before.map_steps >= after.map_steps);
            assert!(before.map_side >= after.map_side && before.anti_aliasing >= after.anti_aliasing);
            assert!(before.samples >= after.samples && before.punctual_lights >= after.punctual_lights);
            assert!(before.relief >= after.relief && before.cost > after.cost);
            assert_ne!(before.given_up(), after.given_up());
        }
    }

    #[test]
    fn what_the_user_chose_is_never_raised() {
        let least = Settings {
            anti_aliasing: AntiAliasing::None,
            occlusion: None,
            shadows: None,
            relief: false,
            lights: Some(LightCulling { most: 1, ..LightCulling::default() }),
            ..Settings::default()
        };
        for (step, left) in STEPS.iter().zip(all_of(&least)) {
            assert_eq!(left, Settings { render_scale: step.render_scale, ..least });
        }
        let usual = Settings { anti_aliasing: AntiAliasing::Temporal, ..Settings::default() };
        assert_eq!(FULL.of(&usual), usual);
    }
}
