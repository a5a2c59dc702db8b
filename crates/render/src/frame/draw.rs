//! Draw lists: culls instances, and sorts them from near to far.

use glam::DVec3;
use lodestream_scene::placement::Placement;

use crate::frame::batch::Batch;
use crate::frame::camera::may_see;
use crate::frame::counters::Counters;
use crate::frame::receivers::Receivers;
use crate::frame::settings::Frame;
use crate::scene::asset::AssetGpu;
use crate::scene::bound_material::Features;
use crate::scene::placement::InstanceRaw;

/// The visible instances of a frame.
pub(crate) struct DrawList<'a> {
    pub(crate) instances: Vec<InstanceRaw>,
    pub(crate) batches: Vec<Batch<'a>>,
    /// Index within its drawable of each instance of `batches`.
    places: Vec<u32>,
    /// Region that receives light.
    pub(crate) receivers: Receivers,
}

impl<'a> DrawList<'a> {
    /// Culls instances that are hidden, outside the view or with positions that are not finite; sorts the rest front to
    /// back for the depth test.
    pub(crate) fn new(frame: &Frame<'a>, size: (u32, u32), counters: &mut Counters) -> Self {
        let (instances, batches, places) = (Vec::new(), Vec::new(), Vec::new());
        let mut list = Self { instances, batches, places, receivers: Receivers::NONE };
        for (number, drawable) in frame.drawables.iter().enumerate().filter(|(_, d)| d.asset.is_drawable()) {
            let mut seen: Vec<_> = drawable
                .instances
                .iter()
                .enumerate()
                .filter_map(|(index, instance)| {
                    let states = drawable.asset.part_states(index)?;
                    let sphere = drawable.asset.sphere_of(index);
                    Some((index as u32, place(instance, states, (drawable.asset, sphere), frame, size)?))
                })
                .collect();
            counters.instances_culled += (drawable.instances.len() - seen.len()) as u32;
            seen.sort_by(|(_, a), (_, b)| a.distance.total_cmp(&b.distance));
            let Some(distance) = seen.first().map(|(_, placed)| placed.distance) else { continue };
            for (_, VisibleInstance { centre, radius, .. }) in
                seen.iter().filter(|(_, placed)| placed.in_view)
            {
                list.receivers.add(*centre, *radius);
            }
            list.places.extend(seen.iter().map(|(index, _)| *index));
            let raws = seen.iter().map(|(_, placed)| placed.raw);
            let batch = list.batch((drawable.asset, number), distance, raws);
            list.batches.push(batch);
        }
        list.batches.sort_by(|a, b| a.distance.total_cmp(&b.distance));
        counters.instances = list.instances.len() as u32;
        list
    }

    /// Adds instances of an asset.
    pub(crate) fn batch(
        &mut self,
        (asset, drawable): (&'a AssetGpu, usize),
        distance: f64,
        instances: impl Iterator<Item = InstanceRaw>,
    ) -> Batch<'a> {
        let first = self.instances.len() as u32;
        self.instances.extend(instances);
        Batch { asset, drawable, first, end: self.instances.len() as u32, distance }
    }

    /// The instances of a batch: index in the list and index within the drawable.
    pub(crate) fn placed(&self, batch: &Batch<'_>) -> impl Iterator<Item = (usize, usize)> {
        let range = batch.first as usize..batch.end as usize;
        range.clone().zip(self.places[range].iter().map(|place| *place as usize))
    }

    /// Distance of an instance's centre from the eye.
    pub(crate) fn distance(&self, batch: &Batch<'_>, instance: u32) -> f64 {
        let Some(raw) = self.instances.get(instance as usize) else { return 0.0 };
        raw.place(batch.asset().sphere().0).length()
    }

    /// Whether any material satisfies `holds`.
    pub(crate) fn any(&self, holds: impl Fn(Features) -> bool) -> bool {
        self.batches.iter().any(|batch| batch.asset.any(&holds))
    }
}

/// The instance, if all its numbers are finite.
pub(crate) fn finite(raw: InstanceRaw) -> Option<InstanceRaw> {
    raw.offset.iter().chain(&raw.rotation).chain([&raw.scale]).all(|x| x.is_finite()).then_some(raw)
}

/// A visible instance.
struct VisibleInstance {
    /// Centre of its bounding sphere, relative to the eye.
    centre: DVec3,
    radius: f64,
    /// Distance of the bounding sphere from the eye.
    distance: f64,
    /// Whether its bounding sphere reaches into the view; true without bounds.
    in_view: bool,
    raw: InstanceRaw,
}

/// Places an instance with its part states, given its sphere; `None` if it is outside the view.
fn place(
    placement: &Placement,
    states: u32,
    (asset, sphere): (&AssetGpu, (DVec3, f64)),
    frame: &Frame<'_>,
    size: (u32, u32),
) -> Option<VisibleInstance> {
    let raw = InstanceRaw::new(placement, asset.origin(), frame.camera.eye).with_states(states);
    let raw = finite(raw)?;
    let (centre, radius) = raw.sphere(sphere);
    let in_view = may_see(&frame.camera, centre, radius, size);
    let distance = (centre.length() - radius).max(0.0);
    (in_view || asset.bounds().is_none()).then_some(VisibleInstance {
        centre,
        radius,
        distance,
        in_view,
        raw,
    })
}
