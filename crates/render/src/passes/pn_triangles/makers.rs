//! Pipelines and bind group layouts of patch lists.

use crate::passes::gbuffer::shader;
use crate::resources::gpu::Gpu;

const LIST: &str = concat!(
    include_str!("../../shaders/common.wgsl"),
    include_str!("../../shaders/placement.wgsl"),
    include_str!("../../shaders/pn_patch.wgsl"),
    include_str!("../../shaders/pn_list.wgsl")
);

/// Layout of a list in the vertex stage: group 2.
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
        .map(|(binding, read_only)| wgpu::BindGroupLayoutEntry {
            binding,
            visibility,
            ty: wgpu::BindingType::Buffer {
                ty: wgpu::BufferBindingType::Storage { read_only },
                has_dynamic_offset: false,
                min_binding_size: None,
            },
            count: None,
        })
        .collect();
    gpu.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
        label: Some("patch lists"),
        entries: &entries,
    })
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
        let pipeline_layout = gpu.device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some("patch lists"),
            bind_group_layouts: &[Some(frame_layout), None, Some(&layout)],
            immediate_size: 0,
        });
        let module = shader(gpu, "patch lists", LIST);
        let pipeline = |entry| {
            gpu.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
                label: Some(entry),
                layout: Some(&pipeline_layout),
                module: &module,
                entry_point: Some(entry),
                compilation_options: Default::default(),
                cache: None,
            })
        };
        let [measure, arrange, list] = ["cs_measure", "cs_arrange", "cs_list"].map(pipeline);
        Self { layout, measure, arrange, list }
    }
}
