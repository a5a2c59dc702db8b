//! Values that the overlay's controls change: taken from the settings, and applied to them.

use lodestream_render::{
    AmbientOcclusion, AntiAliasing, Bloom, DebugView, Ink, LightCulling, PnTriangles, Reflections,
    ReliefMethod, Settings, Shadows, ToneMapping,
};

use super::panel::Panel;

/// Values of the overlay's controls.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::window) struct Choices {
    /// Screen error to refine to, in pixels.
    pub(in crate::window) target_px: f32,
    /// The selection keeps the view at which it was frozen.
    pub(in crate::window) frozen: bool,
    /// Adaptive quality while the camera moves.
    pub(in crate::window) adapt: bool,
    /// The line over the picture is hidden.
    pub(in crate::window) hidden: bool,
    /// The panel that is open.
    pub(in crate::window) panel: Option<Panel>,
    /// Passes are timed, because their table is open.
    pub(in crate::window) timed: bool,
    pub(in crate::window) wireframe: bool,
    pub(in crate::window) debug_view: DebugView,
    pub(in crate::window) occlusion: bool,
    /// Parameters of ambient occlusion.
    pub(in crate::window) ambient: AmbientOcclusion,
    pub(in crate::window) shadows: bool,
    /// Parameters of shadows.
    pub(in crate::window) maps: Shadows,
    pub(in crate::window) anti_aliasing: AntiAliasing,
    pub(in crate::window) relief: bool,
    pub(in crate::window) punctual_lights: bool,
    /// Parameters of punctual lights.
    pub(in crate::window) culling: LightCulling,
    pub(in crate::window) haze: bool,
    pub(in crate::window) emission: bool,
    pub(in crate::window) transparency: bool,
    pub(in crate::window) water: bool,
    pub(in crate::window) reflections: Option<Reflections>,
    pub(in crate::window) bloom: Bloom,
    pub(in crate::window) dither: bool,
    pub(in crate::window) anisotropy: u32,
    pub(in crate::window) relief_steps: u32,
    pub(in crate::window) relief_method: ReliefMethod,
    pub(in crate::window) relief_shadows: bool,
    pub(in crate::window) relief_in_depth: bool,
    pub(in crate::window) curved: bool,
    /// Parameters of PN triangles.
    pub(in crate::window) patches: PnTriangles,
    pub(in crate::window) inked: bool,
    /// Parameters of ink.
    pub(in crate::window) ink: Ink,
    /// Vertical exaggeration, and the seconds over which it changes.
    pub(in crate::window) heights: [f64; 2],
    pub(in crate::window) exposure: f32,
    pub(in crate::window) tone_mapping: ToneMapping,
}

impl Choices {
    pub(in crate::window) fn new(settings: &Settings, target_px: f32, heights: [f64; 2]) -> Self {
        Self {
            target_px,
            heights,
            frozen: false,
            adapt: true,
            hidden: false,
            panel: None,
            timed: false,
            wireframe: settings.wireframe,
            debug_view: settings.debug_view,
            occlusion: settings.occlusion.is_some(),
            ambient: settings.occlusion.unwrap_or_default(),
            shadows: settings.shadows.is_some(),
            maps: settings.shadows.unwrap_or_default(),
            anti_aliasing: settings.anti_aliasing,
            relief: settings.relief,
            punctual_lights: settings.lights.is_some(),
            culling: settings.lights.unwrap_or_default(),
            haze: settings.haze,
            emission: settings.emission,
            transparency: settings.transparency,
            water: settings.water,
            reflections: settings.reflections,
            bloom: settings.bloom.unwrap_or(Bloom { strength: 0.0 }),
            dither: settings.dither,
            anisotropy: settings.anisotropy,
            relief_steps: settings.relief_steps,
            relief_method: settings.relief_method,
            relief_shadows: settings.relief_shadows,
            relief_in_depth: settings.relief_in_depth,
            curved: settings.pn_triangles.is_some(),
            patches: settings.pn_triangles.unwrap_or_default(),
            inked: settings.ink.is_some(),
            ink: settings.ink.unwrap_or_default(),
            exposure: settings.exposure,
            tone_mapping: settings.tone_mapping,
        }
    }

    pub(in crate::window) fn apply(&self, settings: &mut Settings) {
        settings.wireframe = self.wireframe;
        settings.debug_view = self.debug_view;
        settings.occlusion = self.occlusion.then_some(self.ambient);
        settings.shadows = self.shadows.then_some(self.maps);
        settings.anti_aliasing = self.anti_aliasing;
        settings.relief = self.relief;
        settings.lights = self.punctual_lights.then_some(self.culling);
        settings.haze = self.haze;
        settings.emission = self.emission;
        settings.transparency = self.transparency;
        settings.water = self.water;
        settings.reflections = self.reflections;
        settings.bloom = (self.bloom.strength > 0.0).then_some(self.bloom);
        settings.dither = self.dither;
        settings.anisotropy = self.anisotropy;
        settings.relief_steps = self.relief_steps;
        settings.relief_method = self.relief_method;
        settings.relief_shadows = self.relief_shadows;
        settings.relief_in_depth = self.relief_in_depth;
        settings.pn_triangles = self.curved.then_some(self.patches);
        settings.ink = self.inked.then_some(self.ink);
        settings.exposure = self.exposure;
        settings.tone_mapping = self.tone_mapping;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn choices_round_trip_through_the_settings() {
        let mut settings = Settings {
            debug_view: DebugView::Depth,
            occlusion: Some(AmbientOcclusion { samples: 5, ..AmbientOcclusion::default() }),
            shadows: None,
            anti_aliasing: AntiAliasing::None,
            anisotropy: 3,
            lights: Some(LightCulling { tile_px: 32, clusters: false, most: 5 }),
            haze: false,
            emission: false,
            transparency: false,
            water: false,
            reflections: Some(Reflections { steps: 3, ..Reflections::default() }),
            bloom: Some(Bloom { strength: 0.1 }),
            dither: false,
            relief_steps: 7,
            relief_method: ReliefMethod::SteepParallax,
            relief_shadows: true,
            relief_in_depth: true,
            pn_triangles: Some(PnTriangles { error_px: 1.5, most: 8 }),
            ink: Some(Ink { levels: 7, ..Ink::default() }),
            exposure: 2.0,
            tone_mapping: ToneMapping::Neutral,
            ..Settings::default()
        };
        let mut choices = Choices::new(&settings, 1.0, [1.0, 2.0]);
        let mut back = Settings::default();
        choices.apply(&mut back);
        assert_eq!(back, settings);
        (choices.shadows, choices.maps.cascades, choices.ambient.samples) = (true, 2, 9);
        choices.punctual_lights = false;
        choices.apply(&mut settings);
        assert_eq!(settings.lights, None);
        assert_eq!(settings.shadows, Some(Shadows { cascades: 2, ..Shadows::default() }));
        assert_eq!(settings.occlusion.map(|occlusion| occlusion.samples), Some(9));
    }
}
