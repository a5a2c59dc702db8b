//! Draw lists: culls instances, and sorts them from near to far.

use glam::DVec3;
use lodestream_scene::section::SectionPlanes;

use crate::frame::batch::Batch;
use crate::frame::camera::{Frustum, Side};
use crate::frame::counters::Counters;
use crate::frame::placed::{Cell, PlacedDrawable, PlacedInstances};
use crate::frame::receivers::Receivers;
use crate::frame::settings::Frame;
use crate::scene::asset::AssetGpu;
use crate::scene::placement::InstanceRaw;

/// Memory of a draw list, reused by the next frame's.
#[derive(Debug, Default)]
pub(crate) struct ListMemory {
    instances: Vec<InstanceRaw>,
    places: Vec<u32>,
}

/// The visible instances of a frame.
pub(crate) struct DrawList<'a> {
    pub(crate) instances: Vec<InstanceRaw>,
    pub(crate) batches: Vec<Batch<'a>>,
    /// Index within its drawable of each instance of `batches`.
    places: Vec<u32>,
    /// Region that receives light.
    pub(crate) receivers: Receivers,
    /// Whether any material is transparent, and whether any opaque one emits or has specular reflection of its own.
    pub(crate) blends: bool,
    pub(crate) emits: bool,
    pub(crate) specular: bool,
}

impl<'a> DrawList<'a> {
    /// Culls instances that are hidden, outside the view or with positions that are not finite; sorts the rest front to
    /// back for the depth test, instances by cell. `placed` has the frame's drawables.
    pub(crate) fn new(
        frame: &Frame<'a>,
        size: (u32, u32),
        placed: &PlacedInstances,
        memory: ListMemory,
        counters: &mut Counters,
    ) -> Self {
        let ListMemory { mut instances, mut places } = memory;
        instances.clear();
        places.clear();
        let (batches, receivers) = (Vec::new(), Receivers::NONE);
        let (blends, emits, specular) = (false, false, false);
        let mut list = Self { instances, batches, places, receivers, blends, emits, specular };
        let frustum = Frustum::new(&frame.camera, size);
        let (mut cells, mut order) = (Vec::new(), Vec::new());
        for (number, (drawable, placed)) in frame.drawables.iter().zip(placed.drawables()).enumerate() {
            let Some(look) = placed.look else { continue };
            cells.clear();
            let all = placed.unbounded;
            for (index, cell) in placed.cells.iter().enumerate() {
                let centre = cell.centre - frame.camera.eye;
                let side = frustum.side(centre, cell.radius);
                if side != Side::Out || all {
                    let distance = (centre.length() - cell.radius).max(0.0);
                    cells.push((sort_key(distance, index), side));
                }
            }
            cells.sort_unstable_by_key(|(key, _)| *key);
            let first = list.instances.len();
            for &(key, side) in &cells {
                let cell = &placed.cells[(key & INDEX) as usize];
                let view = (&frustum, frame.camera.eye, &frame.settings.sections);
                list.add_cell((drawable.asset, &placed), cell, view, (side, all));
            }
            let end = list.instances.len();
            counters.instances_culled += (drawable.instances.len() - (end - first)) as u32;
            let Some(&(nearest, _)) = cells.first().filter(|_| end > first) else { continue };
            order.push(nearest & !INDEX | list.batches.len() as u64);
            list.batches.push(Batch {
                asset: drawable.asset,
                drawable: number,
                first: first as u32,
                end: end as u32,
                blends: look.blends,
            });
            list.blends |= look.blends;
            list.emits |= look.emits;
            list.specular |= look.specular;
        }
        order.sort_unstable();
        list.batches = order.iter().map(|key| list.batches[(key & INDEX) as usize]).collect();
        counters.instances = list.instances.len() as u32;
        list
    }

    /// Adds the instances of a cell that are seen, or all.
    fn add_cell(
        &mut self,
        (asset, placed): (&AssetGpu, &PlacedDrawable<'_>),
        cell: &Cell,
        (frustum, eye, sections): (&Frustum, DVec3, &SectionPlanes),
        (side, all): (Side, bool),
    ) {
        // Most cells lie between the nearest and the farthest.
        let covered = self.receivers.cover(cell.centre - eye, cell.radius);
        for at in cell.range() {
            let (mut in_view, instance) = (side == Side::In, &placed.instances[at]);
            let sphere = placed.spheres[at];
            if side == Side::Across {
                in_view = frustum.side(sphere.centre - eye, sphere.radius) != Side::Out;
            }
            in_view &= !sections.cut_sphere(sphere.centre, sphere.radius);
            if !in_view && !all {
                continue;
            }
            let states =
                if placed.has_no_states { Some(0) } else { asset.part_states(instance.place as usize) };
            let Some(raw) = states.and_then(|states| instance.raw(eye, states)) else { continue };
            if in_view && !covered {
                self.receivers.add(sphere.centre - eye, sphere.radius);
            }
            self.instances.push(raw);
            self.places.push(instance.place);
        }
    }

    /// The memory, for the next frame's list.
    pub(crate) fn into_memory(self) -> ListMemory {
        ListMemory { instances: self.instances, places: self.places }
    }

    /// Adds instances of an asset.
    pub(crate) fn batch(
        &mut self,
        (asset, drawable): (&'a AssetGpu, usize),
        instances: impl Iterator<Item = InstanceRaw>,
    ) -> Batch<'a> {
        let first = self.instances.len() as u32;
        self.instances.extend(instances);
        Batch { asset, drawable, first, end: self.instances.len() as u32, blends: false }
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
}

/// Bits of a sort key that hold an index.
const INDEX: u64 = u32::MAX as u64;

/// A key that sorts by distance, from near to far, and then by index.
fn sort_key(distance: f64, index: usize) -> u64 {
    // Bits of positive numbers sort as they do.
    u64::from((distance as f32).to_bits()) << 32 | index as u64 & INDEX
}

/// The instance, if all its numbers are finite.
pub(crate) fn finite(raw: InstanceRaw) -> Option<InstanceRaw> {
    raw.offset.iter().chain(&raw.rotation).chain([&raw.scale]).all(|x| x.is_finite()).then_some(raw)
}
