//! Parts that are moved within their instances, and instances that an animation moves as a whole.

use std::collections::BTreeMap;

use glam::DVec3;
use lodestream_scene::animation::{Moved, SkinPose};
use lodestream_scene::parts::{PartTransform, ScenePart};
use lodestream_scene::placement::Placement;

/// Transforms of the moved parts, by instance and part, and of the moved instances.
#[derive(Debug, Default)]
pub(super) struct MovedParts {
    parts: BTreeMap<u32, BTreeMap<u32, PartTransform>>,
    instances: BTreeMap<u32, PartTransform>,
    /// Poses of instances whose vertices follow joints, with the similarities that hold them.
    poses: BTreeMap<u32, (SkinPose, Vec<PartTransform>)>,
}

impl MovedParts {
    /// Sets the parts that are moved.
    pub(super) fn set_parts(&mut self, parts: &BTreeMap<ScenePart, PartTransform>) {
        self.parts.clear();
        for (part, transform) in parts {
            self.parts.entry(part.instance).or_default().insert(part.part, *transform);
        }
    }

    /// Sets the instances that an animation moves, with their parts.
    pub(super) fn set_animated(&mut self, Moved { instances, skins }: Moved) {
        self.instances = instances;
        let posed = skins.into_iter();
        self.poses = posed.map(|(instance, pose)| (instance, (pose.clone(), pose.similarities()))).collect();
    }

    /// The pose of an instance whose vertices follow joints.
    pub(super) fn pose(&self, instance: u32) -> Option<&SkinPose> {
        self.poses.get(&instance).map(|(pose, _)| pose)
    }

    /// Whether anything of an instance is moved.
    pub(super) fn moves(&self, instance: u32) -> bool {
        self.parts.contains_key(&instance) || self.instances.contains_key(&instance)
    }

    /// The transform of a part, if it is moved.
    pub(super) fn transform(&self, part: ScenePart) -> Option<PartTransform> {
        let own = self.parts.get(&part.instance).and_then(|parts| parts.get(&part.part));
        match (own, self.instances.get(&part.instance)) {
            (Some(own), Some(whole)) => Some(whole.after(own)),
            (own, whole) => own.or(whole).copied(),
        }
    }

    /// All transforms of an instance: that of the whole first; of one with a pose, those that hold it.
    fn of(&self, instance: u32) -> impl Iterator<Item = PartTransform> {
        let whole = self.instances.get(&instance).copied();
        let parts = self.parts.get(&instance).into_iter().flat_map(BTreeMap::values);
        let moved = move |own: &PartTransform| whole.map_or(*own, |whole| whole.after(own));
        let joints = self.poses.get(&instance).into_iter().flat_map(|(_, joints)| joints).copied();
        whole.into_iter().chain(parts.map(moved)).chain(joints)
    }

    /// A sphere about an instance, of which `sphere` is in units of its asset: centre and radius in the world.
    pub(super) fn sphere(&self, instance: u32, placement: &Placement, sphere: (DVec3, f64)) -> (DVec3, f64) {
        let moved: Vec<PartTransform> = self.of(instance).collect();
        let (centre, radius) = PartTransform::bounds(moved.iter(), sphere);
        (placement.to_world(centre), radius * f64::from(placement.scale))
    }

    /// Each transform once for each instance.
    pub(super) fn distinct(&self) -> Vec<(u32, PartTransform)> {
        let of_clips = self.instances.keys().chain(self.poses.keys());
        let mut instances: Vec<u32> = self.parts.keys().chain(of_clips).copied().collect();
        instances.sort_unstable();
        instances.dedup();
        let of = |instance: u32| {
            let all: Vec<PartTransform> = self.of(instance).collect();
            PartTransform::distinct(all.iter()).into_iter().map(move |transform| (instance, transform))
        };
        instances.into_iter().flat_map(of).collect()
    }
}
