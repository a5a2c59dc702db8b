//! Animations in the JSON of a file, as far as they are imported. A target without a node, as extensions have it, is no
//! error.

use lodestream_scene::animation::{Interpolation, Property};
use serde::Deserialize;

/// An animation.
#[derive(Deserialize)]
pub(super) struct Animation {
    pub(super) name: Option<Box<str>>,
    #[serde(default)]
    pub(super) channels: Box<[Channel]>,
    #[serde(default)]
    pub(super) samplers: Box<[Sampler]>,
}

/// What a channel animates.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Target {
    Node(Property),
    /// Weights of morph targets.
    Weights,
    /// Something of an extension.
    Other,
}

#[derive(Deserialize)]
#[serde(from = "RawChannel")]
pub(super) struct Channel {
    pub(super) sampler: usize,
    pub(super) node: Option<usize>,
    pub(super) target: Target,
}

#[derive(Deserialize)]
struct RawChannel {
    sampler: usize,
    target: RawTarget,
}

#[derive(Deserialize)]
struct RawTarget {
    node: Option<usize>,
    path: String,
}

impl From<RawChannel> for Channel {
    fn from(RawChannel { sampler, target: RawTarget { node, path } }: RawChannel) -> Self {
        let target = match &*path {
            "translation" => Target::Node(Property::Translation),
            "rotation" => Target::Node(Property::Rotation),
            "scale" => Target::Node(Property::Scale),
            "weights" => Target::Weights,
            _ => Target::Other,
        };
        Self { sampler, node, target }
    }
}

#[derive(Deserialize)]
#[serde(from = "RawSampler")]
pub(super) struct Sampler {
    /// Accessor of times.
    pub(super) input: usize,
    /// Accessor of values.
    pub(super) output: usize,
    /// `None` if unknown.
    pub(super) interpolation: Option<Interpolation>,
}

#[derive(Deserialize)]
struct RawSampler {
    input: usize,
    output: usize,
    interpolation: Option<String>,
}

impl From<RawSampler> for Sampler {
    fn from(RawSampler { input, output, interpolation }: RawSampler) -> Self {
        let interpolation = match interpolation.as_deref() {
            None | Some("LINEAR") => Some(Interpolation::Linear),
            Some("STEP") => Some(Interpolation::Step),
            Some("CUBICSPLINE") => Some(Interpolation::CubicSpline),
            Some(_) => None,
        };
        Self { input, output, interpolation }
    }
}
