//! Clicks and keys on parts of the scene.

use winit::event::MouseButton;

use super::Running;
use crate::args::Args;
use crate::parts;
use crate::window::selection;

/// Movement of the pointer, in pixels, from which on a click is a drag.
const CLICK_PX: f64 = 4.0;

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
        if let (Some(bounds), Some(controller)) = (fitted, &mut self.controller) {
            let [width, height] = self.painter.size().map(|side| f64::from(side.max(1)));
            let centre = bounds.centre + glam::DVec3::Y * self.rise;
            controller.fit(centre, bounds.radius, width / height);
            self.quality.moved(self.now());
        }
        Ok(new || selected || fitted.is_some())
    }

    /// Handles a button that went down or up over the scene or, if `consumed`, over the overlay.
    pub(in crate::window) fn button(&mut self, button: MouseButton, pressed: bool, consumed: bool) {
        if pressed {
            self.pressed_at = self.pointer;
        } else if self.button == Some(MouseButton::Left) && button == MouseButton::Left && !consumed {
            let (dx, dy) = (self.pointer.x - self.pressed_at.x, self.pointer.y - self.pressed_at.y);
            if dx.hypot(dy) < CLICK_PX
                && let Some(streaming) = &self.streaming
            {
                let [width, height] = self.painter.size();
                let at = [self.pointer.x, self.pointer.y];
                let ray = selection::ray(&self.camera(), at, (width, height), self.rise);
                self.selection.pick(ray, streaming, &self.scene);
            }
        }
        self.button = (pressed && !consumed).then_some(button);
    }
}
