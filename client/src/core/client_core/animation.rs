//! Animations: what they move, for picking and refinement. The renderer moves what it draws by itself.

use lodestream_protocol::time::Time;
use lodestream_scene::animation::{Animations, Moment};
use lodestream_scene::blob::BlobId;
use lodestream_select::State;

use super::ClientCore;
use super::state::ReceivedBlob;
use crate::core::animated_models::{AnimatedModels, AnimationBlobError};
use crate::core::changes::Change;

impl ClientCore {
    /// Sets the clip and time at which animated instances are, instead of that set before; `None`: where the scene's
    /// description has them. Picking, bounds and refinement follow, and no proxy stands for the instances. Cost: that of
    /// [`Animations::moved`], and for each selection as much as an instance for each that moves, and for each joint of a
    /// skin; a tenth of a second apart is often enough.
    pub fn animate(&mut self, moment: Option<Moment>) {
        if self.moment != moment {
            self.moment = moment;
            self.follow_animations();
        }
    }

    /// The animated models that have arrived.
    #[must_use]
    pub fn animations(&self) -> Option<&Animations> {
        self.scene.animations.as_ref().map(|models| &models.arrived)
    }

    pub(super) fn follow_animations(&mut self) {
        let moved = self.animations().map(|models| models.moved(self.moment.as_ref()));
        self.moved.set_animated(moved.unwrap_or_default());
        self.selection.selector.set_moved(self.moved.distinct());
        self.selection.stale = true;
    }

    /// Takes the blob of an animated model, if it was requested.
    pub(super) fn receive_animation(&mut self, now: Time, model: u32, received: &ReceivedBlob) {
        let &ReceivedBlob { id, offset, total, ref bytes } = received;
        let instances = self.scene.header.as_ref().map_or(0, |header| header.instance_count);
        let models = self.scene.animations.as_mut();
        let Some(models) = models.filter(|models| models.state(model) != State::Applied) else { return };
        let whole = offset == 0 && bytes.len() == total as usize;
        match if whole { models.take(model, bytes, instances) } else { Err(AnimationBlobError::Partial) } {
            Ok(animated) => {
                self.failures.clear(id);
                if self.config.track_changes {
                    self.scene.push_change(Change::Animation { number: model, model: animated });
                }
                self.follow_animations();
            }
            Err(why) => self.mark_failed(now, id, &why.into()),
        }
    }

    /// Adds the animated models to what the selection wants, once something can be drawn. Returns whether none is left to
    /// request.
    pub(super) fn want_animations(&mut self) -> bool {
        let Some(models) = self.scene.animations.as_ref() else { return true };
        if self.milestones.first_frame.is_none() {
            return false;
        }
        models.want(&mut self.selection.wanted, &mut self.selection.failed)
    }

    pub(super) fn animation_state(&self, id: BlobId) -> Option<State> {
        let BlobId::Animation(model) = id else { return None };
        self.scene.animations.as_ref().map(|models| models.state(model))
    }

    pub(super) fn set_animations(&mut self, table: lodestream_scene::animation::AnimationTable) {
        self.scene.animations.get_or_insert_with(|| AnimatedModels::new(table));
    }
}
