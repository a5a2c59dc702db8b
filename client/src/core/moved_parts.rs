//! Parts that are moved within their instances.

use std::collections::BTreeMap;

use glam::DVec3;
use lodestream_scene::parts::{PartTransform, ScenePart};
use lodestream_scene::placement::Placement;

/// Transforms of the moved parts, by instance and part.
#[derive(Debug, Default)]
pub(super) struct MovedParts(BTreeMap<u32, BTreeMap<u32, PartTransform>>);

impl MovedParts {
    pub(super) fn new(parts: &BTreeMap<ScenePart, PartTransform>) -> Self {
        let mut this = Self::default();
        for (part, transform) in parts {
            this.0.entry(part.instance).or_default().insert(part.part, *transform);
        }
        this
    }

    /// The moved parts of an instance, if it has any.
    pub(super) fn of(&self, instance: u32) -> Option<&BTreeMap<u32, PartTransform>> {
        self.0.get(&instance)
    }

    /// The transform of a part, if it is moved.
    pub(super) fn transform(&self, part: ScenePart) -> Option<&PartTransform> {
        self.of(part.instance)?.get(&part.part)
    }

    /// A sphere about an instance, of which `sphere` is in units of its asset: centre and radius in the world.
    pub(super) fn sphere(&self, instance: u32, placement: &Placement, sphere: (DVec3, f64)) -> (DVec3, f64) {
        let moved = self.of(instance).into_iter().flat_map(BTreeMap::values);
        let (centre, radius) = PartTransform::bounds(moved, sphere);
        (placement.to_world(centre), radius * f64::from(placement.scale))
    }

    /// Each transform once for each instance.
    pub(super) fn distinct(&self) -> Vec<(u32, PartTransform)> {
        let of = |(&instance, parts): (&u32, &BTreeMap<u32, PartTransform>)| {
            PartTransform::distinct(parts.values()).into_iter().map(move |transform| (instance, transform))
        };
        self.0.iter().flat_map(of).collect()
    }
}
