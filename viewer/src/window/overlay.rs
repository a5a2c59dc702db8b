//! Overlay: statistics over the picture, and controls for settings.

pub(super) mod animation;
mod choices;
mod rows;

use std::time::Duration;

use lodestream_client::core::Stats;
use lodestream_render::{
    AntiAliasing, DebugView, Ink, MAX_ANISOTROPY, MAX_CASCADES, MAX_FILTER, MAX_INK_BLUR, MAX_INK_LEVELS,
    MAX_LIGHTS, MAX_PN_LEVEL, MAX_REFLECTION_STEPS, MAX_RELIEF_STEPS, MAX_SAMPLES, OcclusionMethod,
    OcclusionNormals, OcclusionRadius, ReflectionMethod, Reflections, ReliefMethod, Timings, ToneMapping,
};

pub(super) use choices::Choices;
pub(super) use rows::OverlayState;
use rows::rows;

/// Choices for the texels along a side of shadow maps.
const SHADOW_MAP_SIDES: [u32; 5] = [512, 1024, 2048, 4096, 8192];
/// Choices for the side of light culling tiles, in pixels.
const LIGHT_TILE_SIDES_PX: [u32; 4] = [8, 16, 32, 64];

/// Height of the window's title and borders, in points; the rest scrolls.
const FRAME_HEIGHT: f32 = 60.0;
/// Most width of a value, in points; longer text wraps.
const VALUE_WIDTH: f32 = 560.0;

/// What mouse and keys do.
const KEYS: [&str; 4] = [
    "drag: turn · right drag: pan · wheel: nearer · WASD QE: move · V: fly or orbit · Space: turntable",
    "0 Home R: start view · 1 3 7: front, right, top · F, double click: frame what is under the pointer",
    "click: select a part · X: hide it · I: isolate it · Z: go to it · U: show all · H: hide this",
    "F11: full screen, Escape leaves it · F12, Ctrl+S: write the picture · Ctrl+Q: quit",
];

/// Draws the overlay.
pub(super) fn show(ui: &mut egui::Ui, stats: &Stats, state: &OverlayState<'_>, choices: &mut Choices) {
    let context = ui.ctx().clone();
    if let Some(message) = state.message {
        egui::Area::new(egui::Id::unique("message")).anchor(egui::Align2::CENTER_TOP, [0.0, 12.0]).show(
            &context,
            |ui| {
                egui::Frame::popup(ui.style()).show(ui, |ui| {
                    ui.colored_label(egui::Color32::from_rgb(255, 190, 90), message);
                });
            },
        );
    }
    if choices.hidden {
        return;
    }
    let frame = egui::Frame::window(&context.global_style()).multiply_with_opacity(0.8);
    let window = egui::Window::new("Lodestream").default_pos([8.0, 8.0]).resizable(false).frame(frame);
    window.show(&context, |ui| {
        let most = (context.content_rect().height() - FRAME_HEIGHT).max(FRAME_HEIGHT);
        egui::ScrollArea::vertical()
            .max_height(most)
            .min_scrolled_height(most)
            .show(ui, |ui| contents(ui, stats, state, choices));
    });
}

fn contents(ui: &mut egui::Ui, stats: &Stats, state: &OverlayState<'_>, choices: &mut Choices) {
    ui.style_mut().override_text_style = Some(egui::TextStyle::Small);
    let figures = egui::Grid::new("figures").num_columns(2).max_col_width(VALUE_WIDTH);
    figures.spacing([10.0, 0.0]).show(ui, |ui| {
        for (name, value) in rows(stats, state) {
            ui.label(name);
            ui.add(egui::Label::new(value).wrap());
            ui.end_row();
        }
    });
    ui.separator();
    ui.horizontal(|ui| {
        ui.label("pixel error");
        let slider = egui::Slider::new(&mut choices.target_px, 0.1..=64.0).logarithmic(true).max_decimals(2);
        ui.add(slider.suffix(" px"));
    });
    ui.horizontal_wrapped(|ui| {
        ui.checkbox(&mut choices.frozen, "freeze selection");
        ui.checkbox(&mut choices.wireframe, "wireframe");
    });
    egui::ComboBox::from_label("view").selected_text(choices.debug_view.name()).show_ui(ui, |ui| {
        for view in DebugView::ALL {
            ui.selectable_value(&mut choices.debug_view, view, view.name());
        }
    });
    ui.horizontal_wrapped(|ui| {
        ui.checkbox(&mut choices.occlusion, "ambient occlusion");
        ui.checkbox(&mut choices.shadows, "shadows");
        ui.checkbox(&mut choices.relief, "relief");
        ui.add_enabled(choices.relief, egui::Checkbox::new(&mut choices.relief_shadows, "its shadows"));
        ui.add_enabled(choices.relief, egui::Checkbox::new(&mut choices.relief_in_depth, "in depth"));
        ui.checkbox(&mut choices.curved, "curved triangles");
        ui.checkbox(&mut choices.inked, "ink");
        ui.checkbox(&mut choices.punctual_lights, "punctual lights");
        ui.checkbox(&mut choices.emission, "emission");
        ui.checkbox(&mut choices.transparency, "transparency");
        ui.checkbox(&mut choices.water, "water");
        ui.checkbox(&mut choices.haze, "haze");
        ui.checkbox(&mut choices.dither, "dithering");
        ui.checkbox(&mut choices.adapt, "coarser while moving");
    });
    egui::ComboBox::from_label("anti-aliasing").selected_text(choices.anti_aliasing.name()).show_ui(
        ui,
        |ui| {
            for method in AntiAliasing::ALL {
                ui.selectable_value(&mut choices.anti_aliasing, method, method.name());
            }
        },
    );
    ui.collapsing("parameters of passes", |ui| parameters(ui, choices));
    let times = ui.collapsing("times of passes", |ui| times(ui, &state.times));
    choices.timed = times.body_returned.is_some();
    ui.separator();
    for line in KEYS {
        ui.small(line);
    }
}

/// Controls for the parameters of passes.
fn parameters(ui: &mut egui::Ui, choices: &mut Choices) {
    let Choices { ambient, maps, culling, .. } = choices;
    let slider = |ui: &mut egui::Ui, name: &str, slider: egui::Slider<'_>| {
        ui.label(name);
        ui.add(slider);
        ui.end_row();
    };
    egui::Grid::new("parameters").num_columns(2).spacing([10.0, 0.0]).show(ui, |ui| {
        ui.label("occlusion: method");
        egui::ComboBox::from_id_salt("method").selected_text(ambient.method.name()).show_ui(ui, |ui| {
            for method in OcclusionMethod::ALL {
                ui.selectable_value(&mut ambient.method, method, method.name());
            }
        });
        ui.end_row();
        ui.label("while still");
        let still = ambient.still.map_or("the same", OcclusionMethod::name);
        egui::ComboBox::from_id_salt("still").selected_text(still).show_ui(ui, |ui| {
            ui.selectable_value(&mut ambient.still, None, "the same");
            for method in OcclusionMethod::ALL {
                ui.selectable_value(&mut ambient.still, Some(method), method.name());
            }
        });
        ui.end_row();
        ui.label("normals");
        egui::ComboBox::from_id_salt("normals").selected_text(ambient.normals.name()).show_ui(ui, |ui| {
            for normals in OcclusionNormals::ALL {
                ui.selectable_value(&mut ambient.normals, normals, normals.name());
            }
        });
        ui.end_row();
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
        slider(ui, "shadows: maps", egui::Slider::new(&mut maps.cascades, 1..=MAX_CASCADES as u32));
        ui.label("texels along a side");
        egui::ComboBox::from_id_salt("side").selected_text(maps.map_side.to_string()).show_ui(ui, |ui| {
            for side in SHADOW_MAP_SIDES {
                ui.selectable_value(&mut maps.map_side, side, side.to_string());
            }
        });
        ui.end_row();
        slider(ui, "filter", egui::Slider::new(&mut maps.filter, 1..=MAX_FILTER));
        ui.label("punctual lights: tiles, px");
        egui::ComboBox::from_id_salt("tiles").selected_text(culling.tile_px.to_string()).show_ui(ui, |ui| {
            for side in LIGHT_TILE_SIDES_PX {
                ui.selectable_value(&mut culling.tile_px, side, side.to_string());
            }
        });
        ui.end_row();
        ui.label("clusters");
        ui.checkbox(&mut culling.clusters, "");
        ui.end_row();
        let most = egui::Slider::new(&mut culling.most, 1..=MAX_LIGHTS as u32).logarithmic(true);
        slider(ui, "at most", most);
        slider(ui, "lookups of textures", egui::Slider::new(&mut choices.anisotropy, 1..=MAX_ANISOTROPY));
        let steps = egui::Slider::new(&mut choices.relief_steps, 1..=MAX_RELIEF_STEPS).logarithmic(true);
        slider(ui, "relief: steps", steps);
        ui.label("way");
        let named = egui::ComboBox::from_id_salt("relief").selected_text(choices.relief_method.name());
        named.show_ui(ui, |ui| {
            for method in ReliefMethod::ALL {
                ui.selectable_value(&mut choices.relief_method, method, method.name());
            }
        });
        ui.end_row();
        ui.label("reflections");
        let named = choices.reflections.map_or("the sky", |reflections| reflections.method.name());
        egui::ComboBox::from_id_salt("reflections").selected_text(named).show_ui(ui, |ui| {
            let chosen = &mut choices.reflections;
            let steps = chosen.unwrap_or_default().steps;
            ui.selectable_value(chosen, None, "the sky");
            for method in ReflectionMethod::ALL {
                ui.selectable_value(chosen, Some(Reflections { method, steps }), method.name());
            }
        });
        ui.end_row();
        if let Some(reflections) = &mut choices.reflections {
            let steps = egui::Slider::new(&mut reflections.steps, 1..=MAX_REFLECTION_STEPS).logarithmic(true);
            slider(ui, "steps of a ray", steps);
        }
        slider(ui, "bloom", egui::Slider::new(&mut choices.bloom.strength, 0.0..=0.5));
        let error = egui::Slider::new(&mut choices.patches.error_px, 0.05..=8.0).logarithmic(true);
        slider(ui, "curved triangles: error, px", error);
        let most = egui::Slider::new(&mut choices.patches.most, 1..=MAX_PN_LEVEL).logarithmic(true);
        slider(ui, "at most pieces an edge", most);
        let [factor, seconds] = &mut choices.heights;
        slider(ui, "heights of the ground ×", egui::Slider::new(factor, 0.0..=10.0));
        slider(ui, "within, s", egui::Slider::new(seconds, 0.0..=10.0));
        ink(ui, &mut choices.ink);
        slider(ui, "exposure", egui::Slider::new(&mut choices.exposure, 0.05..=20.0).logarithmic(true));
        ui.label("tone mapping");
        egui::ComboBox::from_id_salt("tone").selected_text(choices.tone_mapping.name()).show_ui(ui, |ui| {
            for tone in ToneMapping::ALL {
                ui.selectable_value(&mut choices.tone_mapping, tone, tone.name());
            }
        });
        ui.end_row();
    });
}

/// Controls for the parameters of ink.
fn ink(ui: &mut egui::Ui, ink: &mut Ink) {
    let mut row = |name: &str, slider: egui::Slider<'_>| {
        ui.label(name);
        ui.add(slider);
        ui.end_row();
    };
    row("ink: strokes, px", egui::Slider::new(&mut ink.width_px, 0.0..=8.0));
    row("blurred by, px", egui::Slider::new(&mut ink.blur_px, 0..=MAX_INK_BLUR));
    row("creases from, degrees", egui::Slider::new(&mut ink.crease_degrees, 0.0..=180.0));
    row("levels of light", egui::Slider::new(&mut ink.levels, 1..=MAX_INK_LEVELS));
    row("spattered by, levels", egui::Slider::new(&mut ink.spatter, 0.0..=1.0));
}

/// Times of passes, a row each.
fn times(ui: &mut egui::Ui, times: &Timings) {
    let ms = |time: Duration| format!("{:.2}", time.as_secs_f64() * 1e3);
    egui::Grid::new("times").num_columns(3).spacing([10.0, 0.0]).striped(true).show(ui, |ui| {
        let mut row = |cells: [&str; 3]| {
            for cell in cells {
                ui.label(cell);
            }
            ui.end_row();
        };
        row([&format!("mean of {} frames, ms", times.frames), "processor", "graphics"]);
        row(["choose and upload", &ms(times.plan), ""]);
        for time in &times.passes {
            row([&time.pass.name().replace('_', " "), &ms(time.cpu), &time.gpu.map_or("–".into(), ms)]);
        }
        let cpu: Duration = times.passes.iter().map(|time| time.cpu).sum();
        let gpu: Option<Duration> = times.passes.iter().map(|time| time.gpu).sum();
        row(["all", &ms(times.plan + cpu), &gpu.map_or("–".into(), ms)]);
    });
}

#[cfg(test)]
mod tests {
    use super::*;
    use lodestream_render::Settings;
    use lodestream_viewing::Quality;

    /// All text that the overlay draws.
    fn drawn(state: &OverlayState<'_>, hidden: bool) -> String {
        fn collect(shape: &egui::Shape, text: &mut String) {
            match shape {
                egui::Shape::Vec(shapes) => shapes.iter().for_each(|shape| collect(shape, text)),
                egui::Shape::Text(shape) => *text += &format!("{}\n", shape.galley.text()),
                _ => {}
            }
        }
        let context = egui::Context::default();
        let mut choices = Choices { hidden, ..Choices::new(&Settings::default(), 1.0, [1.0, 2.0]) };
        let mut text = String::new();
        // A window is measured before it is drawn.
        for _ in 0..3 {
            let area = egui::Rect::from_min_size(egui::Pos2::ZERO, egui::vec2(1280.0, 720.0));
            let input = egui::RawInput { screen_rect: Some(area), ..egui::RawInput::default() };
            let stats = Stats::default();
            let mut output = context.run_ui(input, |ui| show(ui, &stats, state, &mut choices));
            // egui panics if they are dropped unused.
            output.textures_delta.clear();
            text.clear();
            output.shapes.iter().for_each(|clipped| collect(&clipped.shape, &mut text));
        }
        text
    }

    #[test]
    fn the_step_of_quality_is_drawn_beside_its_name() {
        let quality = Quality::new(true).describe();
        assert!(quality.starts_with("step 9 of 9: "), "{quality}");
        let state = OverlayState { quality: quality.clone(), ..OverlayState::default() };
        let text = drawn(&state, false);
        let lines: Vec<&str> = text.lines().collect();
        assert!(lines.windows(2).any(|pair| pair == ["quality", &quality]), "{text}");
        assert!(!drawn(&state, true).contains(&quality), "a hidden overlay shows messages alone");
    }

    #[test]
    fn what_keys_do_is_drawn() {
        let text = drawn(&OverlayState::default(), false);
        assert!(KEYS.iter().all(|line| text.contains(line)), "{text}");
    }

    #[test]
    fn a_message_is_drawn_even_if_the_overlay_is_hidden() {
        let state = OverlayState { message: Some("nobody answers"), ..OverlayState::default() };
        assert_eq!(drawn(&state, true).trim(), "nobody answers");
    }
}
