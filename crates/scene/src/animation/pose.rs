//! All nodes of a model at a time of a clip.

use glam::{DAffine3, DQuat, DVec3, DVec4};

use super::curve::{Property, unit};
use super::similarity::nearest;
use super::{AnimatedModel, AnimatedNode, Clip};
use crate::parts::PartTransform;

/// Translation, rotation and scale of a node at a time.
#[derive(Clone, Copy, Debug)]
struct Local {
    translation: DVec3,
    rotation: DQuat,
    scale: DVec3,
}

impl Local {
    fn of(node: &AnimatedNode) -> Self {
        Self {
            translation: node.rest.translation.into(),
            rotation: unit(DVec4::from_array(node.rest.rotation)),
            scale: node.rest.scale.into(),
        }
    }
}

impl AnimatedModel {
    /// Transformations of all nodes to the model at a time of a clip, in seconds; as they rest without a clip. Cost: a
    /// search among the keyframes of each channel.
    #[must_use]
    pub fn nodes_at(&self, clip: Option<&Clip>, time_s: f64) -> Vec<DAffine3> {
        let mut locals: Vec<Local> = self.nodes.iter().map(Local::of).collect();
        for channel in clip.into_iter().flat_map(|clip| &clip.channels) {
            let times = self.timelines.get(channel.timeline as usize);
            let (Some(times), Some(local)) = (times, locals.get_mut(channel.node as usize)) else { continue };
            let value = channel.at(times, time_s);
            match channel.property {
                Property::Translation => local.translation = value.truncate(),
                Property::Rotation => local.rotation = DQuat::from_vec4(value),
                Property::Scale => local.scale = value.truncate(),
            }
        }
        let mut all: Vec<DAffine3> = Vec::with_capacity(self.nodes.len());
        for (node, local) in self.nodes.iter().zip(locals) {
            let above = node.parent.and_then(|parent| all.get(parent as usize)).copied().unwrap_or_default();
            let own =
                DAffine3::from_scale_rotation_translation(local.scale, local.rotation, local.translation);
            all.push(above * node.to_parent * own);
        }
        all
    }

    /// How each part moves within its instance at a time of a clip, before it is rounded to a similarity.
    #[must_use]
    pub fn maps_at(&self, clip: Option<&Clip>, time_s: f64) -> Vec<DAffine3> {
        self.maps_of(&self.nodes_at(clip, time_s))
    }

    fn maps_of(&self, nodes: &[DAffine3]) -> Vec<DAffine3> {
        let node = |number: u32| nodes.get(number as usize).copied().unwrap_or_default();
        self.parts.iter().map(|part| part.from_model * node(part.node) * part.to_node).collect()
    }

    /// How each part moves within its instance at a time of a clip. Uneven scales are made even.
    #[must_use]
    pub fn transforms_at(&self, clip: Option<&Clip>, time_s: f64) -> Vec<PartTransform> {
        self.transforms_of(&self.nodes_at(clip, time_s))
    }

    /// The same, of the nodes' transformations to the model.
    pub(super) fn transforms_of(&self, nodes: &[DAffine3]) -> Vec<PartTransform> {
        self.maps_of(nodes).iter().map(nearest).collect()
    }
}
