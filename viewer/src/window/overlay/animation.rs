//! Controls of the animation: which clip is shown, and at what time. They are shown for scenes with clips only.

use lodestream_scene::animation::ClipInfo;
use lodestream_viewing::Playback;

/// Width of the slider of the time, in points.
const SLIDER_WIDTH: f32 = 320.0;

/// Draws the controls at the lower border; returns whether they have changed the playback.
pub(in crate::window) fn show(ui: &mut egui::Ui, clips: &[ClipInfo], playback: &mut Playback) -> bool {
    let Some((_, clip)) = playback.clip(clips) else { return false };
    let before = playback.clone();
    let context = ui.ctx().clone();
    let frame = egui::Frame::window(&context.global_style()).multiply_with_opacity(0.8);
    let area =
        egui::Area::new(egui::Id::unique("animation")).anchor(egui::Align2::CENTER_BOTTOM, [0.0, -12.0]);
    area.show(&context, |ui| {
        frame.show(ui, |ui| {
            ui.style_mut().override_text_style = Some(egui::TextStyle::Small);
            ui.horizontal(|ui| controls(ui, clips, clip, playback));
        })
    });
    *playback != before
}

fn controls(ui: &mut egui::Ui, clips: &[ClipInfo], clip: &ClipInfo, playback: &mut Playback) {
    if ui.button(if playback.is_playing() { "pause" } else { "play" }).clicked() {
        playback.toggle();
    }
    let mut name = clip.name.clone();
    egui::ComboBox::from_id_salt("clip").selected_text(&clip.name).show_ui(ui, |ui| {
        for clip in clips {
            ui.selectable_value(&mut name, clip.name.clone(), &clip.name);
        }
    });
    if name != clip.name {
        return playback.choose(&name);
    }
    ui.spacing_mut().slider_width = SLIDER_WIDTH;
    let mut time_s = playback.time_s(clip);
    let range = 0.0..=clip.duration_s.max(f64::MIN_POSITIVE);
    // Rounded for display alone: a slider that rounds its value would change it by itself.
    let slider = egui::Slider::new(&mut time_s, range).custom_formatter(|time_s, _| format!("{time_s:.2} s"));
    if ui.add(slider).changed() {
        playback.scrub(time_s);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_clip_is_drawn_with_its_name_and_scenes_without_clips_draw_nothing() {
        let clips = [ClipInfo { name: "walk".into(), duration_s: 2.0 }];
        for (clips, drawn) in [(&clips[..], true), (&[], false)] {
            let mut playback = Playback::new(None, 0.123_456, true);
            let context = egui::Context::default();
            let mut shapes = 0;
            // An area is measured before it is drawn.
            for _ in 0..3 {
                let area = egui::Rect::from_min_size(egui::Pos2::ZERO, egui::vec2(640.0, 360.0));
                let input = egui::RawInput { screen_rect: Some(area), ..egui::RawInput::default() };
                let mut output = context.run_ui(input, |ui| assert!(!show(ui, clips, &mut playback)));
                output.textures_delta.clear();
                let text = |shape: &egui::Shape| matches!(shape, egui::Shape::Text(text) if text.galley.text() == "walk");
                shapes = output.shapes.iter().filter(|clipped| has(&clipped.shape, &text)).count();
            }
            assert_eq!(shapes > 0, drawn);
        }
    }

    fn has(shape: &egui::Shape, is: &impl Fn(&egui::Shape) -> bool) -> bool {
        match shape {
            egui::Shape::Vec(shapes) => shapes.iter().any(|shape| has(shape, is)),
            shape => is(shape),
        }
    }
}
