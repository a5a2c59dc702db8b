//! What of a scene a ray can meet: what is neither hidden nor cut away.

use lodestream_client::core::{ClientCore, Hit, Ray};
use lodestream_render::{HiddenParts, SceneView, Settings};
use lodestream_scene::section::SectionPlanes;

/// What is neither hidden nor cut away.
#[derive(Clone, Debug)]
pub(super) struct Visible {
    hidden: HiddenParts,
    planes: SectionPlanes,
}

impl Visible {
    /// What a frame of these settings shows.
    pub(super) fn of(scene: &SceneView, settings: &Settings) -> Self {
        Self { hidden: scene.hidden_parts(), planes: settings.sections }
    }

    /// The nearest surface on a ray.
    pub(super) fn pick(&self, core: &ClientCore, ray: Ray) -> Option<Hit> {
        core.pick_cut(ray, &self.planes, |part| self.hidden.contains(part))
    }
}
