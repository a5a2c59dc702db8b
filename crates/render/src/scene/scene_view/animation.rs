//! Animations of a [`SceneView`]: instances are drawn where a clip has them at a time.

use lodestream_scene::animation::{Animations, Moment};

use super::SceneView;

impl SceneView {
    /// Draws animated instances where a clip has them at a time, instead of the one set before; `None`: where the scene's
    /// description has them. Holds for later scenes too. Tell the client (`ClientCore::animate`), so that picking and
    /// refinement follow. Cost: that of [`Animations::transforms`], and a copy of the placements of assets that move.
    pub fn animate(&mut self, moment: Option<Moment>) {
        if self.moment != moment {
            self.moment = moment;
            self.follow_animations();
        }
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

    /// Moves instances to where they are now.
    pub(super) fn follow_animations(&mut self) {
        self.animated.clear();
        let Some(moment) = self.moment.as_ref().filter(|_| !self.animations.is_empty()) else { return };
        for (instance, transform) in self.animations.transforms(moment) {
            // Instances may not have arrived.
            let Some(&(asset, index)) = self.parts.places().get(instance as usize) else { continue };
            let Some(placed) = self.instances.get(asset as usize) else { continue };
            let moved = self.animated.entry(asset).or_insert_with(|| placed.clone());
            if let (Some(to), Some(from)) = (moved.get_mut(index as usize), placed.get(index as usize)) {
                *to = transform.within(from);
            }
        }
    }
}
