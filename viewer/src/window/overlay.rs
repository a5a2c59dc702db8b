//! What is written over the picture, and what can be changed there.

use std::time::Duration;

use lodestream_client::core::{Milestone, Stats};
use lodestream_render::{AmbientOcclusion, Counters, Settings, Shade, Shadows};

use crate::outcome::lacks;

/// What the user may change.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Choices {
    /// Screen error to refine to, in pixels.
    pub(super) target_px: f32,
    /// The selection stays with the view of the moment it was frozen.
    pub(super) frozen: bool,
    /// Frames are drawn worse while the camera moves, as far as the device needs.
    pub(super) adapt: bool,
    /// Messages alone are shown.
    pub(super) hidden: bool,
    pub(super) wireframe: bool,
    pub(super) shade: Shade,
    pub(super) occlusion: bool,
    pub(super) shadows: bool,
    pub(super) antialias: bool,
    pub(super) relief: bool,
}

impl Choices {
    pub(super) fn new(settings: &Settings, target_px: f32) -> Self {
        Self {
            target_px,
            frozen: false,
            adapt: true,
            hidden: false,
            wireframe: settings.wireframe,
            shade: settings.shade,
            occlusion: settings.occlusion.is_some(),
            shadows: settings.shadows.is_some(),
            antialias: settings.antialias,
            relief: settings.relief,
        }
    }

    pub(super) fn apply(&self, settings: &mut Settings) {
        settings.wireframe = self.wireframe;
        settings.shade = self.shade;
        settings.occlusion = self.occlusion.then(AmbientOcclusion::default);
        settings.shadows = self.shadows.then(Shadows::default);
        settings.antialias = self.antialias;
        settings.relief = self.relief;
    }
}

/// How far the picture is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) enum State {
    /// It will change.
    #[default]
    Refining,
    /// It is as sharp as asked for and will stay as it is.
    Settled,
    /// It will stay as it is, but lacks something that does not come.
    Incomplete,
}

/// What is shown and not part of [`Stats`].
#[derive(Clone, Debug, Default)]
pub(super) struct Facts<'a> {
    pub(super) adapter: &'a str,
    pub(super) address: &'a str,
    pub(super) message: Option<&'a str>,
    pub(super) frame_ms: f64,
    pub(super) fps: f64,
    pub(super) bits_per_s: f64,
    pub(super) presented: Option<Duration>,
    pub(super) state: State,
    pub(super) quality: String,
    pub(super) mode: &'static str,
    pub(super) camera: String,
    pub(super) draw: Counters,
    pub(super) gpu_bytes: u64,
    pub(super) waiting_steps: usize,
}

/// Draws the overlay.
pub(super) fn show(ui: &mut egui::Ui, stats: &Stats, facts: &Facts<'_>, choices: &mut Choices) {
    let context = ui.ctx().clone();
    if let Some(message) = facts.message {
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
        ui.style_mut().override_text_style = Some(egui::TextStyle::Small);
        egui::Grid::new("figures").num_columns(2).spacing([10.0, 0.0]).show(ui, |ui| {
            for (name, value) in rows(stats, facts) {
                ui.label(name);
                ui.label(value);
                ui.end_row();
            }
        });
        ui.separator();
        ui.horizontal(|ui| {
            ui.label("pixel error");
            let slider =
                egui::Slider::new(&mut choices.target_px, 0.1..=64.0).logarithmic(true).max_decimals(2);
            ui.add(slider.suffix(" px"));
        });
        ui.horizontal_wrapped(|ui| {
            ui.checkbox(&mut choices.frozen, "freeze selection");
            ui.checkbox(&mut choices.wireframe, "wireframe");
        });
        ui.horizontal_wrapped(|ui| {
            ui.label("colours");
            ui.selectable_value(&mut choices.shade, Shade::Material, "material");
            ui.selectable_value(&mut choices.shade, Shade::Level, "level");
            ui.selectable_value(&mut choices.shade, Shade::Cascade, "shadow map");
        });
        ui.horizontal_wrapped(|ui| {
            ui.checkbox(&mut choices.occlusion, "ambient occlusion");
            ui.checkbox(&mut choices.shadows, "shadows");
            ui.checkbox(&mut choices.relief, "relief");
            ui.checkbox(&mut choices.antialias, "smooth edges");
            ui.checkbox(&mut choices.adapt, "coarser while moving");
        });
        ui.separator();
        ui.small("drag: turn · right drag: pan · wheel: nearer · F: fly or orbit · WASD QE: move · R: reset · H: hide this");
    });
}

fn rows(stats: &Stats, facts: &Facts<'_>) -> Vec<(&'static str, String)> {
    let ms = |d: Option<Duration>| d.map_or("–".into(), |d| format!("{:.0} ms", d.as_secs_f64() * 1e3));
    let c = &stats.counters;
    let px = |px: f64| if px.is_finite() { format!("{px:.2} px") } else { "–".into() };
    let first = stats.milestones.first_frame;
    let at = |m: Option<Milestone>| match m {
        Some(m) => format!("{} at {}", ms(Some(m.after)), bytes(m.bytes)),
        None => "–".into(),
    };
    let [seen, everywhere] = [stats.milestones.seen_quality[2], stats.milestones.quality[2]];
    let state = match facts.state {
        State::Settled => "settled".to_owned(),
        State::Refining => "refining".to_owned(),
        State::Incomplete => lacks(stats.lacking_blobs, &stats.lacking),
    };
    vec![
        ("scene", format!("{} ({}/{} instances)", stats.scene, stats.instances, stats.scene_instances)),
        ("server", facts.address.to_owned()),
        ("graphics", facts.adapter.to_owned()),
        ("frame", format!("{:.1} ms ({:.1} fps)", facts.frame_ms, facts.fps)),
        (
            "first frame",
            format!(
                "{} at {}, shown {}",
                ms(first.map(|m| m.after)),
                first.map_or("–".into(), |m| bytes(m.bytes)),
                ms(facts.presented)
            ),
        ),
        ("error ≤ 1 px", format!("where seen {}, everywhere {}", at(seen), at(everywhere))),
        ("received", format!("{} ({:.2} Mbit/s)", bytes(stats.transport_bytes), facts.bits_per_s / 1e6)),
        (
            "chunks",
            format!(
                "{} wanted · {} in flight · {} applied",
                c.missing_chunks, stats.session.in_flight_blobs, stats.applied_chunks
            ),
        ),
        (
            "screen error",
            format!(
                "{}, where seen {} (threshold {}), {state}",
                px(c.max_screen_error_px),
                px(c.seen_screen_error_px),
                px(c.threshold_px)
            ),
        ),
        ("quality", facts.quality.clone()),
        ("faces", format!("{} refined · {} drawn", thousands(stats.faces), thousands(facts.draw.triangles))),
        (
            "memory",
            format!(
                "meshes {} · GPU {} · cache {}{}",
                bytes(stats.mesh_bytes),
                bytes(facts.gpu_bytes),
                bytes(stats.cached_bytes),
                if facts.waiting_steps > 0 {
                    format!(" · {} steps wait", facts.waiting_steps)
                } else {
                    String::new()
                }
            ),
        ),
        ("camera", format!("{}: {}", facts.mode, facts.camera)),
    ]
}

/// Bytes for people.
fn bytes(bytes: u64) -> String {
    let b = bytes as f64;
    match bytes {
        0..10_000 => format!("{bytes} B"),
        10_000..10_000_000 => format!("{:.1} kB", b / 1e3),
        _ => format!("{:.1} MB", b / 1e6),
    }
}

/// A number with spaces between thousands.
fn thousands(n: u64) -> String {
    let digits = n.to_string();
    let mut out = String::new();
    for (i, c) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            out.push('\u{202f}');
        }
        out.push(c);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_readable() {
        assert_eq!(bytes(1234), "1234 B");
        assert_eq!(bytes(12_345), "12.3 kB");
        assert_eq!(bytes(12_345_678), "12.3 MB");
        assert_eq!(thousands(1_234_567), "1\u{202f}234\u{202f}567");
        assert_eq!(thousands(12), "12");
    }
}
