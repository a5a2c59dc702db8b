//! The part that was clicked, and what keys do to it.

use glam::DVec3;
use lodestream_client::core::{Hit, PartBounds, Ray};
use lodestream_client::streaming::{Answer, Streaming};
use lodestream_render::{Gpu, PartState, RenderError, SceneView};
use lodestream_scene::parts::ScenePart;
use winit::keyboard::KeyCode;

use crate::parts::tinted;

/// Colour of the selected part.
const COLOUR: [u8; 3] = [255, 140, 0];

/// The selected part.
#[derive(Clone, Copy, Debug)]
struct Selected {
    part: ScenePart,
    /// Its state without the selection's tint.
    own: PartState,
}

/// The selection, and what is asked about it.
#[derive(Debug, Default)]
pub(super) struct Selection {
    /// Fingerprint of the scene whose parts these are.
    scene: Option<[u8; 16]>,
    selected: Option<Selected>,
    picking: Option<Answer<Option<Hit>>>,
    fitting: Option<Answer<Option<PartBounds>>>,
}

impl Selection {
    /// Whether the view shows another scene than before, which begins without selection and states.
    pub(super) fn is_new_scene(&mut self, scene: &SceneView) -> bool {
        let fingerprint = scene.header().map(|header| header.fingerprint);
        if self.scene == fingerprint {
            return false;
        }
        *self = Self { scene: fingerprint, ..Self::default() };
        true
    }

    /// The selected part, for the overlay.
    pub(super) fn describe(&self) -> String {
        self.selected.map_or_else(
            || "none (click)".into(),
            |Selected { part: ScenePart { instance, part }, .. }| format!("{instance}:{part}"),
        )
    }

    /// Whether an answer is awaited.
    pub(super) const fn awaits_answer(&self) -> bool {
        self.picking.is_some() || self.fitting.is_some()
    }

    /// Asks which part a ray meets.
    pub(super) fn pick(&mut self, ray: Ray, streaming: &Streaming, scene: &SceneView) {
        let hidden = scene.hidden_parts();
        // An answer to an earlier click is not wanted any more.
        self.picking = streaming.ask(move |core| core.pick(ray, |part| hidden.contains(part))).ok();
    }

    /// Takes answers that have come; returns whether the picture changes, and the bounds to move the camera to.
    pub(super) fn receive(
        &mut self,
        gpu: &Gpu,
        scene: &mut SceneView,
    ) -> Result<(bool, Option<PartBounds>), RenderError> {
        let picked = answered(&mut self.picking);
        if let Some(hit) = picked {
            self.select(hit.map(|hit| hit.part), gpu, scene)?;
        }
        Ok((picked.is_some(), answered(&mut self.fitting).flatten()))
    }

    fn select(
        &mut self,
        part: Option<ScenePart>,
        gpu: &Gpu,
        scene: &mut SceneView,
    ) -> Result<(), RenderError> {
        if let Some(Selected { part, own }) = self.selected.take() {
            scene.set_parts(gpu, &[(part, own)])?;
        }
        if let Some(part) = part {
            let own = PartState { hidden: false, ..scene.part_state(part) };
            scene.set_parts(gpu, &[(part, tinted(COLOUR))])?;
            self.selected = Some(Selected { part, own });
        }
        Ok(())
    }

    /// Handles a key that went down; returns whether the picture changes.
    pub(super) fn key(
        &mut self,
        code: KeyCode,
        gpu: &Gpu,
        scene: &mut SceneView,
        streaming: &Streaming,
    ) -> Result<bool, RenderError> {
        match (code, self.selected) {
            (KeyCode::KeyX, Some(Selected { part, own })) => {
                self.selected = None;
                scene.set_parts(gpu, &[(part, PartState { hidden: true, ..own })])?;
            }
            (KeyCode::KeyI, Some(Selected { part, .. })) => scene.isolate_parts(gpu, Some(&[part]))?,
            (KeyCode::KeyU, _) => {
                self.selected = None;
                scene.clear_parts(gpu)?;
            }
            (KeyCode::KeyZ, Some(Selected { part, .. })) => {
                self.fitting = streaming.ask(move |core| core.part_bounds(part)).ok();
                return Ok(false);
            }
            _ => return Ok(false),
        }
        Ok(true)
    }
}

/// Takes an answer once it is there; forgets a question that will not be answered.
fn answered<T>(question: &mut Option<Answer<T>>) -> Option<T> {
    let taken = question.as_mut()?.take();
    if !matches!(taken, Ok(None)) {
        *question = None;
    }
    taken.ok().flatten()
}

/// A ray through a place of the picture; `rise` is that of the ground below the eye by its exaggeration, which the
/// streamed scene does not have.
pub(super) fn ray(pose: &lodestream_render::Pose, at: [f64; 2], size: (u32, u32), rise: f64) -> Ray {
    Ray { origin: pose.eye - DVec3::Y * rise, direction: pose.direction(at, size) }
}
