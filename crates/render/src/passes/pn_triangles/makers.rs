//! Pipelines and bind group layouts of patch lists.

use crate::passes::gbuffer::shader;
use crate::resources::descriptors::{
    buffer_binding, compute_pipeline, group_layout, layout_entry, pipeline_layout, wgsl,
};
use crate::resources::gpu::Gpu;

const LIST: &str = wgsl!("common", "placement", "pn_patch", "pn_list");

/// Layout of a list in the vertex stage: group 3.
pub(super) fn list_layout(gpu: &Gpu) -> wgpu::BindGroupLayout {
    layout(gpu, wgpu::ShaderStages::VERTEX, [true; 6])
}

/// Layout of storage buffers at consecutive bindings; `read_only` for each.
fn layout<const N: usize>(
    gpu: &Gpu,
    visibility: wgpu::ShaderStages,
    read_only: [bool; N],
) -> wgpu::BindGroupLayout {
    let entries: Vec<_> = (0..)
        .zip(read_only)
        .map(|(binding, read_only)| {
            layout_entry(binding, visibility, buffer_binding(wgpu::BufferBindingType::Storage { read_only }))
        })
        .collect();
    group_layout(gpu, "patch lists", &entries)
}

/// Pipelines that build lists, in three stages.
#[derive(Debug)]
pub(super) struct PatchListPipelines {
    pub(super) layout: wgpu::BindGroupLayout,
    pub(super) measure: wgpu::ComputePipeline,
    pub(super) arrange: wgpu::ComputePipeline,
    pub(super) list: wgpu::ComputePipeline,
}

impl PatchListPipelines {
    pub(super) fn new(gpu: &Gpu, frame_layout: &wgpu::BindGroupLayout) -> Self {
        let read_only = [false, true, true, true, false, false, false];
        let layout = layout(gpu, wgpu::ShaderStages::COMPUTE, read_only);
        let pipeline_layout =
            pipeline_layout(gpu, "patch lists", &[Some(frame_layout), None, None, Some(&layout)]);
        let module = shader(gpu, "patch lists", LIST);
        let pipeline = |entry| compute_pipeline(gpu, &module, entry, &pipeline_layout);
        let [measure, arrange, list] = ["cs_measure", "cs_arrange", "cs_list"].map(pipeline);
        Self { layout, measure, arrange, list }
    }
}
