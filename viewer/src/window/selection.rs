//! The part that was clicked, and what keys do to it.

use glam::DVec3;
use lodestream_client::core::{Hit, PartBounds, Ray};
use lodestream_client::streaming::{Answer, Streaming};
use lodestream_render::{Gpu, PartState, RenderError, SceneView, Settings};
use lodestream_scene::parts::ScenePart;

use super::keyboard::Action;
use super::visible::Visible;
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

/// A ray that met a proxy, which does not know the parts of its instances: it is asked again once they are drawn.
#[derive(Debug)]
struct BehindProxy {
    ray: Ray,
    instances: Vec<u32>,
    /// Questions left.
    left: u32,
}

/// Radius of the bounds about a place on a proxy, as a share of its distance.
const PROXY_SHARE: f64 = 0.1;
/// Questions about a ray, one a frame: an instance that cannot be drawn has no end.
const MOST_QUESTIONS: u32 = 2_000;

/// The selection, and what is asked about it.
#[derive(Debug, Default)]
pub(super) struct Selection {
    /// Fingerprint of the scene whose parts these are.
    scene: Option<[u8; 16]>,
    selected: Option<Selected>,
    picking: Option<(Ray, Answer<Option<Hit>>)>,
    behind_proxy: Option<BehindProxy>,
    fitting: Option<Answer<Option<PartBounds>>>,
    framing: Option<Answer<Option<PartBounds>>>,
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

    /// The selected part.
    pub(super) fn selected(&self) -> Option<ScenePart> {
        self.selected.map(|selected| selected.part)
    }

    /// Selects a part and asks for its bounds, to move the camera to.
    pub(super) fn go_to(
        &mut self,
        part: ScenePart,
        gpu: &Gpu,
        scene: &mut SceneView,
        streaming: &Streaming,
    ) -> Result<(), RenderError> {
        self.select(Some(part), gpu, scene)?;
        self.fitting = streaming.ask(move |core| core.part_bounds(part)).ok();
        Ok(())
    }

    /// Hides a part, or draws it again.
    pub(super) fn set_hidden(
        &mut self,
        part: ScenePart,
        hidden: bool,
        gpu: &Gpu,
        scene: &mut SceneView,
    ) -> Result<(), RenderError> {
        if self.selected() == Some(part) {
            self.select(None, gpu, scene)?;
        }
        let state = scene.part_state(part);
        scene.set_parts(gpu, &[(part, PartState { hidden, ..state })])
    }

    /// Whether an answer is awaited.
    pub(super) const fn awaits_answer(&self) -> bool {
        self.picking.is_some()
            || self.behind_proxy.is_some()
            || self.fitting.is_some()
            || self.framing.is_some()
    }

    /// Instances that must be drawn themselves: those with states, and one of which a part is wanted.
    pub(super) fn pinned_instances(&self, scene: &SceneView) -> Vec<u32> {
        let mut instances = scene.pinned_instances();
        instances.extend(self.behind_proxy.iter().flat_map(|behind| &behind.instances));
        instances
    }

    /// Asks which part a ray meets.
    pub(super) fn pick(&mut self, ray: Ray, streaming: &Streaming, visible: Visible) {
        // An answer to an earlier click is not wanted any more.
        self.behind_proxy = None;
        self.ask(ray, streaming, visible);
    }

    /// Asks for the bounds of the part that a ray meets, to move the camera to; of what is known as a proxy only, bounds
    /// that bring it nearer.
    pub(super) fn frame(&mut self, ray: Ray, streaming: &Streaming, visible: Visible) {
        let answer = streaming.ask(move |core| {
            let hit = visible.pick(core, ray)?;
            let radius = hit.distance * PROXY_SHARE;
            let around = [hit.place - radius, hit.place + radius];
            let nearer = PartBounds { extent: around, centre: hit.place, radius };
            hit.scene_part().map_or(Some(nearer), |part| core.part_bounds(part))
        });
        self.framing = answer.ok();
    }

    /// Forgets where the camera was to be moved: it was moved otherwise since.
    pub(super) fn forget_frame(&mut self) {
        (self.framing, self.fitting) = (None, None);
    }

    fn ask(&mut self, ray: Ray, streaming: &Streaming, visible: Visible) {
        let answer = streaming.ask(move |core| visible.pick(core, ray));
        self.picking = answer.ok().map(|answer| (ray, answer));
    }

    /// Takes answers that have come; returns whether the picture changes, and the bounds to move the camera to.
    pub(super) fn receive(
        &mut self,
        gpu: &Gpu,
        streaming: &Streaming,
        scene: &mut SceneView,
        settings: &Settings,
    ) -> Result<(bool, Option<PartBounds>), RenderError> {
        let mut answer = self.picking.take();
        let picked = answer.as_mut().map(|(ray, answer)| (*ray, answer.take()));
        let mut changes = false;
        match picked {
            Some((_, Ok(None))) => self.picking = answer,
            Some((ray, Ok(Some(Some(hit))))) if hit.part.is_none() => {
                let new = || BehindProxy { ray, instances: Vec::new(), left: MOST_QUESTIONS };
                let behind = self.behind_proxy.get_or_insert_with(new);
                if !behind.instances.contains(&hit.instance) {
                    behind.instances.push(hit.instance);
                }
            }
            Some((_, Ok(Some(hit)))) => {
                self.behind_proxy = None;
                self.select(hit.and_then(|hit| hit.scene_part()), gpu, scene)?;
                changes = true;
            }
            Some((_, Err(_))) => self.behind_proxy = None,
            None => {
                if let Some(mut behind) = self.behind_proxy.take_if(|behind| behind.left > 0) {
                    self.ask(behind.ray, streaming, Visible::of(scene, settings));
                    behind.left -= 1;
                    self.behind_proxy = Some(behind);
                } else {
                    self.behind_proxy = None;
                }
            }
        }
        Ok((changes, answered(&mut self.fitting).flatten()))
    }

    /// Takes the answer to [`Self::frame`], if it has come: the bounds to move the camera to, or `None` if the ray met
    /// nothing.
    pub(super) fn receive_frame(&mut self) -> Option<Option<PartBounds>> {
        answered(&mut self.framing)
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

    /// Does what a key is for; returns whether the picture changes.
    pub(super) fn act(
        &mut self,
        action: Action,
        gpu: &Gpu,
        scene: &mut SceneView,
        streaming: &Streaming,
    ) -> Result<bool, RenderError> {
        match (action, self.selected) {
            (Action::HidePart, Some(Selected { part, own })) => {
                self.selected = None;
                scene.set_parts(gpu, &[(part, PartState { hidden: true, ..own })])?;
            }
            (Action::IsolatePart, Some(Selected { part, .. })) => scene.isolate_parts(gpu, Some(&[part]))?,
            (Action::ShowAll, _) => {
                // A click that is not answered yet selects nothing any more.
                (self.selected, self.picking, self.behind_proxy) = (None, None, None);
                scene.clear_parts(gpu)?;
            }
            (Action::GoToPart, Some(Selected { part, .. })) => {
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
