//! Controls for the settings of the picture, in groups.

use lodestream_render::{
    AntiAliasing, DebugView, Ink, MAX_ANISOTROPY, MAX_CASCADES, MAX_FILTER, MAX_INK_BLUR, MAX_INK_LEVELS,
    MAX_LIGHTS, MAX_PN_LEVEL, MAX_REFLECTION_STEPS, MAX_RELIEF_STEPS, MAX_SAMPLES, OcclusionMethod,
    OcclusionNormals, OcclusionRadius, ReflectionMethod, Reflections, ReliefMethod, Timings, ToneMapping,
};

use super::choices::Choices;
use super::times::times;

/// Choices for the texels along a side of shadow maps.
const SHADOW_MAP_SIDES: [u32; 5] = [512, 1024, 2048, 4096, 8192];
/// Choices for the side of light culling tiles, in pixels.
const LIGHT_TILE_SIDES_PX: [u32; 4] = [8, 16, 32, 64];

/// Draws all groups; the first two are open.
pub(super) fn contents(ui: &mut egui::Ui, measured: &Timings, choices: &mut Choices) {
    group(ui, "detail", true, |ui| detail(ui, choices));
    group(ui, "view", true, |ui| view(ui, choices));
    group(ui, "light and colour", false, |ui| light(ui, choices));
    group(ui, "ambient occlusion", false, |ui| occlusion(ui, choices));
    group(ui, "shadows", false, |ui| shadows(ui, choices));
    group(ui, "relief and curves", false, |ui| relief(ui, choices));
    group(ui, "reflections and water", false, |ui| reflections(ui, choices));
    group(ui, "ink", false, |ui| ink(ui, choices));
    group(ui, "terrain", false, |ui| terrain(ui, choices));
    let shown = group(ui, "times of passes", false, |ui| times(ui, measured));
    choices.timed = shown;
}

/// A group of controls under a title; returns whether it is open.
fn group(ui: &mut egui::Ui, title: &str, open: bool, contents: impl FnOnce(&mut egui::Ui)) -> bool {
    let header = egui::CollapsingHeader::new(title).default_open(open).show(ui, |ui| {
        egui::Grid::new(title).num_columns(2).spacing([8.0, 2.0]).show(ui, contents);
    });
    header.body_returned.is_some()
}

fn slider(ui: &mut egui::Ui, name: &str, slider: egui::Slider<'_>) {
    ui.label(name);
    ui.add(slider);
    ui.end_row();
}

fn switch(ui: &mut egui::Ui, name: &str, on: &mut bool) {
    ui.label(name);
    ui.checkbox(on, "");
    ui.end_row();
}

/// A choice of one of several values by their names.
fn choice<T: Copy + PartialEq>(
    ui: &mut egui::Ui,
    label: &str,
    chosen: &mut T,
    values: impl IntoIterator<Item = T>,
    name: impl Fn(T) -> String,
) {
    ui.label(label);
    egui::ComboBox::from_id_salt(label).width(0.0).selected_text(name(*chosen)).show_ui(ui, |ui| {
        for value in values {
            ui.selectable_value(chosen, value, name(value));
        }
    });
    ui.end_row();
}

fn detail(ui: &mut egui::Ui, choices: &mut Choices) {
    let error = egui::Slider::new(&mut choices.target_px, 0.1..=64.0).logarithmic(true).max_decimals(2);
    slider(ui, "error, px", error);
    switch(ui, "coarser while moving", &mut choices.adapt);
    switch(ui, "freeze selection", &mut choices.frozen);
}

fn view(ui: &mut egui::Ui, choices: &mut Choices) {
    choice(ui, "view", &mut choices.debug_view, DebugView::ALL, |view| view.name().into());
    switch(ui, "wireframe", &mut choices.wireframe);
    choice(ui, "anti-aliasing", &mut choices.anti_aliasing, AntiAliasing::ALL, |method| method.name().into());
    slider(ui, "texture lookups", egui::Slider::new(&mut choices.anisotropy, 1..=MAX_ANISOTROPY));
    switch(ui, "transparency", &mut choices.transparency);
    switch(ui, "dithering", &mut choices.dither);
}

fn light(ui: &mut egui::Ui, choices: &mut Choices) {
    slider(ui, "exposure", egui::Slider::new(&mut choices.exposure, 0.05..=20.0).logarithmic(true));
    choice(ui, "tone mapping", &mut choices.tone_mapping, ToneMapping::ALL, |tone| tone.name().into());
    slider(ui, "bloom", egui::Slider::new(&mut choices.bloom.strength, 0.0..=0.5));
    switch(ui, "haze", &mut choices.haze);
    switch(ui, "emission", &mut choices.emission);
    switch(ui, "punctual lights", &mut choices.punctual_lights);
    let culling = &mut choices.culling;
    let most = egui::Slider::new(&mut culling.most, 1..=MAX_LIGHTS as u32).logarithmic(true);
    slider(ui, "at most", most);
    choice(ui, "their tiles, px", &mut culling.tile_px, LIGHT_TILE_SIDES_PX, |side| side.to_string());
    switch(ui, "clusters", &mut culling.clusters);
}

fn occlusion(ui: &mut egui::Ui, choices: &mut Choices) {
    switch(ui, "drawn", &mut choices.occlusion);
    let ambient = &mut choices.ambient;
    choice(ui, "method", &mut ambient.method, OcclusionMethod::ALL, |method| method.name().into());
    let still = OcclusionMethod::ALL.map(Some).into_iter().chain([None]);
    let name = |method: Option<OcclusionMethod>| method.map_or("the same", OcclusionMethod::name).into();
    choice(ui, "while still", &mut ambient.still, still, name);
    choice(ui, "normals", &mut ambient.normals, OcclusionNormals::ALL, |normals| normals.name().into());
    slider(ui, "samples", egui::Slider::new(&mut ambient.samples, 1..=MAX_SAMPLES));
    ui.label("one pixel of four");
    let whole = ambient.method == OcclusionMethod::HbaoPlus;
    ui.add_enabled(!whole, egui::Checkbox::without_text(&mut ambient.half));
    ui.end_row();
    slider(ui, "strength", egui::Slider::new(&mut ambient.strength, 0.0..=4.0));
    match &mut ambient.radius {
        OcclusionRadius::Depth(share) => {
            slider(ui, "radius over depth", egui::Slider::new(share, 0.005..=0.5).logarithmic(true));
        }
        OcclusionRadius::World(radius) => {
            slider(ui, "radius, world units", egui::Slider::new(radius, 1e-3..=1e3).logarithmic(true));
        }
    }
}

fn shadows(ui: &mut egui::Ui, choices: &mut Choices) {
    switch(ui, "drawn", &mut choices.shadows);
    let maps = &mut choices.maps;
    slider(ui, "maps", egui::Slider::new(&mut maps.cascades, 1..=MAX_CASCADES as u32));
    choice(ui, "texels along a side", &mut maps.map_side, SHADOW_MAP_SIDES, |side| side.to_string());
    slider(ui, "filter", egui::Slider::new(&mut maps.filter, 1..=MAX_FILTER));
}

fn relief(ui: &mut egui::Ui, choices: &mut Choices) {
    switch(ui, "relief mapping", &mut choices.relief);
    choice(ui, "method", &mut choices.relief_method, ReliefMethod::ALL, |method| method.name().into());
    let steps = egui::Slider::new(&mut choices.relief_steps, 1..=MAX_RELIEF_STEPS).logarithmic(true);
    slider(ui, "steps", steps);
    switch(ui, "its shadows", &mut choices.relief_shadows);
    switch(ui, "in depth", &mut choices.relief_in_depth);
    switch(ui, "curved triangles", &mut choices.curved);
    let error = egui::Slider::new(&mut choices.patches.error_px, 0.05..=8.0).logarithmic(true);
    slider(ui, "their error, px", error);
    let most = egui::Slider::new(&mut choices.patches.most, 1..=MAX_PN_LEVEL).logarithmic(true);
    slider(ui, "pieces an edge", most);
}

fn reflections(ui: &mut egui::Ui, choices: &mut Choices) {
    switch(ui, "water", &mut choices.water);
    let steps = choices.reflections.unwrap_or_default().steps;
    let methods = ReflectionMethod::ALL.map(|method| Some(Reflections { method, steps }));
    let name = |chosen: Option<Reflections>| chosen.map_or("the sky", |some| some.method.name()).into();
    choice(ui, "reflections", &mut choices.reflections, [None].into_iter().chain(methods), name);
    if let Some(reflections) = &mut choices.reflections {
        let steps = egui::Slider::new(&mut reflections.steps, 1..=MAX_REFLECTION_STEPS).logarithmic(true);
        slider(ui, "steps of a ray", steps);
    }
}

fn ink(ui: &mut egui::Ui, choices: &mut Choices) {
    switch(ui, "drawn", &mut choices.inked);
    let Ink { width_px, blur_px, crease_degrees, levels, spatter, .. } = &mut choices.ink;
    slider(ui, "strokes, px", egui::Slider::new(width_px, 0.0..=8.0));
    slider(ui, "blurred by, px", egui::Slider::new(blur_px, 0..=MAX_INK_BLUR));
    slider(ui, "creases from, degrees", egui::Slider::new(crease_degrees, 0.0..=180.0));
    slider(ui, "levels of light", egui::Slider::new(levels, 1..=MAX_INK_LEVELS));
    slider(ui, "spatter, levels", egui::Slider::new(spatter, 0.0..=1.0));
}

fn terrain(ui: &mut egui::Ui, choices: &mut Choices) {
    let [factor, seconds] = &mut choices.heights;
    slider(ui, "heights ×", egui::Slider::new(factor, 0.0..=10.0));
    slider(ui, "within, s", egui::Slider::new(seconds, 0.0..=10.0));
}
