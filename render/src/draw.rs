//! From drawables to draw calls: which instances may be seen, and the geometry passes' commands.

use glam::DVec3;

use super::asset::{AssetGpu, PartDraw};
use super::camera::may_see;
use super::counters::Counters;
use super::instance::{Instance, InstanceRaw};
use super::pipelines::Pipelines;
use super::receivers::Receivers;
use super::scene::Frame;

/// The instances of one asset that are drawn: a range of the frame's instance buffer.
pub(crate) struct Batch<'a> {
    asset: &'a AssetGpu,
    first: u32,
    end: u32,
    /// Distance of the nearest instance's bounds from the eye.
    distance: f64,
}

/// What a frame draws.
pub(crate) struct DrawList<'a> {
    pub(crate) instances: Vec<InstanceRaw>,
    pub(crate) batches: Vec<Batch<'a>>,
    /// Where those in view are.
    pub(crate) receivers: Receivers,
}

impl<'a> DrawList<'a> {
    /// Leaves out instances whose bounds lie outside the view, or whose place is not finite; the
    /// rest is drawn from near to far, so that the depth test spares what is hidden.
    pub(crate) fn new(frame: &Frame<'a>, size: (u32, u32), counters: &mut Counters) -> Self {
        let mut list = Self { instances: Vec::new(), batches: Vec::new(), receivers: Receivers::NONE };
        for drawable in frame.drawables.iter().filter(|d| d.asset.is_drawable()) {
            let mut seen: Vec<_> = drawable
                .instances
                .iter()
                .filter_map(|instance| place(instance, drawable.asset, frame, size))
                .collect();
            counters.instances_culled += (drawable.instances.len() - seen.len()) as u32;
            seen.sort_by(|a, b| a.distance.total_cmp(&b.distance));
            let Some(distance) = seen.first().map(|placed| placed.distance) else { continue };
            for Placed { centre, radius, .. } in seen.iter().filter(|placed| placed.in_view) {
                list.receivers.add(*centre, *radius);
            }
            let batch = list.batch(drawable.asset, distance, seen.iter().map(|placed| placed.raw));
            list.batches.push(batch);
        }
        list.batches.sort_by(|a, b| a.distance.total_cmp(&b.distance));
        counters.instances = list.instances.len() as u32;
        list
    }

    /// Adds instances of an asset.
    pub(crate) fn batch(
        &mut self,
        asset: &'a AssetGpu,
        distance: f64,
        instances: impl Iterator<Item = InstanceRaw>,
    ) -> Batch<'a> {
        let first = self.instances.len() as u32;
        self.instances.extend(instances);
        Batch { asset, first, end: self.instances.len() as u32, distance }
    }

    /// Draws all surfaces; `relief` says whether height maps are honoured.
    pub(crate) fn surfaces(
        &self,
        pass: &mut wgpu::RenderPass<'_>,
        pipelines: &Pipelines,
        instances: &wgpu::Buffer,
        relief: bool,
        counters: &mut Counters,
    ) {
        each(&self.batches, pass, instances, |pass, part, triangles| {
            pass.set_pipeline(if relief && part.material.relief {
                &pipelines.surface_relief
            } else {
                &pipelines.surface
            });
            pass.set_bind_group(1, &part.material.group, &[]);
            counters.draws += 1;
            counters.triangles += triangles;
        });
    }

    /// Draws all by one pipeline: their edges, or how often each pixel is drawn.
    pub(crate) fn with(
        &self,
        pass: &mut wgpu::RenderPass<'_>,
        pipeline: &wgpu::RenderPipeline,
        instances: &wgpu::Buffer,
        counters: &mut Counters,
    ) {
        pass.set_pipeline(pipeline);
        each(&self.batches, pass, instances, |pass, part, triangles| {
            pass.set_bind_group(1, &part.material.group, &[]);
            counters.draws += 1;
            counters.triangles += triangles;
        });
    }
}

/// Draws all parts of some batches; `prepare` chooses how, and is told how many triangles each has.
pub(crate) fn each(
    batches: &[Batch<'_>],
    pass: &mut wgpu::RenderPass<'_>,
    instances: &wgpu::Buffer,
    mut prepare: impl FnMut(&mut wgpu::RenderPass<'_>, &PartDraw<'_>, u64),
) {
    pass.set_vertex_buffer(1, instances.slice(..));
    for batch in batches {
        let Some((vertices, parts)) = batch.asset.draws() else { continue };
        pass.set_vertex_buffer(0, vertices.slice(..));
        for part in parts {
            prepare(pass, &part, u64::from(part.faces) * u64::from(batch.end - batch.first));
            pass.set_index_buffer(part.indices.slice(..), wgpu::IndexFormat::Uint32);
            pass.draw_indexed(0..part.faces * 3, 0, batch.first..batch.end);
        }
    }
}

/// An instance as the GPU gets it, unless its place is not finite.
pub(crate) fn finite(raw: InstanceRaw) -> Option<InstanceRaw> {
    raw.offset.iter().chain(&raw.rotation).chain([&raw.scale]).all(|x| x.is_finite()).then_some(raw)
}

/// Where an instance's origin lies, relative to the eye.
pub(crate) fn middle(raw: &InstanceRaw) -> DVec3 {
    DVec3::from(raw.offset.map(f64::from))
}

/// An instance that is drawn.
struct Placed {
    /// Its sphere, relative to the eye.
    centre: DVec3,
    radius: f64,
    /// Of the sphere from the eye.
    distance: f64,
    /// Whether its sphere reaches into the view: what nobody told the bounds of is always drawn.
    in_view: bool,
    raw: InstanceRaw,
}

/// An instance as it is drawn, unless it is known to be out of view.
fn place(instance: &Instance, asset: &AssetGpu, frame: &Frame<'_>, size: (u32, u32)) -> Option<Placed> {
    let raw = finite(instance.relative_to(asset.origin(), frame.camera.eye))?;
    let (centre, radius) = asset.sphere();
    let centre = middle(&raw) + instance.rotation * (centre * instance.scale);
    let radius = radius * instance.scale.abs();
    let in_view = may_see(&frame.camera, centre, radius, size);
    let distance = (centre.length() - radius).max(0.0);
    (in_view || asset.bounds().is_none()).then_some(Placed { centre, radius, distance, in_view, raw })
}
