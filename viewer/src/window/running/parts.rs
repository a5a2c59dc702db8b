//! Clicks and keys on parts of the scene.

use super::Running;
use crate::args::Args;
use crate::parts;

impl Running {
    /// Whether an answer about the scene is awaited.
    pub(in crate::window) fn awaits_answer(&self) -> bool {
        self.selection.awaits_answer()
            || self.measure.awaits_answer()
            || self.pivot.awaits_answer()
            || self.section.awaits_answer()
            || self.part_list.awaits_answer()
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
        let (selected, fitted) = {
            let (gpu, settings) = (&self.painter.gpu, &self.settings);
            self.selection.receive(gpu, streaming, &mut self.scene, settings)?
        };
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
}
