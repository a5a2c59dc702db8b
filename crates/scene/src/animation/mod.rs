//! Animations of a scene: how instances move within the place that the scene description gives them.
//!
//! A model with animations is a blob ([`crate::BlobId::Animation`]): the nodes that move, the instances that hang on
//! them, and clips of keyframes as in glTF 2.0 (§3.11, appendix C). At a time of a clip each instance has a
//! [`PartTransform`](crate::parts::PartTransform), a similarity: it keeps its shape, and its errors scale with it; one
//! with a skin has a [`SkinPose`].
//! Scenes without animations have no such blob and no message about them.
//!
//! | module | contents |
//! |---|---|
//! | `curve` | one keyframe track at a time |
//! | `pose` | all nodes of a model at a time |
//! | `skin` | assets that follow the joints of a skeleton |
//! | `similarity` | the nearest similarity of an affine map |
//! | `coding` | a model as bytes |
//! | `playing` | the models of a scene, and a clip of them by name |

mod coding;
mod curve;
mod playing;
mod pose;
mod similarity;
mod skin;
#[cfg(test)]
mod tests;

use glam::DAffine3;

use crate::encoding::{CodingError, encode_fields};
pub use curve::{Channel, Interpolation, Property};
pub use playing::{Animations, ClipInfo, Moment, Moved};
pub use similarity::is_similarity;
pub use skin::{AnimatedSkin, MAX_SKIN_JOINTS, SkinJoint, SkinPose};

/// Most animated models of a scene.
pub const MAX_ANIMATED_MODELS: u32 = 1 << 12;
/// Longest blob of an animated model, in bytes.
pub const MAX_ANIMATION_BYTES: u32 = 16 << 20;
/// Most nodes, parts, timelines and places of a model, and channels of a clip.
pub const MAX_ENTRIES: usize = 1 << 16;
/// Most clips of a model.
pub const MAX_CLIPS: usize = 1 << 10;
/// Most joints of a model, and of a scene's, counted for each place: each is a map to compute for each frame.
pub const MAX_PLACED_JOINTS: usize = 1 << 16;
/// Longest name of a clip, in bytes of UTF-8.
pub const MAX_CLIP_NAME_BYTES: usize = 255;

/// The message about a scene's animated models: says that there are some.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AnimationTable {
    /// Number of models, 1 to [`MAX_ANIMATED_MODELS`].
    pub models: u32,
}

encode_fields!(AnimationTable { models });

impl AnimationTable {
    /// Checks the number of models.
    ///
    /// # Errors
    /// If it is out of range.
    pub fn check(&self) -> Result<(), AnimationError> {
        let valid = (1..=MAX_ANIMATED_MODELS).contains(&self.models);
        if valid { Ok(()) } else { Err(AnimationError::Models(self.models)) }
    }
}

/// A model of which parts move.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct AnimatedModel {
    /// Nodes that move, parents before their children.
    pub nodes: Vec<AnimatedNode>,
    /// Parts that hang on nodes.
    pub parts: Vec<AnimatedPart>,
    /// Assets that follow joints.
    pub skins: Vec<AnimatedSkin>,
    /// Where the model stands: for each place, the number of the scene's instance for each part, then for each skin.
    pub places: Vec<Vec<u32>>,
    /// Times of keyframes that channels share, in seconds, ascending and at least 0.
    pub timelines: Vec<Vec<f32>>,
    /// Clips.
    pub clips: Vec<Clip>,
}

/// A node that moves. At a time of a clip its transformation to the model is that of its parent, then `to_parent`, then
/// translation · rotation · scale.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AnimatedNode {
    /// Number of the nearest node above it that moves; less than its own.
    pub parent: Option<u32>,
    /// From the node's parent in the file to `parent`, or to the model: what lies between does not move.
    pub to_parent: DAffine3,
    /// Translation, rotation (quaternion x, y, z, w) and scale where no channel says otherwise.
    pub rest: Rest,
}

/// Translation, rotation and scale of a node.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rest {
    /// In units of the parent.
    pub translation: [f64; 3],
    /// Quaternion x, y, z, w of any length but 0.
    pub rotation: [f64; 4],
    /// Along the node's axes.
    pub scale: [f64; 3],
}

impl Default for Rest {
    fn default() -> Self {
        Self { translation: [0.0; 3], rotation: [0.0, 0.0, 0.0, 1.0], scale: [1.0; 3] }
    }
}

/// An asset that hangs on a node. It moves within its instance by `from_model` · node · `to_node`, the identity where the
/// node is as the scene description has it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AnimatedPart {
    /// Number of the node.
    pub node: u32,
    /// From the asset to the node.
    pub to_node: DAffine3,
    /// From the model to the asset.
    pub from_model: DAffine3,
}

/// A clip: a named animation.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Clip {
    /// Name for people; at most [`MAX_CLIP_NAME_BYTES`].
    pub name: String,
    /// At most one for a property of a node counts: the last.
    pub channels: Vec<Channel>,
}

/// An invalid table of animations, or blob of an animated model.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum AnimationError {
    /// None, or more than [`MAX_ANIMATED_MODELS`].
    #[error("a scene states {0} animated models; 1 to {MAX_ANIMATED_MODELS} are allowed")]
    Models(u32),
    /// Longer than [`MAX_ANIMATION_BYTES`].
    #[error("an animated model has {0} bytes; at most {MAX_ANIMATION_BYTES} are allowed")]
    TooLong(usize),
    /// An unknown format version.
    #[error("an animated model has format version {0}; update viewer or server")]
    Version(u8),
    /// Lists longer than [`MAX_ENTRIES`], clips beyond [`MAX_CLIPS`], or a name that is too long.
    #[error("an animated model has too many {0}")]
    TooMany(&'static str),
    /// A reference to what does not exist.
    #[error("an animated model refers to a {0} that does not exist")]
    NoSuch(&'static str),
    /// A number that is not finite, a zero quaternion, or a transformation that cannot be undone.
    #[error("an animated model has a {0} that is not finite or is degenerate")]
    Number(&'static str),
    /// Times that do not ascend from 0, or values that are not as many as the times need.
    #[error("an animated model has keyframes that do not fit their times")]
    Keyframes,
    /// A malformed number or text, or too few or too many bytes.
    #[error("an animated model is malformed: {0}")]
    Malformed(#[from] CodingError),
}

impl AnimatedModel {
    /// Checks all references and numbers. Places may name any instance: see [`Self::greatest_instance`].
    ///
    /// # Errors
    /// What is wrong first.
    pub fn check(&self) -> Result<(), AnimationError> {
        use AnimationError::{Keyframes, NoSuch, Number, TooMany};
        let ensure = |holds: bool, why: AnimationError| if holds { Ok(()) } else { Err(why) };
        let (parts, skins) = (self.parts.len(), self.skins.len());
        let lists = [self.nodes.len(), parts + skins, self.places.len(), self.timelines.len()];
        ensure(lists.iter().all(|&count| count <= MAX_ENTRIES), TooMany("entries"))?;
        ensure(self.clips.len() <= MAX_CLIPS, TooMany("clips"))?;
        for (number, node) in (0_u32..).zip(&self.nodes) {
            ensure(node.parent.is_none_or(|parent| parent < number), NoSuch("parent"))?;
            let Rest { translation, rotation, scale } = node.rest;
            let numbers = translation.iter().chain(&rotation).chain(&scale);
            let turns = rotation.iter().any(|x| *x != 0.0);
            ensure(numbers.copied().all(f64::is_finite) && turns, Number("node"))?;
            ensure(node.to_parent.is_finite(), Number("node"))?;
        }
        for part in &self.parts {
            ensure((part.node as usize) < self.nodes.len(), NoSuch("node"))?;
            ensure(part.to_node.is_finite() && part.from_model.is_finite(), Number("part"))?;
        }
        for skin in &self.skins {
            ensure(skin.joints.len() <= MAX_SKIN_JOINTS, TooMany("joints"))?;
            for joint in &skin.joints {
                ensure(joint.node.is_none_or(|node| (node as usize) < self.nodes.len()), NoSuch("node"))?;
                ensure(joint.to_node.is_finite(), Number("joint"))?;
            }
        }
        ensure(self.placed_joints() <= MAX_PLACED_JOINTS, TooMany("joints in all its places"))?;
        let moving = self.parts.len() + self.skins.len();
        ensure(self.places.iter().all(|place| place.len() == moving), NoSuch("part"))?;
        for times in &self.timelines {
            let ascend = times.is_sorted_by(|a, b| a < b) && times.iter().all(|t| t.is_finite() && *t >= 0.0);
            ensure(ascend && !times.is_empty(), Keyframes)?;
        }
        for clip in &self.clips {
            ensure(clip.name.len() <= MAX_CLIP_NAME_BYTES, TooMany("bytes in a clip's name"))?;
            ensure(clip.channels.len() <= MAX_ENTRIES, TooMany("channels"))?;
            for channel in &clip.channels {
                ensure((channel.node as usize) < self.nodes.len(), NoSuch("node"))?;
                let times = self.timelines.get(channel.timeline as usize).ok_or(NoSuch("timeline"))?;
                ensure(channel.values.len() == channel.values_for(times.len()), Keyframes)?;
                ensure(channel.values.iter().all(|value| value.is_finite()), Number("keyframe"))?;
            }
        }
        Ok(())
    }

    /// Joints of its skins, counted for each place, at least once.
    #[must_use]
    pub fn placed_joints(&self) -> usize {
        let joints: usize = self.skins.iter().map(|skin| skin.joints.len()).sum();
        joints.saturating_mul(self.places.len().max(1))
    }

    /// The greatest number of an instance that it moves.
    #[must_use]
    pub fn greatest_instance(&self) -> Option<u32> {
        self.places.iter().flatten().copied().max()
    }

    /// Duration of a clip in seconds: its last keyframe.
    #[must_use]
    pub fn duration_s(&self, clip: &Clip) -> f64 {
        let ends =
            clip.channels.iter().filter_map(|channel| self.timelines.get(channel.timeline as usize)?.last());
        ends.fold(0.0, |end, &time| f64::from(time).max(end))
    }

    /// Approximate memory, in bytes.
    #[must_use]
    pub fn memory_bytes(&self) -> usize {
        let channels = || self.clips.iter().flat_map(|clip| &clip.channels);
        self.nodes.len() * size_of::<AnimatedNode>()
            + self.parts.len() * size_of::<AnimatedPart>()
            + self.skins.iter().map(|skin| skin.joints.len() * size_of::<SkinJoint>()).sum::<usize>()
            + self.places.len() * (self.parts.len() + self.skins.len()) * size_of::<u32>()
            + self.timelines.iter().map(|times| times.len() * size_of::<f32>()).sum::<usize>()
            + channels()
                .map(|channel| size_of::<Channel>() + channel.values.len() * size_of::<f32>())
                .sum::<usize>()
    }
}
