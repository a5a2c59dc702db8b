//! Parts of a scene that are hidden, tinted, moved or isolated.

use std::collections::{BTreeMap, BTreeSet};

use lodestream_scene::animation::SkinPose;
use lodestream_scene::parts::{PartTransform, ScenePart};

use crate::scene::part_states::{InstanceStates, PartState, PartStates};

/// Which parts are hidden at a time, for picking ([`crate::SceneView::hidden_parts`]).
#[derive(Clone, Debug, Default)]
pub struct HiddenParts {
    hidden: BTreeSet<ScenePart>,
    isolated: Option<BTreeSet<ScenePart>>,
}

impl HiddenParts {
    /// Whether a part is hidden, or others are isolated.
    #[must_use]
    pub fn contains(&self, part: ScenePart) -> bool {
        self.hidden.contains(&part)
            || self.isolated.as_ref().is_some_and(|isolated| !isolated.contains(&part))
    }
}

/// States by part of the scene, whether or not their instances have arrived.
#[derive(Debug, Default)]
pub(crate) struct SceneParts {
    states: BTreeMap<ScenePart, PartState>,
    /// The only parts to be drawn, if there are such.
    isolated: Option<BTreeSet<ScenePart>>,
    /// Of each arrived instance its asset, and its index among the asset's instances.
    places: Vec<(u32, u32)>,
    /// States of the assets of proxies that are drawn without some of their parts.
    proxies: BTreeMap<u32, PartStates>,
    /// Poses of instances whose vertices follow joints, by asset and index among the asset's instances.
    poses: BTreeMap<u32, BTreeMap<u32, SkinPose>>,
}

impl SceneParts {
    /// Notes the next instance; returns whether its asset's states change by it.
    pub(crate) fn add_instance(&mut self, asset: u32, index: u32) -> bool {
        let instance = u32::try_from(self.places.len()).unwrap_or(u32::MAX);
        self.places.push((asset, index));
        let own = ScenePart { instance, part: 0 }..=ScenePart { instance, part: u32::MAX };
        let isolated = self.isolated.as_ref().is_some_and(|parts| parts.range(own.clone()).next().is_some());
        isolated || self.states.range(own).next().is_some()
    }

    /// Of each arrived instance its asset, and its index among the asset's instances.
    pub(crate) fn places(&self) -> &[(u32, u32)] {
        &self.places
    }

    /// Sets a part's state; returns its asset, once that is known.
    pub(crate) fn set(&mut self, part: ScenePart, state: PartState) -> Option<u32> {
        if state == PartState::default() {
            self.states.remove(&part);
        } else {
            self.states.insert(part, state);
        }
        Some(self.places.get(part.instance as usize)?.0)
    }

    /// Sets the states of the assets of proxies; returns those that change.
    pub(crate) fn set_proxies(&mut self, proxies: BTreeMap<u32, PartStates>) -> BTreeSet<u32> {
        let before = std::mem::replace(&mut self.proxies, proxies);
        let numbers = before.keys().chain(self.proxies.keys()).copied();
        numbers.filter(|asset| before.get(asset) != self.proxies.get(asset)).collect()
    }

    /// Sets the poses of instances, by asset and index; returns the assets whose poses change.
    pub(crate) fn set_poses(&mut self, poses: BTreeMap<u32, BTreeMap<u32, SkinPose>>) -> BTreeSet<u32> {
        let before = std::mem::replace(&mut self.poses, poses);
        let numbers = before.keys().chain(self.poses.keys()).copied();
        numbers.filter(|asset| before.get(asset) != self.poses.get(asset)).collect()
    }

    pub(crate) fn isolate(&mut self, parts: Option<BTreeSet<ScenePart>>) {
        self.isolated = parts;
    }

    /// Forgets all states.
    pub(crate) fn clear(&mut self) {
        self.states.clear();
        self.isolated = None;
    }

    /// Whether all parts are drawn as they are, and all vertices where they are.
    pub(crate) fn is_empty(&self) -> bool {
        let parts = self.states.is_empty() && self.isolated.is_none();
        parts && self.proxies.is_empty() && self.poses.is_empty()
    }

    pub(crate) fn hidden(&self) -> HiddenParts {
        let hidden = self.states.iter().filter(|(_, state)| state.hidden).map(|(part, _)| *part);
        HiddenParts { hidden: hidden.collect(), isolated: self.isolated.clone() }
    }

    /// The parts that are moved.
    pub(crate) fn moved(&self) -> BTreeMap<ScenePart, PartTransform> {
        self.states.iter().filter_map(|(part, state)| Some((*part, state.transform?))).collect()
    }

    /// The instances that have parts with a state or isolated ones, ascending.
    pub(crate) fn instances(&self) -> Vec<u32> {
        let isolated = self.isolated.iter().flatten();
        let mut all: Vec<u32> = self.states.keys().chain(isolated).map(|part| part.instance).collect();
        all.sort_unstable();
        all.dedup();
        all
    }

    /// How a part is drawn.
    pub(crate) fn state(&self, part: ScenePart) -> PartState {
        let own = self.states.get(&part).copied().unwrap_or_default();
        let others = self.isolated.as_ref().is_some_and(|isolated| !isolated.contains(&part));
        PartState { hidden: own.hidden || others, ..own }
    }

    /// States of those assets that have parts with one, and the states of all other assets. Cost: a pass over all
    /// parts that have a state or are isolated.
    pub(crate) fn by_asset(&self) -> (BTreeMap<u32, PartStates>, PartStates) {
        let others = if self.isolated.is_some() { PartState::HIDDEN } else { PartState::default() };
        let unlisted = PartStates { others, ..Default::default() };
        let mut assets: BTreeMap<u32, PartStates> = BTreeMap::new();
        let mut add = |part: ScenePart| {
            let Some(&(asset, index)) = self.places.get(part.instance as usize) else { return };
            let instances = &mut assets.entry(asset).or_insert_with(|| unlisted.clone()).instances;
            let instance =
                instances.entry(index).or_insert(InstanceStates { others, parts: BTreeMap::new() });
            instance.parts.insert(part.part, self.state(part));
        };
        match &self.isolated {
            Some(isolated) => isolated.iter().for_each(|part| add(*part)),
            None => {
                self.states.keys().for_each(|part| add(*part));
                assets.extend(self.proxies.iter().map(|(asset, states)| (*asset, states.clone())));
            }
        }
        for (&asset, poses) in &self.poses {
            assets.entry(asset).or_insert_with(|| unlisted.clone()).poses.clone_from(poses);
        }
        (assets, unlisted)
    }
}
