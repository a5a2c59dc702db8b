//! Clicks and keys on parts of the scene.

use std::time::Duration;

use lodestream_client::core::Ray;
use winit::event::MouseButton;

use super::Running;
use crate::args::Args;
use crate::parts;
use crate::window::clicks::CLICK_PX;
use crate::window::selection;

impl Running {
    /// Whether an answer about a part is awaited.
    pub(in crate::window) fn awaits_answer(&self) -> bool {
        self.selection.awaits_answer()
    }

    /// Takes answers about the selected part, and what the command line says of parts of a new scene. Returns whether
    /// the picture may change.
    pub(super) fn update_parts(&mut self, args: &Args) -> anyhow::Result<bool> {
        let new = self.selection.is_new_scene(&self.scene);
        if new {
            parts::apply(args, &self.painter.gpu, &mut self.scene)?;
        }
        let Some(streaming) = &self.streaming else { return Ok(new) };
        streaming.pin_instances(self.selection.pinned_instances(&self.scene));
        streaming.move_parts(self.scene.moved_parts());
        let (selected, fitted) = self.selection.receive(&self.painter.gpu, streaming, &mut self.scene)?;
        let framed = self.selection.receive_frame();
        if let (Some(None), Some(controller)) = (framed, &mut self.controller) {
            controller.reset();
            self.camera_moved();
        }
        let fitted = fitted.or(framed.flatten());
        if let (Some(bounds), Some(controller)) = (fitted, &mut self.controller) {
            let [width, height] = self.painter.size().map(|side| f64::from(side.max(1)));
            let centre = bounds.centre + glam::DVec3::Y * self.rise;
            controller.fit(centre, bounds.radius, width / height);
            self.camera_moved();
        }
        Ok(new || selected || fitted.is_some() || framed.is_some())
    }

    /// Handles a button that went down or up over the scene or, if `consumed`, over the overlay.
    pub(in crate::window) fn button(&mut self, button: MouseButton, pressed: bool, consumed: bool) {
        if pressed {
            self.pressed_at = self.pointer;
        } else if self.button == Some(MouseButton::Left) && button == MouseButton::Left && !consumed {
            let (dx, dy) = (self.pointer.x - self.pressed_at.x, self.pointer.y - self.pressed_at.y);
            if dx.hypot(dy) < CLICK_PX {
                self.click();
            } else {
                self.clicks.forget();
            }
        }
        self.button = (pressed && !consumed).then_some(button);
    }

    fn click(&mut self) {
        let (at, frame) = ([self.pointer.x, self.pointer.y], Duration::from_secs_f64(self.frame_ms / 1e3));
        if self.clicks.click(self.now(), at, frame) {
            return self.frame_pointer();
        }
        let ray = self.pointer_ray();
        if let Some(streaming) = &self.streaming {
            self.selection.pick(ray, streaming, &self.scene);
        }
    }

    /// Asks what is under the pointer, to move the camera to it.
    pub(super) fn frame_pointer(&mut self) {
        let ray = self.pointer_ray();
        if let Some(streaming) = &self.streaming {
            self.selection.frame(ray, streaming, &self.scene);
        }
    }

    fn pointer_ray(&self) -> Ray {
        let [width, height] = self.painter.size();
        selection::ray(&self.camera(), [self.pointer.x, self.pointer.y], (width, height), self.rise)
    }
}
