//! Pipelines and bind group layouts of ink.

use crate::frame::fullscreen;
use crate::frame::targets::{RADIANCE, STROKES};
use crate::passes::gbuffer::shader;
use crate::resources::descriptors::{
    blend, buffer_binding, compute_pipeline, group_layout, layout_entry, pipeline_layout, wgsl,
};
use crate::resources::gpu::Gpu;

const ADJACENCY: &str = wgsl!("ink_adjacency");
const LIST: &str = wgsl!("common", "placement", "ink_contour", "ink_list");
const DRAWN: &str = wgsl!("common", "section", "ink_uniform", "ink_strokes");
const MIXED: &str = wgsl!("common", "fullscreen", "ink_uniform", "ink");

/// Crossing strokes keep the darker value, so their order does not matter.
const DARKEST: wgpu::BlendState =
    blend(wgpu::BlendFactor::One, wgpu::BlendFactor::One, wgpu::BlendOperation::Max);

/// Pipelines of ink.
#[derive(Debug)]
pub(crate) struct InkPipelines {
    /// Edge extraction, in order of execution.
    pub(super) adjacency: AdjacencyPipelines,
    pub(super) adjacency_layout: wgpu::BindGroupLayout,
    pub(super) list: wgpu::ComputePipeline,
    pub(super) bound: wgpu::ComputePipeline,
    pub(super) list_layout: wgpu::BindGroupLayout,
    pub(super) strokes: wgpu::RenderPipeline,
    pub(crate) mixed: wgpu::RenderPipeline,
}

/// The stages of `ink_adjacency.wgsl`.
#[derive(Debug)]
pub(super) struct AdjacencyPipelines {
    pub(super) clear: wgpu::ComputePipeline,
    pub(super) places: wgpu::ComputePipeline,
    pub(super) corners: wgpu::ComputePipeline,
    pub(super) edges: wgpu::ComputePipeline,
    pub(super) rings: wgpu::ComputePipeline,
}

impl InkPipelines {
    pub(crate) fn new(gpu: &Gpu, frame_layout: &wgpu::BindGroupLayout) -> Self {
        let adjacency_layout = layout(gpu, "what lies beside what", [true, true, false, false, false, false]);
        let list_layout = layout(gpu, "strokes", [true, true, true, true, false, false]);
        let module = shader(gpu, "what lies beside what", ADJACENCY);
        let adjacent = |entry| compute(gpu, &module, entry, &[Some(&adjacency_layout)]);
        let adjacency = AdjacencyPipelines {
            clear: adjacent("cs_clear"),
            places: adjacent("cs_places"),
            corners: adjacent("cs_corners"),
            edges: adjacent("cs_edges"),
            rings: adjacent("cs_rings"),
        };
        let module = shader(gpu, "list of strokes", LIST);
        let [list, bound] = ["cs_strokes", "cs_bound"]
            .map(|entry| compute(gpu, &module, entry, &[Some(frame_layout), Some(&list_layout)]));
        let module = shader(gpu, "strokes", DRAWN);
        let darkest = wgpu::ColorTargetState { blend: Some(DARKEST), ..STROKES.into() };
        let strokes = fullscreen::pipeline(gpu, &module, ["vs_stroke", "fs_stroke"], (darkest, None), &[]);
        let module = shader(gpu, "ink", MIXED);
        let mixed = fullscreen::fullscreen_pipeline(gpu, &module, "fs_ink", RADIANCE.into(), &[]);
        Self { adjacency, adjacency_layout, list, bound, list_layout, strokes, mixed }
    }
}

/// Layout of a uniform block followed by storage buffers; `read_only` for each.
fn layout<const N: usize>(gpu: &Gpu, label: &str, read_only: [bool; N]) -> wgpu::BindGroupLayout {
    let storage = read_only.map(|read_only| wgpu::BufferBindingType::Storage { read_only });
    let entries: Vec<_> = (0..)
        .zip(std::iter::once(wgpu::BufferBindingType::Uniform).chain(storage))
        .map(|(binding, ty)| layout_entry(binding, wgpu::ShaderStages::COMPUTE, buffer_binding(ty)))
        .collect();
    group_layout(gpu, label, &entries)
}

fn compute(
    gpu: &Gpu,
    module: &wgpu::ShaderModule,
    entry: &str,
    layouts: &[Option<&wgpu::BindGroupLayout>],
) -> wgpu::ComputePipeline {
    compute_pipeline(gpu, module, entry, &pipeline_layout(gpu, entry, layouts))
}
