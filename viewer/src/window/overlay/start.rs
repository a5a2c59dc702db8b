//! The window before anything is opened.

use crate::window::keyboard::{Action, Bindings};
use crate::window::open_panel::OpenPanel;

/// Draws what can be opened, and how, in the middle of the window.
pub(super) fn show(context: &egui::Context, open: &mut OpenPanel, bindings: &Bindings) {
    let area = egui::Area::new(egui::Id::unique("start")).anchor(egui::Align2::CENTER_CENTER, [0.0, 0.0]);
    area.show(context, |ui| {
        ui.set_max_width(0.5 * context.content_rect().width());
        ui.vertical_centered(|ui| {
            ui.heading("Drop a model, a scene or a folder here");
            ui.label(format!("{}: open a file or an address", bindings.names(Action::Open)));
            ui.add_space(16.0);
            open.recent_contents(ui);
        });
    });
}
