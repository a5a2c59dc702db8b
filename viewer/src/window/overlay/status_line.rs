//! One line over the picture: what is shown, how far it is, and how fast.

use lodestream_client::core::Stats;

use super::rows::{OverlayState, bytes};
use crate::window::keyboard::Action;
use crate::window::state::State;

/// Distance from the window's corner, in points.
const MARGIN: f32 = 8.0;

/// Draws the line in the lower left corner.
pub(super) fn show(context: &egui::Context, stats: &Stats, state: &OverlayState) {
    let area =
        egui::Area::new(egui::Id::unique("status")).anchor(egui::Align2::LEFT_BOTTOM, [MARGIN, -MARGIN]);
    area.interactable(false).show(context, |ui| {
        egui::Frame::popup(ui.style()).multiply_with_opacity(0.75).shadow(egui::Shadow::NONE).show(
            ui,
            |ui| {
                ui.set_max_width(context.content_rect().width() - 4.0 * MARGIN);
                ui.add(
                    egui::Label::new(
                        egui::RichText::new(text(stats, state))
                            .size(12.0)
                            .color(egui::Color32::from_gray(225)),
                    )
                    .truncate(),
                );
            },
        );
    });
}

/// The line's text.
pub(super) fn text(stats: &Stats, state: &OverlayState) -> String {
    let counters = &stats.counters;
    let how_far = match (&state.progress, state.state) {
        (Some(progress), _) => progress.clone(),
        (None, State::Settled) if counters.max_screen_error_px == 0.0 => "full detail".into(),
        (None, State::Settled) => format!("sharp to {:.1} px", counters.max_screen_error_px.max(0.1)),
        (None, State::Incomplete) => "incomplete".into(),
        (None, State::Refining) if counters.missing_bytes > 0 => {
            format!("refining: {} to come", bytes(counters.missing_bytes))
        }
        (None, State::Refining) => "refining".into(),
    };
    let mut parts = vec![state.name.clone(), how_far];
    if state.draw.triangles > 0 && state.state == State::Refining {
        parts.push(format!("{:.0} frames/s", state.fps));
    }
    parts.extend(state.tool.clone());
    parts.push(format!("{} help", state.bindings.names(Action::Help)));
    parts.retain(|part| !part.is_empty());
    parts.join(" · ")
}

#[cfg(test)]
mod tests {
    use std::rc::Rc;

    use super::*;
    use crate::window::keyboard::Bindings;
    use lodestream_render::Counters;

    #[test]
    fn the_line_says_what_is_loading_how_far_and_how_fast() {
        let mut stats = Stats::default();
        let bindings = Rc::new(Bindings::new(&Default::default()).unwrap());
        let mut state = OverlayState { name: "a.glb".into(), fps: 59.7, ..OverlayState::new(&bindings) };
        state.progress = Some("preparing a: 40 %".into());
        assert_eq!(text(&stats, &state), "a.glb · preparing a: 40 % · H help");
        state.progress = None;
        state.draw = Counters { triangles: 12, ..Counters::default() };
        stats.counters.missing_bytes = 12_345;
        assert_eq!(text(&stats, &state), "a.glb · refining: 12.3 kB to come · 60 frames/s · H help");
        state.state = State::Settled;
        assert_eq!(text(&stats, &state), "a.glb · full detail · H help");
        stats.counters.max_screen_error_px = 0.98;
        assert_eq!(text(&stats, &state), "a.glb · sharp to 1.0 px · H help", "nothing is drawn");
    }
}
