//! What keys and mouse do.

use crate::window::keyboard::{ACTIONS, Bindings};

/// What the mouse does.
pub(super) const MOUSE: [[&str; 2]; 5] = [
    ["drag", "turn about what is under the pointer"],
    ["right drag", "pan"],
    ["wheel, pinch", "nearer to what is under the pointer"],
    ["click", "select a part, or measure"],
    ["double click", "frame what is under the pointer"],
];

/// Draws the keys, in groups, and the mouse.
pub(super) fn contents(ui: &mut egui::Ui, bindings: &Bindings) {
    let mut group = "";
    egui::Grid::new("keys").num_columns(2).spacing([8.0, 2.0]).show(ui, |ui| {
        let row = |ui: &mut egui::Ui, keys: &str, what: &str| {
            ui.strong(keys);
            ui.label(what);
            ui.end_row();
        };
        for [what, does] in MOUSE {
            row(ui, what, does);
        }
        for entry in ACTIONS {
            if entry.group != group {
                group = entry.group;
                ui.separator();
                ui.separator();
                ui.end_row();
            }
            row(ui, &bindings.names(entry.action), entry.what);
        }
    });
}
