//! The overlay: a line over the picture, messages, and a panel on demand.
//!
//! | module | idea |
//! |---|---|
//! | `status_line` | what is shown, how far it is, how fast |
//! | `panel` | the frame of the panel, and its size |
//! | `help`, `controls`, `rows` | what it shows: keys, settings, figures |
//! | `start` | the window before anything is opened |
//! | `marks`, `section_bar` | points that are measured, controls of the section plane |

pub(super) mod animation;
mod choices;
mod controls;
mod help;
mod marks;
mod panel;
mod rows;
mod section_bar;
mod start;
mod status_line;
mod times;

use lodestream_client::core::Stats;

pub(super) use choices::Choices;
pub(super) use panel::Panel;
pub(super) use rows::OverlayState;
use rows::rows;

use super::open_panel::OpenPanel;
use super::part_list::PartList;
use super::section::Plane;

/// What the overlay changes.
pub(super) struct Controls<'a> {
    pub(super) choices: &'a mut Choices,
    pub(super) open: &'a mut OpenPanel,
    pub(super) parts: &'a mut PartList,
    pub(super) section: &'a mut Option<Plane>,
}

/// Draws the overlay.
pub(super) fn show(ui: &mut egui::Ui, stats: &Stats, state: &OverlayState, controls: &mut Controls<'_>) {
    let context = ui.ctx().clone();
    marks::show(&context, &state.marks);
    if let Some(message) = &state.message {
        show_message(&context, message);
    }
    if state.is_empty {
        start::show(&context, controls.open, &state.bindings);
    }
    if !controls.choices.hidden && !state.is_empty {
        status_line::show(&context, stats, state);
    }
    section_bar::show(&context, controls.section, state.section_position);
    if let Some(panel) = controls.choices.panel {
        let open = panel::show(&context, panel, |ui| contents(ui, panel, stats, state, controls));
        if !open {
            controls.choices.panel = None;
        }
    }
    controls.choices.timed &= controls.choices.panel == Some(Panel::Settings);
}

fn show_message(context: &egui::Context, message: &str) {
    let area = egui::Area::new(egui::Id::unique("message")).anchor(egui::Align2::CENTER_TOP, [0.0, 12.0]);
    area.show(context, |ui| {
        egui::Frame::popup(ui.style()).show(ui, |ui| {
            ui.set_max_width(0.6 * context.content_rect().width());
            ui.colored_label(egui::Color32::from_rgb(255, 190, 90), message);
        });
    });
}

fn contents(
    ui: &mut egui::Ui,
    panel: Panel,
    stats: &Stats,
    state: &OverlayState,
    controls: &mut Controls<'_>,
) {
    match panel {
        Panel::Help => help::contents(ui, &state.bindings),
        Panel::Information => information(ui, stats, state),
        Panel::Parts => controls.parts.contents(ui, &state.hidden_parts, state.selected),
        Panel::Settings => controls::contents(ui, &state.times, controls.choices),
        Panel::Open => controls.open.contents(ui),
    }
}

fn information(ui: &mut egui::Ui, stats: &Stats, state: &OverlayState) {
    let width = ui.available_width() * VALUE_WIDTH;
    let figures = egui::Grid::new("figures").num_columns(2).spacing([8.0, 4.0]);
    figures.show(ui, |ui| {
        for (name, value) in rows(stats, state) {
            ui.label(name);
            ui.scope(|ui| {
                ui.set_width(width);
                ui.add(egui::Label::new(value).wrap());
            });
            ui.end_row();
        }
    });
}

/// Share of the panel's width that values take; longer ones wrap.
const VALUE_WIDTH: f32 = 0.68;

#[cfg(test)]
mod tests {
    use std::rc::Rc;

    use super::*;
    use crate::window::keyboard::{ACTIONS, Bindings};
    use lodestream_render::Settings;
    use lodestream_viewing::Quality;

    fn bindings() -> Rc<Bindings> {
        Rc::new(Bindings::new(&Default::default()).unwrap())
    }

    /// All text that the overlay draws in a window of this size in points, and the area of its panel.
    fn drawn(
        state: &OverlayState,
        choices: &mut Choices,
        size: egui::Vec2,
        pixels_per_point: f32,
    ) -> (String, f32) {
        fn collect(shape: &egui::Shape, text: &mut String) {
            match shape {
                egui::Shape::Vec(shapes) => shapes.iter().for_each(|shape| collect(shape, text)),
                egui::Shape::Text(shape) => *text += &format!("{}\n", shape.galley.text()),
                _ => {}
            }
        }
        let context = egui::Context::default();
        let (mut open, mut parts, mut section) = (OpenPanel::default(), PartList::default(), None);
        let mut text = String::new();
        // A window is measured before it is drawn.
        for _ in 0..4 {
            let area = egui::Rect::from_min_size(egui::Pos2::ZERO, size);
            let mut input = egui::RawInput { screen_rect: Some(area), ..egui::RawInput::default() };
            input.viewports.entry(egui::ViewportId::ROOT).or_default().native_pixels_per_point =
                Some(pixels_per_point);
            let stats = Stats::default();
            let mut output = context.run_ui(input, |ui| {
                let mut controls = Controls {
                    choices: &mut *choices,
                    open: &mut open,
                    parts: &mut parts,
                    section: &mut section,
                };
                show(ui, &stats, state, &mut controls);
            });
            // egui panics if they are dropped unused.
            output.textures_delta.clear();
            text.clear();
            output.shapes.iter().for_each(|clipped| collect(&clipped.shape, &mut text));
        }
        let panel = context.memory(|memory| memory.area_rect(egui::Id::unique("panel")));
        (text, panel.map_or(0.0, |rect| rect.area()))
    }

    fn choices(panel: Option<Panel>) -> Choices {
        Choices { panel, ..Choices::new(&Settings::default(), 1.0, [1.0, 2.0]) }
    }

    const SIZE: egui::Vec2 = egui::vec2(1280.0, 720.0);
    /// A window in which no panel scrolls.
    const TALL: egui::Vec2 = egui::vec2(1280.0, 4000.0);

    #[test]
    fn a_line_is_drawn_at_first_and_figures_on_demand() {
        let bindings = bindings();
        let quality = Quality::new(true, None).describe();
        let state =
            OverlayState { name: "a.glb".into(), quality: quality.clone(), ..OverlayState::new(&bindings) };
        let (text, _) = drawn(&state, &mut choices(None), SIZE, 1.0);
        assert_eq!(text.lines().count(), 1, "{text}");
        assert!(text.starts_with("a.glb · refining"), "{text}");
        let (text, _) = drawn(&state, &mut choices(Some(Panel::Information)), TALL, 1.0);
        let lines: Vec<&str> = text.lines().collect();
        assert!(lines.contains(&"quality") && text.contains(&quality), "{text}");
        let mut hidden = Choices { hidden: true, ..choices(None) };
        assert_eq!(drawn(&state, &mut hidden, SIZE, 1.0).0, "", "a hidden overlay shows messages alone");
    }

    #[test]
    fn what_keys_do_is_drawn() {
        let bindings = bindings();
        let (text, _) = drawn(&OverlayState::new(&bindings), &mut choices(Some(Panel::Help)), TALL, 1.0);
        for entry in ACTIONS {
            assert!(text.contains(entry.what) && text.contains(&bindings.names(entry.action)), "{text}");
        }
    }

    #[test]
    fn a_message_is_drawn_even_if_the_overlay_is_hidden() {
        let bindings = bindings();
        let state = OverlayState { message: Some("nobody answers".into()), ..OverlayState::new(&bindings) };
        let mut hidden = Choices { hidden: true, ..choices(None) };
        assert_eq!(drawn(&state, &mut hidden, SIZE, 1.0).0.trim(), "nobody answers");
    }

    #[test]
    fn no_panel_takes_a_quarter_of_the_window() {
        let bindings = bindings();
        let address = "wss://a.server.with.a.long.name:4433/and/a/scene/of/a/long/name";
        let state = OverlayState {
            address: address.into(),
            camera: "eye=1,2,3;".repeat(20),
            ..OverlayState::new(&bindings)
        };
        for panel in [Panel::Help, Panel::Information, Panel::Parts, Panel::Settings, Panel::Open] {
            for size in [SIZE, egui::vec2(1920.0, 1080.0), egui::vec2(640.0, 360.0), egui::vec2(500.0, 800.0)]
            {
                for scale in [1.0, 1.5, 3.0] {
                    let (_, area) = drawn(&state, &mut choices(Some(panel)), size, scale);
                    let share = area / (size.x * size.y);
                    assert!(share > 0.0 && share < 0.25, "{panel:?} {size} {scale}: {share}");
                }
            }
        }
    }

    #[test]
    fn an_empty_window_says_how_to_open_something() {
        let bindings = bindings();
        let state = OverlayState { is_empty: true, ..OverlayState::new(&bindings) };
        let (text, _) = drawn(&state, &mut choices(None), SIZE, 1.0);
        assert!(text.contains("Drop") && text.contains("Ctrl+O"), "{text}");
    }
}
