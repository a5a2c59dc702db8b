//! Steps of quality for slow devices: the one table that frames, the overlay and `docs/design/drawing.md` use.

use lodestream_render::{AmbientOcclusion, AntiAliasing, LightCulling, Settings, Shadows};

/// Limits that a step of quality sets.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Step {
    /// Factor on the terrain's screen error.
    pub ground: f32,
    /// Frames by which a shadow map may be out of date.
    pub late_shadows: u32,
    /// Factor on width and height of the drawn picture.
    pub render_scale: f32,
    /// Most shadow cascades.
    pub cascades: u32,
    /// Steps along a side by which each shadow map follows the eye.
    pub map_steps: u32,
    /// Best anti-aliasing.
    pub anti_aliasing: AntiAliasing,
    /// Factor on the meshes' screen error.
    pub meshes: f32,
    /// Most samples of ambient occlusion per pixel; 0 is none.
    pub samples: u32,
    /// Most punctual lights, the brightest on the screen first.
    pub punctual_lights: u32,
    /// Most texels along a side of each shadow map.
    pub map_side: u32,
    /// Whether relief mapping is drawn.
    pub relief: bool,
    /// Most texture lookups along a pixel's footprint.
    pub anisotropy: u32,
    /// Approximate time of a frame relative to the first step; decisions use times measured with the step.
    pub cost: f64,
}

/// Full quality.
pub const FULL: Step = Step {
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
    anisotropy: u32::MAX,
    cost: 1.0,
};

const LATE_SHADOWS: Step = Step { ground: 4.0, late_shadows: 12, cost: 0.75, ..FULL };
const SCALE_70: Step = Step { render_scale: 0.7, cost: 0.45, ..LATE_SHADOWS };
const SCALE_50: Step = Step { render_scale: 0.5, ground: 8.0, cost: 0.28, ..SCALE_70 };
const TWO_CASCADES: Step = Step { cascades: 2, map_steps: 4, cost: 0.23, ..SCALE_50 };
const SPATIAL_AA: Step = Step { anti_aliasing: AntiAliasing::Spatial, cost: 0.19, ..TWO_CASCADES };
const NO_AA: Step =
    Step { anti_aliasing: AntiAliasing::None, meshes: 2.0, anisotropy: 1, cost: 0.16, ..SPATIAL_AA };
const FEW_SAMPLES: Step = Step { samples: 4, render_scale: 0.35, cost: 0.13, ..NO_AA };
const FEW_PUNCTUAL_LIGHTS: Step = Step { punctual_lights: 64, cost: 0.107, ..FEW_SAMPLES };
const FEW_PIXELS: Step = Step {
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
const FASTEST: Step = Step { render_scale: 0.2, meshes: 16.0, cost: 0.065, ..FEW_PIXELS };

/// The steps from best to fastest; each includes the reductions of those before. The order: the terrain's error and
/// the staleness of shadows, which are least visible; resolution; shadow cascades; temporal anti-aliasing; all
/// anti-aliasing together with the meshes' error, whose chunks have to be undone and applied again; samples of ambient
/// occlusion; punctual lights; ambient occlusion, relief, which is then finer than the pixels, and the size of shadow
/// maps; at last more of resolution and meshes.
pub const STEPS: [Step; 11] = [
    FULL,
    LATE_SHADOWS,
    SCALE_70,
    SCALE_50,
    TWO_CASCADES,
    SPATIAL_AA,
    NO_AA,
    FEW_SAMPLES,
    FEW_PUNCTUAL_LIGHTS,
    FEW_PIXELS,
    FASTEST,
];

impl Step {
    /// Limits a user's settings, except for the staleness of shadows.
    pub fn limit(&self, settings: &Settings) -> Settings {
        let occlusion = settings.occlusion.filter(|_| self.samples > 0);
        Settings {
            render_scale: self.render_scale,
            anti_aliasing: settings.anti_aliasing.min(self.anti_aliasing),
            occlusion: occlusion.map(|occlusion| AmbientOcclusion {
                samples: occlusion.samples.min(self.samples),
                ..occlusion
            }),
            relief: settings.relief && self.relief,
            anisotropy: settings.anisotropy.min(self.anisotropy),
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

    /// Descriptions of all reductions, in the order of the steps.
    pub fn given_up(&self) -> Vec<String> {
        let error =
            |name: &str, factor: f32| (factor > 1.0).then(|| format!("{name} {factor:.0}× as coarse"));
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
            (self.anisotropy < u32::MAX).then(|| "textures softer at grazing angles".to_owned()),
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

/// A user's settings limited by each step, the best first.
pub fn limited_settings(settings: &Settings) -> Vec<Settings> {
    STEPS.iter().map(|step| step.limit(settings)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use lodestream_render::MAX_LIGHTS;

    /// A step's row in the document: its reductions that the step before did not have, or not as far.
    fn row(number: usize) -> String {
        let before = STEPS[number - 1].given_up();
        let new: Vec<String> =
            STEPS[number].given_up().into_iter().filter(|part| !before.contains(part)).collect();
        format!("| {number} | {} | {:.0} % |", new.join(", "), STEPS[number].cost * 100.0)
    }

    #[test]
    fn the_document_has_the_steps_of_this_table_in_their_order() {
        let page = concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/design/drawing.md");
        let page = std::fs::read_to_string(page).unwrap();
        let table: Vec<String> = (1..STEPS.len()).map(row).collect();
        let table = format!("|---|---|---|\n{}\n", table.join("\n"));
        assert!(page.contains(&table), "docs/design/drawing.md lacks:\n{table}");
    }

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
    fn reductions_grow_from_step_to_step() {
        for [before, after] in STEPS.windows(2).map(|pair| [pair[0], pair[1]]) {
            assert!(before.render_scale >= after.render_scale && before.ground <= after.ground);
            assert!(before.meshes <= after.meshes && before.late_shadows <= after.late_shadows);
            assert!(before.cascades >= after.cascades && before.map_steps >= after.map_steps);
            assert!(before.map_side >= after.map_side && before.anti_aliasing >= after.anti_aliasing);
            assert!(before.samples >= after.samples && before.punctual_lights >= after.punctual_lights);
            assert!(before.relief >= after.relief && before.anisotropy >= after.anisotropy);
            assert!(before.cost > after.cost);
            assert_ne!(before.given_up(), after.given_up());
        }
    }

    #[test]
    fn steps_never_raise_the_users_settings() {
        let least = Settings {
            anti_aliasing: AntiAliasing::None,
            occlusion: None,
            shadows: None,
            relief: false,
            anisotropy: 1,
            lights: Some(LightCulling { most: 1, ..LightCulling::default() }),
            ..Settings::default()
        };
        for (step, left) in STEPS.iter().zip(limited_settings(&least)) {
            assert_eq!(left, Settings { render_scale: step.render_scale, ..least });
        }
        let usual = Settings { anti_aliasing: AntiAliasing::Temporal, ..Settings::default() };
        assert_eq!(FULL.limit(&usual), usual);
    }
}
