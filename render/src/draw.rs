//! From drawables to draw calls: which instances may be seen, and the geometry passes' commands.

use glam::DVec3;

use super::asset::AssetGpu;
use super::camera::may_see;
use super::counters::Counters;
use super::instance::{Instance, InstanceRaw};
use super::pipelines::Pipelines;
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
#[derive(Default)]
pub(crate) struct DrawList<'a> {
    pub(crate) instances: Vec<InstanceRaw>,
    pub(crate) batches: Vec<Batch<'a>>,
}

impl<'a> DrawList<'a> {
    /// Leaves out instances whose bounds lie outside the view, or whose place is not finite; the
    /// rest is drawn from near to far, so that the depth test spares what is hidden.
    pub(crate) fn new(frame: &Frame<'a>, size: (u32, u32), counters: &mut Counters) -> Self {
        let mut list = Self::default();
        for drawable in frame.drawables.iter().filter(|d| d.asset.is_drawable()) {
            let mut seen: Vec<_> = drawable
                .instances
                .iter()
                .filter_map(|instance| place(instance, drawable.asset, frame, size))
                .collect();
            counters.instances_culled += (drawable.instances.len() - seen.len()) as u32;
            seen.sort_by(|a, b| a.0.total_cmp(&b.0));
            let Some((distance, _)) = seen.first().copied() else { continue };
            let first = list.instances.len() as u32;
            list.instances.extend(seen.iter().map(|(_, raw)| raw));
            let end = list.instances.len() as u32;
            list.batches.push(Batch { asset: drawable.asset, first, end, distance });
        }
        list.batches.sort_by(|a, b| a.distance.total_cmp(&b.distance));
        counters.instances = list.instances.len() as u32;
        list
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
        self.each(pass, instances, counters, |pass, material_relief| {
            pass.set_pipeline(if relief && material_relief {
                &pipelines.surface_relief
            } else {
                &pipelines.surface
            });
        });
    }

    /// Draws all edges.
    pub(crate) fn wires(
        &self,
        pass: &mut wgpu::RenderPass<'_>,
        wire: &wgpu::RenderPipeline,
        instances: &wgpu::Buffer,
        counters: &mut Counters,
    ) {
        self.each(pass, instances, counters, |pass, _| pass.set_pipeline(wire));
    }

    fn each(
        &self,
        pass: &mut wgpu::RenderPass<'_>,
        instances: &wgpu::Buffer,
        counters: &mut Counters,
        choose: impl Fn(&mut wgpu::RenderPass<'_>, bool),
    ) {
        pass.set_vertex_buffer(1, instances.slice(..));
        for batch in &self.batches {
            let Some((vertices, parts)) = batch.asset.draws() else { continue };
            pass.set_vertex_buffer(0, vertices.slice(..));
            for part in parts {
                choose(pass, part.material.relief);
                pass.set_bind_group(1, &part.material.group, &[]);
                pass.set_index_buffer(part.indices.slice(..), wgpu::IndexFormat::Uint32);
                pass.draw_indexed(0..part.faces * 3, 0, batch.first..batch.end);
                counters.draws += 1;
                counters.triangles += u64::from(part.faces) * u64::from(batch.end - batch.first);
            }
        }
    }
}

/// Distance of an instance's bounds from the eye and what the GPU gets, unless it is out of view.
fn place(
    instance: &Instance,
    asset: &AssetGpu,
    frame: &Frame<'_>,
    size: (u32, u32),
) -> Option<(f64, InstanceRaw)> {
    let raw = instance.relative_to(asset.origin(), frame.camera.eye);
    if !raw.offset.iter().chain(&raw.rotation).chain([&raw.scale]).all(|x| x.is_finite()) {
        return None;
    }
    let origin = DVec3::from(raw.offset.map(f64::from));
    let Some((centre, radius)) = asset.bounds() else { return Some((origin.length(), raw)) };
    let centre = origin + instance.rotation * (centre * instance.scale);
    let radius = radius * instance.scale.abs();
    let visible = may_see(&frame.camera, centre, radius, size);
    visible.then(|| ((centre.length() - radius).max(0.0), raw))
}
