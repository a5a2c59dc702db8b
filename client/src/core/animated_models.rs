//! The scene's animated models: which have arrived. They are few, and wanted as soon as something can be drawn.

use std::sync::Arc;

use lodestream_scene::animation::{
    AnimatedModel, AnimationError, AnimationTable, Animations, MAX_PLACED_JOINTS,
};
use lodestream_scene::blob::BlobId;
use lodestream_select::{State, Wanted, priority};

/// Why the blob of an animated model cannot be used.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub(super) enum AnimationBlobError {
    /// Only a part of it has arrived.
    #[error("only a part of it has arrived")]
    Partial,
    /// It is invalid.
    #[error(transparent)]
    Animation(#[from] AnimationError),
    /// It moves an instance that the scene does not have.
    #[error("it moves instance {0}, which the scene does not have")]
    NoSuchInstance(u32),
    /// Its skins and those of the models before it have more than [`MAX_PLACED_JOINTS`].
    #[error("the scene's skins have more than {MAX_PLACED_JOINTS} joints in all their places")]
    TooManyJoints,
    /// The scene has fewer.
    #[error("there is no such animation")]
    Unknown,
}

/// States of all animated models, and those that have arrived.
#[derive(Debug)]
pub(super) struct AnimatedModels {
    states: Vec<State>,
    pub(super) arrived: Animations,
}

impl AnimatedModels {
    /// Starts from the message, whose number has been checked.
    pub(super) fn new(table: AnimationTable) -> Self {
        Self { states: vec![State::Absent; table.models as usize], arrived: Animations::default() }
    }

    pub(super) fn state(&self, model: u32) -> State {
        self.states.get(model as usize).copied().unwrap_or_default()
    }

    pub(super) fn set_state(&mut self, model: u32, state: State) {
        if let Some(held) = self.states.get_mut(model as usize) {
            *held = state;
        }
    }

    /// Adds the models that have not arrived to `wanted`, which is ordered by priority, and those that failed to `failed`.
    /// Returns whether none is left to request.
    pub(super) fn want(&self, wanted: &mut Vec<Wanted>, failed: &mut Vec<BlobId>) -> bool {
        let before = wanted.len();
        for (model, &state) in (0..).zip(&self.states) {
            let id = BlobId::Animation(model);
            match state {
                State::Failed => failed.push(id),
                State::Absent | State::InFlight => {
                    wanted.push(Wanted::whole(id, priority::DIRECTORY, None, state))
                }
                State::Cached | State::Applied => {}
            }
        }
        let wants = wanted.len() > before;
        if wants {
            // A stable sort keeps the selection's order.
            wanted.sort_by_key(|wanted| std::cmp::Reverse(wanted.priority));
        }
        !wants
    }

    /// Decodes a complete blob of a scene with so many instances.
    pub(super) fn take(
        &mut self,
        model: u32,
        bytes: &[u8],
        instances: u32,
    ) -> Result<Arc<AnimatedModel>, AnimationBlobError> {
        if model as usize >= self.states.len() {
            return Err(AnimationBlobError::Unknown);
        }
        let animated = Arc::new(AnimatedModel::from_bytes(bytes)?);
        if let Some(instance) = animated.greatest_instance().filter(|instance| *instance >= instances) {
            return Err(AnimationBlobError::NoSuchInstance(instance));
        }
        let joints = self.arrived.models().map(|(_, model)| model.placed_joints()).sum::<usize>();
        if !animated.skins.is_empty() && joints + animated.placed_joints() > MAX_PLACED_JOINTS {
            return Err(AnimationBlobError::TooManyJoints);
        }
        self.arrived.insert(model, Arc::clone(&animated));
        self.set_state(model, State::Applied);
        Ok(animated)
    }
}
