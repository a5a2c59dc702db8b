//! The animated models of a scene together: clips by name, and where all instances are at a time.

use std::collections::BTreeMap;
use std::sync::Arc;

use super::{AnimatedModel, Clip, SkinPose};
use crate::parts::PartTransform;

/// A clip of a scene's models.
#[derive(Clone, Debug, PartialEq)]
pub struct ClipInfo {
    /// Its name.
    pub name: String,
    /// Duration in seconds: the longest of the models that have it.
    pub duration_s: f64,
}

/// What is shown of a scene's animations.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Moment {
    /// Name of the clip.
    pub clip: String,
    /// Time in seconds.
    pub time_s: f64,
}

/// How instances move within their places, by number.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Moved {
    /// Instances that keep their shape.
    pub instances: BTreeMap<u32, PartTransform>,
    /// Instances whose vertices follow joints.
    pub skins: BTreeMap<u32, SkinPose>,
}

/// The animated models of a scene that have arrived.
#[derive(Clone, Debug, Default)]
pub struct Animations {
    models: BTreeMap<u32, Arc<AnimatedModel>>,
}

impl Animations {
    /// Adds a model by its number.
    pub fn insert(&mut self, number: u32, model: Arc<AnimatedModel>) {
        self.models.insert(number, model);
    }

    /// Whether there is none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.models.is_empty()
    }

    /// The models, by number.
    pub fn models(&self) -> impl Iterator<Item = (u32, &Arc<AnimatedModel>)> {
        self.models.iter().map(|(number, model)| (*number, model))
    }

    /// The clips of all models, each name once, in the order of the models.
    #[must_use]
    pub fn clips(&self) -> Vec<ClipInfo> {
        let mut clips: Vec<ClipInfo> = Vec::new();
        let mut known: BTreeMap<&str, usize> = BTreeMap::new();
        for model in self.models.values() {
            for clip in &model.clips {
                let duration_s = model.duration_s(clip);
                match known.get(&*clip.name) {
                    Some(&at) => clips[at].duration_s = clips[at].duration_s.max(duration_s),
                    None => {
                        known.insert(&clip.name, clips.len());
                        clips.push(ClipInfo { name: clip.name.clone(), duration_s });
                    }
                }
            }
        }
        clips
    }

    /// How instances move. A model plays its clip of the moment's name, or its first if it has none, again and again; its
    /// nodes rest without a moment, which moves what has a skin whose joints rest elsewhere. Cost: a search among the
    /// keyframes of each channel.
    #[must_use]
    pub fn moved(&self, moment: Option<&Moment>) -> Moved {
        let mut moved = Moved::default();
        for model in self.models.values() {
            let named = moment.and_then(|moment| model.clips.iter().find(|own| own.name == moment.clip));
            let clip = named.or(model.clips.first()).filter(|_| moment.is_some());
            let time_s = moment.zip(clip).map_or(0.0, |(moment, clip)| repeated(model, clip, moment.time_s));
            if clip.is_none() && model.skins.is_empty() {
                continue;
            }
            let nodes = model.nodes_at(clip, time_s);
            let poses = model.poses_of(&nodes);
            let transforms = if clip.is_some() { model.transforms_of(&nodes) } else { Vec::new() };
            for place in &model.places {
                moved.instances.extend(place.iter().copied().zip(transforms.iter().copied()));
                let skinned = place.iter().skip(model.parts.len()).copied().zip(&poses);
                let skinned = skinned.filter(|(_, pose)| !pose.is_still());
                moved.skins.extend(skinned.map(|(instance, pose)| (instance, pose.clone())));
            }
        }
        moved
    }
}

/// The time within a clip that is repeated; its end is shown too.
fn repeated(model: &AnimatedModel, clip: &Clip, time_s: f64) -> f64 {
    let duration_s = model.duration_s(clip);
    if (0.0..=duration_s).contains(&time_s) || duration_s <= 0.0 {
        time_s
    } else {
        time_s.rem_euclid(duration_s)
    }
}
