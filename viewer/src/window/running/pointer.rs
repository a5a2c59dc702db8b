//! The pointer: drags, the wheel, clicks, and tools that answer them.

use std::time::Duration;

use lodestream_client::core::Ray;
use winit::dpi::PhysicalPosition;
use winit::event::MouseButton;

use super::Running;
use crate::window::clicks::CLICK_PX;
use crate::window::measure::Accuracy;
use crate::window::overlay::Panel;
use crate::window::part_list::PartRequest;
use crate::window::selection;
use crate::window::visible::Visible;

/// Turns of the wheel that a pinch to twice the size is.
const PINCH_LINES: f64 = 5.5;

impl Running {
    /// Handles a button that went down or up over the scene or, if `consumed`, over the overlay.
    pub(in crate::window) fn button(&mut self, button: MouseButton, pressed: bool, consumed: bool) {
        if pressed {
            self.pressed_at = self.pointer;
            if button == MouseButton::Left && !consumed {
                let ray = self.pointer_ray();
                if let Some(streaming) = &self.streaming {
                    self.pivot.press(ray, streaming, Visible::of(&self.scene, &self.settings));
                }
            }
        } else if self.button == Some(MouseButton::Left) && button == MouseButton::Left {
            self.pivot.release();
            if !consumed && !self.is_dragged() {
                self.click();
            } else {
                self.clicks.forget();
            }
        }
        self.button = (pressed && !consumed).then_some(button);
    }

    /// Whether the pointer is away from where the button was pressed.
    fn is_dragged(&self) -> bool {
        let (dx, dy) = (self.pointer.x - self.pressed_at.x, self.pointer.y - self.pressed_at.y);
        dx.hypot(dy) >= CLICK_PX
    }

    /// The pointer has moved; returns whether the camera has.
    pub(in crate::window) fn drag(&mut self, to: PhysicalPosition<f64>) -> bool {
        let (dx, dy) = (to.x - self.pointer.x, to.y - self.pointer.y);
        self.pointer = to;
        let height = f64::from(self.painter.size()[1]);
        let Some(controller) = &mut self.controller else { return false };
        match self.button {
            Some(MouseButton::Left) => match self.pivot.turn() {
                Some(pivot) => controller.turn_about(pivot + glam::DVec3::Y * self.rise, dx, dy),
                None => controller.turn(dx, dy),
            },
            Some(MouseButton::Right | MouseButton::Middle) => controller.pan(dx, dy, height),
            _ => return false,
        }
        self.camera_moved();
        true
    }

    /// Turns of the wheel; returns whether the camera has moved.
    pub(in crate::window) fn wheel(&mut self, lines: f64) -> bool {
        let (at, ray) = ([self.pointer.x, self.pointer.y], self.pointer_ray());
        let Some(controller) = &mut self.controller else { return false };
        let moved = match &self.streaming {
            Some(streaming) => {
                let visible = Visible::of(&self.scene, &self.settings);
                self.pivot.wheel(at, lines, controller, ray, streaming, visible)
            }
            None => {
                controller.wheel(lines);
                true
            }
        };
        if moved {
            self.zoomed();
        }
        moved
    }

    /// A pinch by a share of the size; returns whether the camera has moved.
    pub(in crate::window) fn pinch(&mut self, share: f64) -> bool {
        let lines = (1.0 + share).max(0.1).log2() * PINCH_LINES;
        self.wheel(lines)
    }

    fn zoomed(&mut self) {
        self.selection.forget_frame();
        self.keys.stop_turntable();
        self.quality.moved(self.now());
    }

    /// Records that the camera was moved by hand, which stops the turntable.
    pub(in crate::window) fn camera_moved(&mut self) {
        self.pivot.forget_zoom();
        self.zoomed();
    }

    fn click(&mut self) {
        let (at, frame) = ([self.pointer.x, self.pointer.y], Duration::from_secs_f64(self.frame_ms / 1e3));
        let ray = self.pointer_ray();
        if self.measure.is_active() {
            if let Some(streaming) = &self.streaming {
                self.measure.click(ray, streaming, Visible::of(&self.scene, &self.settings));
            }
            return;
        }
        if self.clicks.click(self.now(), at, frame) {
            return self.frame_pointer();
        }
        if let Some(streaming) = &self.streaming {
            self.selection.pick(ray, streaming, Visible::of(&self.scene, &self.settings));
        }
    }

    /// Asks what is under the pointer, to move the camera to it.
    pub(super) fn frame_pointer(&mut self) {
        let ray = self.pointer_ray();
        if let Some(streaming) = &self.streaming {
            self.selection.frame(ray, streaming, Visible::of(&self.scene, &self.settings));
        }
    }

    fn pointer_ray(&self) -> Ray {
        let [width, height] = self.painter.size();
        selection::ray(&self.camera(), [self.pointer.x, self.pointer.y], (width, height), self.rise)
    }

    /// Takes answers for the wheel, the points that are measured and the list of parts; returns whether the picture
    /// may change.
    pub(super) fn update_tools(&mut self) -> anyhow::Result<bool> {
        let accuracy = self.accuracy();
        let Some(streaming) = &mut self.streaming else { return Ok(false) };
        let mut changed = false;
        if let Some(controller) = &mut self.controller
            && self.pivot.receive(controller)
        {
            self.keys.stop_turntable();
            self.quality.moved(self.clock.now().into());
            changed = true;
        }
        let visible = || Visible::of(&self.scene, &self.settings);
        changed |= self.measure.receive(&accuracy, streaming, visible);
        changed |= self.section.receive(streaming);
        for part in self.selection.selected().into_iter().chain(self.measure.part()) {
            self.part_list.look_up(part, streaming);
        }
        if self.choices.panel == Some(Panel::Parts) {
            self.part_list.refresh(streaming);
        }
        changed |= self.part_list.receive(streaming);
        match self.part_list.request.take() {
            Some(PartRequest::Select(part)) => {
                self.selection.go_to(part, &self.painter.gpu, &mut self.scene, streaming)?;
                self.scene_changed();
            }
            Some(PartRequest::SetHidden(part, hidden)) => {
                self.selection.set_hidden(part, hidden, &self.painter.gpu, &mut self.scene)?;
                self.scene_changed();
            }
            None => {}
        }
        Ok(changed)
    }

    fn accuracy(&self) -> Accuracy {
        let [width, height] = self.painter.size();
        let (_, up) = self.camera().tan_half_fov(width, height);
        let error_px = self.status.status().stats.counters.max_screen_error_px;
        Accuracy { error_px, per_px: 2.0 * up / f64::from(height.max(1)) }
    }
}
