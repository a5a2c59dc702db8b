//! Animations of a [`SceneView`]: instances are drawn where a clip has them at a time.

use std::collections::BTreeMap;

use lodestream_scene::animation::{Animations, Moment, Moved, SkinPose};

use super::SceneView;
use crate::resources::gpu::{Gpu, RenderError};
use crate::scene::scene_parts::SceneParts;

impl SceneView {
    /// Draws animated instances where a clip has them at a time, instead of the one set before; `None`: where the scene's
    /// description has them, and vertices where their joints rest. Holds for later scenes too. Tell the client
    /// (`ClientCore::animate`), so that picking and refinement follow. Cost: that of [`Animations::moved`], a copy of the
    /// placements of assets that move, and a write to the device of 48 bytes a joint for each instance with a skin. PN
    /// triangles and ink show vertices where the asset has them.
    ///
    /// # Errors
    /// [`RenderError::TooLarge`] for poses beyond the device's limit of textures.
    pub fn animate(&mut self, gpu: &Gpu, moment: Option<Moment>) -> Result<(), RenderError> {
        if self.moment == moment {
            return Ok(());
        }
        self.moment = moment;
        self.follow_animations(gpu)
    }

    /// What is shown of the animations.
    #[must_use]
    pub const fn moment(&self) -> Option<&Moment> {
        self.moment.as_ref()
    }

    /// The animated models that have arrived.
    #[must_use]
    pub const fn animations(&self) -> &Animations {
        &self.animations
    }

    /// Moves instances and vertices to where they are now.
    pub(super) fn follow_animations(&mut self, gpu: &Gpu) -> Result<(), RenderError> {
        self.animated.clear();
        if self.animations.is_empty() {
            return Ok(());
        }
        let Moved { instances, skins } = self.animations.moved(self.moment.as_ref());
        // Instances may not have arrived.
        let place = |parts: &SceneParts, instance: u32| parts.places().get(instance as usize).copied();
        for (instance, transform) in instances {
            let Some((asset, index)) = place(&self.parts, instance) else { continue };
            let Some(placed) = self.instances.get(asset as usize) else { continue };
            let moved = self.animated.entry(asset).or_insert_with(|| placed.clone());
            if let (Some(to), Some(from)) = (moved.get_mut(index as usize), placed.get(index as usize)) {
                *to = transform.within(from);
            }
        }
        let mut poses: BTreeMap<u32, BTreeMap<u32, SkinPose>> = BTreeMap::new();
        for (instance, pose) in skins {
            let Some((asset, index)) = place(&self.parts, instance) else { continue };
            poses.entry(asset).or_default().insert(index, pose);
        }
        let changed = self.parts.set_poses(poses);
        self.write_part_states(gpu, |asset| changed.contains(&asset))
    }
}
