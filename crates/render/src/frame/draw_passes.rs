//! Draws of the geometry passes.

use crate::frame::batch::Meshes;
use crate::frame::counters::Counters;
use crate::frame::draw::DrawList;
use crate::frame::draw_groups::{DrawGroups, draw_instance};
use crate::frame::settings::ReliefMethod;
use crate::passes::mesh_pipelines::{MeshPipelines, ReliefDraw};
use crate::resources::gpu::Gpu;
use crate::scene::bound_material::Features;

/// Relief mapping of a pass.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Relief {
    pub(crate) method: ReliefMethod,
    /// Writes the relief's depth.
    pub(crate) in_depth: bool,
}

impl DrawGroups<'_> {
    /// Draws all opaque surfaces; `relief` enables relief mapping.
    pub(crate) fn surfaces(
        &self,
        gpu: &Gpu,
        pass: &mut wgpu::RenderPass<'_>,
        meshes: Meshes<'_>,
        relief: Option<Relief>,
        counters: &mut Counters,
    ) {
        self.draw(pass, meshes, counters, |pass, pipelines, group, counters| {
            let (material, of) = (group.material, group.material.features);
            if of.blend {
                return false;
            }
            match relief.filter(|_| of.relief) {
                Some(relief) => {
                    let acceleration =
                        relief.method.acceleration().filter(|_| pipelines.supports_acceleration());
                    let known = acceleration.and_then(|acceleration| {
                        Some((acceleration, material.acceleration(gpu, acceleration)?))
                    });
                    if let Some((_, group)) = known {
                        pass.set_bind_group(3, group, &[]);
                    }
                    let how = ReliefDraw {
                        acceleration: known.map(|(acceleration, _)| acceleration),
                        deep: relief.in_depth && of.relief_may_be_deep(),
                    };
                    pass.set_pipeline(pipelines.relief(gpu, of, how));
                }
                None => pass.set_pipeline(pipelines.surface(gpu, of, false)),
            }
            counters.draws += group.draws();
            counters.triangles += group.triangles;
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
        self.draw_with(pass, meshes, counters, |pipelines, of| {
            (of.emits && !of.blend).then(|| pipelines.emission(gpu, of))
        });
    }

    /// Draws specular reflection that is not the usual.
    pub(crate) fn specular(
        &self,
        gpu: &Gpu,
        pass: &mut wgpu::RenderPass<'_>,
        meshes: Meshes<'_>,
        counters: &mut Counters,
    ) {
        self.draw_with(pass, meshes, counters, |pipelines, of| {
            (of.specular && !of.blend).then(|| pipelines.specular(gpu, of))
        });
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
        self.draw_with(pass, meshes, counters, |pipelines, of| {
            (of.blend == seen_through).then(|| pipelines.overdraw(gpu, of))
        });
    }

    /// Draws motion vectors; the previous instances are in `before`.
    pub(crate) fn motion(
        &self,
        gpu: &Gpu,
        pass: &mut wgpu::RenderPass<'_>,
        meshes: Meshes<'_>,
        before: &wgpu::Buffer,
        counters: &mut Counters,
    ) {
        pass.set_vertex_buffer(2, before.slice(..));
        // Transparent surfaces wrote no depth to test against.
        self.draw(pass, meshes, counters, |pass, pipelines, group, _| {
            let drawn = !group.material.features.blend;
            if drawn {
                pass.set_pipeline(pipelines.motion(gpu, group.material.features));
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
        self.draw_with(pass, meshes, counters, |pipelines, of| pipelines.wire(gpu, of));
    }

    /// Draws the groups whose material has a pipeline.
    fn draw_with<'p>(
        &self,
        pass: &mut wgpu::RenderPass<'_>,
        meshes: Meshes<'p>,
        counters: &mut Counters,
        pipeline: impl Fn(&'p MeshPipelines, Features) -> Option<&'p wgpu::RenderPipeline>,
    ) {
        self.draw(pass, meshes, counters, |pass, pipelines, group, counters| {
            let Some(pipeline) = pipeline(pipelines, group.material.features) else { return false };
            pass.set_pipeline(pipeline);
            counters.draws += group.draws();
            counters.triangles += group.triangles;
            true
        });
    }
}

impl DrawList<'_> {
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
        let with = self.batches.iter().filter(|batch| batch.blends());
        let mut order: Vec<_> = with
            .flat_map(|batch| batch.range().map(move |instance| (batch, instance)))
            .map(|(batch, instance)| (self.distance(batch, instance), batch, instance))
            .collect();
        order.sort_by(|(a, ..), (b, ..)| b.total_cmp(a));
        pass.set_bind_group(2, meshes.tiles, &[]);
        for (_, batch, instance) in order {
            for facing in 0..2 {
                draw_instance(batch, instance, pass, meshes, counters, |pipelines, material| {
                    let of = material.features;
                    of.blend.then(|| &pipelines.transparent(gpu, of, punctual_lights)[facing][..])
                });
            }
        }
    }
}
