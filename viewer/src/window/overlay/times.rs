//! Times of passes.

use std::time::Duration;

use lodestream_render::Timings;

/// Times of passes, a row each.
pub(super) fn times(ui: &mut egui::Ui, times: &Timings) {
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
