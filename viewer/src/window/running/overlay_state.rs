//! What the overlay shows of a window.

use glam::DVec3;
use lodestream_render::{HiddenParts, Timings};
use lodestream_viewing::Mode;

use super::Running;
use crate::window::overlay::{OverlayState, Panel};

impl Running {
    /// What the overlay shows; the picture `shows` the scene.
    pub(super) fn overlay_state(&mut self, shows: bool) -> OverlayState {
        let lists_parts = self.choices.panel == Some(Panel::Parts);
        let name = if self.status.status().stats.scene.is_empty() {
            self.address.clone()
        } else {
            self.status.status().stats.scene.clone()
        };
        OverlayState {
            bindings: self.keys.bindings(),
            adapter: self.adapter.clone(),
            address: self.address.clone(),
            name,
            is_empty: self.is_empty(),
            message: self.message(shows),
            progress: self.progress(),
            tool: self.measure.describe(|part| self.part_list.in_file(part)),
            marks: self.measure.places().into_iter().map(|place| self.pixel_of(place)).collect(),
            hidden_parts: if lists_parts { self.scene.hidden_parts() } else { HiddenParts::default() },
            selected: self.selection.selected(),
            section_position: self.section.position(),
            frame_ms: self.frame_ms,
            fps: self.fps,
            bits_per_s: self.bits_per_s,
            presented: self.shown.presented(),
            state: self.state,
            quality: if self.choices.adapt { self.quality.describe() } else { "full".into() },
            mode: match self.controller.map(|controller| controller.mode) {
                Some(Mode::Fly) => "fly",
                _ if self.controller.is_some_and(|controller| controller.orthographic) => "orthographic",
                _ => "orbit",
            },
            camera: self.controller.map(|controller| controller.describe()).unwrap_or_default(),
            part: self.describe_selected(),
            draw: self.counters.clone(),
            gpu_bytes: self.scene.geometry_bytes(),
            waiting_steps: self.scene.waiting(),
            times: if self.choices.timed { self.painter.renderer.timings() } else { Timings::default() },
        }
    }

    fn describe_selected(&self) -> String {
        self.selection.selected().map_or_else(
            || "none (click)".into(),
            |part| {
                let numbers = format!("{}:{}", part.instance, part.part);
                let name = self.part_list.name(part);
                if name == numbers { numbers } else { format!("{name} ({numbers})") }
            },
        )
    }

    /// What is being loaded, if it is not streamed.
    fn progress(&self) -> Option<String> {
        let opening = self.opening.as_ref().map(|opening| &opening.files);
        opening.or(self.files.as_ref()).and_then(|files| files.progress())
    }

    /// Where a place of the streamed scene is in the picture, in pixels; `None` behind the eye.
    fn pixel_of(&self, place: DVec3) -> Option<[f64; 2]> {
        let [width, height] = self.painter.size();
        let pose = self.camera();
        let local = pose.rotation.conjugate() * (place + DVec3::Y * self.rise - pose.eye);
        let (across, up) = pose.tan_half_fov(width, height);
        let depth = -local.z;
        let to_px = |share: f64, px: u32| (share * 0.5 + 0.5) * f64::from(px);
        (depth > 0.0)
            .then(|| [to_px(local.x / (depth * across), width), to_px(-local.y / (depth * up), height)])
    }
}
