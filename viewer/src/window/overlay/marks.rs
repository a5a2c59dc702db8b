//! Points of the picture that are measured, and the lines between them.

const RADIUS: f32 = 3.5;
const COLOUR: egui::Color32 = egui::Color32::from_rgb(255, 190, 90);

/// Draws marks at places in pixels, and lines between neighbours that are both in front of the eye.
pub(super) fn show(context: &egui::Context, marks: &[Option<[f64; 2]>]) {
    if marks.is_empty() {
        return;
    }
    let painter = context.layer_painter(egui::LayerId::background());
    let scale = f64::from(context.pixels_per_point());
    let point = |[x, y]: [f64; 2]| egui::pos2((x / scale) as f32, (y / scale) as f32);
    for pair in marks.windows(2) {
        if let [Some(a), Some(b)] = pair {
            let line = [point(*a), point(*b)];
            painter.line_segment(line, egui::Stroke::new(3.0, egui::Color32::from_black_alpha(120)));
            painter.line_segment(line, egui::Stroke::new(1.5, COLOUR));
        }
    }
    for mark in marks.iter().flatten() {
        painter.circle(point(*mark), RADIUS, COLOUR, egui::Stroke::new(1.0, egui::Color32::BLACK));
    }
}
