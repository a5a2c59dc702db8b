//! Controls of the section plane.

use crate::window::section::Plane;

/// Width of the slider in points, at most this share of the window.
const SLIDER: f32 = 220.0;
const MOST: f32 = 0.4;

/// Draws the controls in the middle of the lower edge; `position` is the plane's, in world units.
pub(super) fn show(context: &egui::Context, section: &mut Option<Plane>, position: Option<f64>) {
    let Some(mut plane) = *section else { return };
    let mut removed = false;
    let area = egui::Area::new(egui::Id::unique("section")).anchor(egui::Align2::CENTER_BOTTOM, [0.0, -56.0]);
    area.show(context, |ui| {
        egui::Frame::popup(ui.style()).show(ui, |ui| {
            ui.horizontal(|ui| {
                for (axis, name) in ["x", "y", "z"].into_iter().enumerate() {
                    ui.selectable_value(&mut plane.axis, axis, name);
                }
                ui.spacing_mut().slider_width = SLIDER.min(MOST * context.content_rect().width());
                ui.add(egui::Slider::new(&mut plane.share, 0.0..=1.0).show_value(false));
                ui.label(position.map(|at| format!("{at:.4}")).unwrap_or_default());
                ui.checkbox(&mut plane.flipped, "other side");
                removed = ui.button("×").clicked();
            });
        });
    });
    *section = (!removed).then_some(plane);
}
