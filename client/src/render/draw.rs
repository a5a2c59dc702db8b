//! From drawables to draw calls: which instances may be seen, and the geometry passes' commands.

use glam::DVec3;

use super::asset::AssetGpu;
use super::instance::InstanceRaw;
use super::pipelines::Pipelines;
use super::scene::{Counters, Frame};

/// The instances of one asset that are drawn: a range of the frame's instance buffer.
pub(crate) struct Batch<'a> {
    asset: &'a AssetGpu,
    first: u32,
    end: u32,
}

/// What a frame draws.
#[derive(Default)]
pub(crate) struct DrawList<'a> {
    pub(crate) instances: Vec<InstanceRaw>,
    pub(crate) batches: Vec<Batch<'a>>,
}

impl<'a> DrawList<'a> {
    /// Leaves out instances whose bounds lie outside the view, or whose place is not finite.
    pub(crate) fn new(frame: &Frame<'a>, (width, height): (u32, u32), counters: &mut Counters) -> Self {
        let mut list = Self::default();
        let camera = &frame.camera;
        for drawable in frame.drawables.iter().filter(|d| d.asset.is_drawable()) {
            let asset = drawable.asset;
            let first = list.instances.len() as u32;
            for instance in drawable.instances {
                let raw = instance.relative_to(asset.origin(), camera.eye);
                let finite = raw.offset.iter().chain(&raw.rotation).all(|x| x.is_finite());
                let visible = asset.bounds().is_none_or(|(centre, radius)| {
                    let turned = instance.rotation * (centre * instance.scale);
                    let centre = turned + DVec3::from(raw.offset.map(f64::from));
                    camera.may_see(centre, radius * instance.scale.abs(), width, height)
                });
                if finite && visible {
                    list.instances.push(raw);
                } else {
                    counters.instances_culled += 1;
                }
            }
            let end = list.instances.len() as u32;
            if end > first {
                list.batches.push(Batch { asset, first, end });
            }
        }
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
