//! Parts of a [`SceneView`]: which are hidden, tinted, moved or isolated.

use std::collections::{BTreeMap, BTreeSet};

use lodestream_scene::parts::{PartTransform, ScenePart};

use super::SceneView;
use crate::resources::gpu::{Gpu, RenderError};
use crate::resources::vertex::MAX_PARTS;
use crate::scene::part_states::PartState;
use crate::scene::scene_parts::HiddenParts;

impl SceneView {
    /// Hides, tints or moves parts, or shows them as they are. Parts of instances that have not arrived take their state when
    /// they do; another scene begins without states. Cost: a pass over all parts with a state, and a write to the device
    /// per asset concerned; no pipeline, mesh or draw changes, and nothing is requested. Draw a frame afterwards.
    ///
    /// PN triangles and ink follow only where a whole instance is hidden; there, moved parts stay where they were.
    ///
    /// # Errors
    /// [`RenderError::NoSuch`] for a part from [`MAX_PARTS`] on; nothing is changed then. [`RenderError::TooLarge`] for
    /// states beyond the device's limit of textures.
    pub fn set_parts(&mut self, gpu: &Gpu, parts: &[(ScenePart, PartState)]) -> Result<(), RenderError> {
        check(parts.iter().map(|(part, _)| *part))?;
        let touched: BTreeSet<u32> =
            parts.iter().filter_map(|(part, state)| self.parts.set(*part, *state)).collect();
        self.write_part_states(gpu, |asset| touched.contains(&asset))
    }

    /// Draws these parts alone, without other parts and instances; terrain stays. They keep tints, and hidden ones stay
    /// hidden. `None` ends the isolation.
    ///
    /// # Errors
    /// As [`SceneView::set_parts`].
    pub fn isolate_parts(&mut self, gpu: &Gpu, parts: Option<&[ScenePart]>) -> Result<(), RenderError> {
        check(parts.unwrap_or_default().iter().copied())?;
        self.parts.isolate(parts.map(|parts| parts.iter().copied().collect()));
        self.write_part_states(gpu, |_| true)
    }

    /// Shows all parts as they are: nothing hidden, tinted, moved or isolated.
    ///
    /// # Errors
    /// As [`SceneView::set_parts`].
    pub fn clear_parts(&mut self, gpu: &Gpu) -> Result<(), RenderError> {
        self.parts.clear();
        self.write_part_states(gpu, |_| true)
    }

    /// How a part is drawn: hidden too if others are isolated.
    #[must_use]
    pub fn part_state(&self, part: ScenePart) -> PartState {
        self.parts.state(part)
    }

    /// The instances for which no proxy may stand, ascending: proxies do not show states of parts. Tell the client
    /// (`ClientCore::pin_instances`).
    #[must_use]
    pub fn pinned_instances(&self) -> Vec<u32> {
        self.parts.instances()
    }

    /// The parts that are moved. Tell the client (`ClientCore::move_parts`), so that picking and refinement follow. Cost: a
    /// pass over all parts with a state.
    #[must_use]
    pub fn moved_parts(&self) -> BTreeMap<ScenePart, PartTransform> {
        self.parts.moved()
    }

    /// Which parts are hidden now; picking on another thread skips them. Cost: a copy of all parts with a state.
    #[must_use]
    pub fn hidden_parts(&self) -> HiddenParts {
        self.parts.hidden()
    }

    /// Writes the states of an asset that has just arrived.
    pub(super) fn write_part_states_of(&mut self, gpu: &Gpu, number: u32) -> Result<(), RenderError> {
        if self.parts.is_empty() {
            return Ok(());
        }
        let Some(Some(asset)) = self.assets.get_mut(number as usize) else { return Ok(()) };
        let (mut states, unlisted) = self.parts.by_asset();
        asset.set_part_states(gpu, states.remove(&number).unwrap_or(unlisted))
    }

    /// Writes the states of those assets that have arrived and are concerned.
    pub(super) fn write_part_states(
        &mut self,
        gpu: &Gpu,
        concerned: impl Fn(u32) -> bool,
    ) -> Result<(), RenderError> {
        let (mut states, unlisted) = self.parts.by_asset();
        for (number, asset) in (0..).zip(&mut self.assets) {
            if let Some(asset) = asset.as_mut().filter(|_| concerned(number)) {
                asset.set_part_states(gpu, states.remove(&number).unwrap_or_else(|| unlisted.clone()))?;
            }
        }
        Ok(())
    }
}

fn check(mut parts: impl Iterator<Item = ScenePart>) -> Result<(), RenderError> {
    match parts.find(|part| part.part >= MAX_PARTS) {
        None => Ok(()),
        Some(part) => {
            Err(RenderError::NoSuch { what: "part", index: part.part as usize, count: MAX_PARTS as usize })
        }
    }
}
