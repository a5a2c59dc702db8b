//! Draw lists: culls instances and records the draw calls of the geometry passes.

use std::ops::Range;

use glam::DVec3;
use lodestream_scene::placement::Placement;

use crate::frame::camera::may_see;
use crate::frame::counters::Counters;
use crate::frame::receivers::Receivers;
use crate::frame::settings::{Frame, ReliefMethod};
use crate::passes::mesh_pipelines::{MeshPipelines, ReliefDraw};
#[cfg(any(test, feature = "methods"))]
use crate::passes::pn_triangles::PatchListItem;
use crate::passes::pn_triangles::{PatchLists, PatchPipelines};
use crate::resources::gpu::Gpu;
use crate::scene::asset::{AssetGpu, PartDraw};
use crate::scene::material_bindings::Features;
use crate::scene::placement::InstanceRaw;

/// The visible instances of one asset: a range of the frame's instance buffer.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Batch<'a> {
    asset: &'a AssetGpu,
    /// Index among the frame's drawables.
    drawable: usize,
    first: u32,
    end: u32,
    /// Distance of the nearest instance's bounds from the eye.
    distance: f64,
}

impl<'a> Batch<'a> {
    pub(crate) fn asset(&self) -> &'a AssetGpu {
        self.asset
    }

    pub(crate) fn drawable(&self) -> usize {
        self.drawable
    }

    /// Range in the frame's instance buffer.
    pub(crate) fn range(&self) -> Range<u32> {
        self.first..self.end
    }

    #[cfg(any(test, feature = "methods"))]
    /// Parts that may be drawn as PN triangles, all or those in view. Transparent parts have a list per instance.
    pub(crate) fn listed(&self, in_view: bool) -> impl Iterator<Item = PatchListItem<'a>> {
        let instances = self.range();
        let draws = self.asset.draws().into_iter();
        let parts = draws.flat_map(|(vertices, parts)| parts.enumerate().map(move |part| (vertices, part)));
        parts.map(move |(vertices, (number, part))| PatchListItem {
            vertices,
            indices: part.indices,
            part: number,
            faces: part.faces,
            instances: instances.clone(),
            alone: part.material.features.blend,
            in_view,
        })
    }
}

/// Pipelines and buffers of meshes: flat, and as PN triangles where there are patch lists.
#[derive(Clone, Copy)]
pub(crate) struct Meshes<'a> {
    pub(crate) plain: &'a MeshPipelines,
    pub(crate) instances: &'a wgpu::Buffer,
    pub(crate) curved: Option<(&'a PatchPipelines, &'a PatchLists)>,
}

/// Relief mapping of a pass.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Relief {
    pub(crate) method: ReliefMethod,
    /// Writes the relief's depth.
    pub(crate) in_depth: bool,
}

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

    /// Whether any material satisfies `holds`.
    pub(crate) fn any(&self, holds: impl Fn(Features) -> bool) -> bool {
        self.batches.iter().any(|batch| batch.asset.any(&holds))
    }

    /// Draws all opaque surfaces; `relief` enables relief mapping.
    pub(crate) fn surfaces(
        &self,
        gpu: &Gpu,
        pass: &mut wgpu::RenderPass<'_>,
        meshes: Meshes<'_>,
        relief: Option<Relief>,
        counters: &mut Counters,
    ) {
        each(&self.batches, pass, meshes, |pass, pipelines, part, triangles| {
            let of = part.material.features;
            if of.blend {
                return false;
            }
            match relief.filter(|_| of.relief) {
                Some(relief) => {
                    let acceleration =
                        relief.method.acceleration().filter(|_| pipelines.supports_acceleration());
                    let known = acceleration.and_then(|acceleration| {
                        Some((acceleration, part.material.acceleration(gpu, acceleration)?))
                    });
                    if let Some((_, group)) = known {
                        pass.set_bind_group(2, group, &[]);
                    }
                    let how = ReliefDraw {
                        acceleration: known.map(|(acceleration, _)| acceleration),
                        deep: relief.in_depth && of.relief_may_be_deep(),
                    };
                    pass.set_pipeline(pipelines.relief(gpu, of, how));
                }
                None => pass.set_pipeline(pipelines.surface(gpu, of, false)),
            }
            count(pass, part, triangles, counters);
            true
        });
    }

    /// Adds emission.
    pub(crate) fn emission(
        &self,
        gpu: &Gpu,
        pass: &mut wgpu::RenderPass<'_>,
        meshes: Meshes<'_>,
        counters: &mut Counters,
    ) {
        draw(&self.batches, pass, meshes, counters, |pipelines, of| {
            (of.emits && !of.blend).then(|| pipelines.emission(gpu))
        });
    }

    /// Draws transparent surfaces, instances back to front, back faces first. `punctual_lights`: lit by punctual
    /// lights too.
    pub(crate) fn transparent(
        &self,
        gpu: &Gpu,
        pass: &mut wgpu::RenderPass<'_>,
        meshes: Meshes<'_>,
        punctual_lights: bool,
        counters: &mut Counters,
    ) {
        let with = self.batches.iter().filter(|batch| batch.asset.any(|features| features.blend));
        let mut order: Vec<_> = with
            .flat_map(|batch| (batch.first..batch.end).map(move |instance| (batch, instance)))
            .map(|(batch, instance)| (self.distance(batch, instance), batch, instance))
            .collect();
        order.sort_by(|(a, ..), (b, ..)| b.total_cmp(a));
        for (_, batch, instance) in order {
            let one = [Batch { first: instance, end: instance + 1, ..*batch }];
            for facing in 0..2 {
                draw(&one, pass, meshes, counters, |pipelines, of| {
                    of.blend.then(|| &pipelines.transparent(gpu, of, punctual_lights)[facing])
                });
            }
        }
    }

    /// Distance of an instance's centre from the eye.
    fn distance(&self, batch: &Batch<'_>, instance: u32) -> f64 {
        let Some(raw) = self.instances.get(instance as usize) else { return 0.0 };
        raw.place(batch.asset.sphere().0).length()
    }

    /// Draws overdraw counters, of transparent or of all other surfaces.
    pub(crate) fn overdraw(
        &self,
        gpu: &Gpu,
        pass: &mut wgpu::RenderPass<'_>,
        meshes: Meshes<'_>,
        seen_through: bool,
        counters: &mut Counters,
    ) {
        draw(&self.batches, pass, meshes, counters, |pipelines, of| {
            (of.blend == seen_through).then(|| pipelines.overdraw(gpu, of))
        });
    }

    /// Draws motion vectors of some batches, whose previous instances are in `before`.
    pub(crate) fn motion(
        batches: &[Batch<'_>],
        gpu: &Gpu,
        pass: &mut wgpu::RenderPass<'_>,
        meshes: Meshes<'_>,
        before: &wgpu::Buffer,
    ) {
        pass.set_vertex_buffer(2, before.slice(..));
        // Transparent surfaces wrote no depth to test against.
        each(batches, pass, meshes, |pass, pipelines, part, _| {
            let drawn = !part.material.features.blend;
            if drawn {
                pass.set_bind_group(1, &part.material.group, &[]);
                pass.set_pipeline(pipelines.motion(gpu));
            }
            drawn
        });
    }

    /// Draws the wireframe, if the device supports it.
    pub(crate) fn wires(
        &self,
        gpu: &Gpu,
        pass: &mut wgpu::RenderPass<'_>,
        meshes: Meshes<'_>,
        counters: &mut Counters,
    ) {
        draw(&self.batches, pass, meshes, counters, |pipelines, _| pipelines.wire(gpu));
    }
}

/// Draws the parts whose material has a pipeline, with their textures.
fn draw<'p>(
    batches: &[Batch<'_>],
    pass: &mut wgpu::RenderPass<'_>,
    meshes: Meshes<'p>,
    counters: &mut Counters,
    pipeline: impl Fn(&'p MeshPipelines, Features) -> Option<&'p wgpu::RenderPipeline>,
) {
    each(batches, pass, meshes, |pass, pipelines, part, triangles| {
        let Some(pipeline) = pipeline(pipelines, part.material.features) else { return false };
        pass.set_pipeline(pipeline);
        count(pass, part, triangles, counters);
        true
    });
}

/// Binds a part's material and updates the counters.
fn count(pass: &mut wgpu::RenderPass<'_>, part: &PartDraw<'_>, triangles: u64, counters: &mut Counters) {
    pass.set_bind_group(1, &part.material.group, &[]);
    counters.draws += 1;
    counters.triangles += triangles;
}

/// Draws parts of some batches. `prepare` selects parts and sets their pipeline; its last argument is the number of
/// triangles.
pub(crate) fn each<'p>(
    batches: &[Batch<'_>],
    pass: &mut wgpu::RenderPass<'_>,
    Meshes { plain, instances, curved }: Meshes<'p>,
    mut prepare: impl FnMut(&mut wgpu::RenderPass<'_>, &'p MeshPipelines, &PartDraw<'_>, u64) -> bool,
) {
    pass.set_vertex_buffer(1, instances.slice(..));
    for batch in batches {
        let Some((vertices, parts)) = batch.asset.draws() else { continue };
        for (number, part) in parts.enumerate() {
            let listed = curved.filter(|(_, lists)| lists.has(batch.first, number));
            let pipelines = listed.map_or(plain, |(patches, _)| patches.meshes());
            let triangles = u64::from(part.faces) * u64::from(batch.end - batch.first);
            if !prepare(pass, pipelines, &part, triangles) {
                continue;
            }
            if let Some((_, lists)) = listed {
                // Transparent parts have a list for each instance.
                let firsts = if part.material.features.blend { batch.end } else { batch.first + 1 };
                (batch.first..firsts).for_each(|first| lists.draw(pass, first, number));
                continue;
            }
            pass.set_vertex_buffer(0, vertices.slice(..));
            pass.set_index_buffer(part.indices.slice(..), wgpu::IndexFormat::Uint32);
            pass.draw_indexed(0..part.faces * 3, 0, batch.first..batch.end);
        }
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
