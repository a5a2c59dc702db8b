//! Pipelines of the geometry passes: what fills the G-buffer, and the edges that the wireframe is made of.

use super::gpu::Gpu;
use super::targets::{ALBEDO, DEPTH, EDGES, NORMAL};

/// Shader, bindings and vertices of something that is drawn into the G-buffer.
pub(crate) struct GeometryPass<'a> {
    pub(crate) module: &'a wgpu::ShaderModule,
    pub(crate) layout: &'a wgpu::PipelineLayout,
    pub(crate) buffers: &'a [Option<wgpu::VertexBufferLayout<'a>>],
}

/// What is made of the pixels.
struct Fragment<'a> {
    entry: &'a str,
    constants: &'a [(&'a str, f64)],
    targets: &'a [Option<wgpu::ColorTargetState>],
}

impl GeometryPass<'_> {
    /// Fills the G-buffer, with relief mapping or without; entry points of the vertex and fragment stages.
    pub(crate) fn surface(&self, gpu: &Gpu, entry: [&str; 2], relief: bool) -> wgpu::RenderPipeline {
        let constants: &[(&str, f64)] = if relief { &[("RELIEF", 1.0)] } else { &[] };
        let targets = [Some(NORMAL.into()), Some(ALBEDO.into())];
        let fragment = Fragment { entry: entry[1], constants, targets: &targets };
        self.pipeline(gpu, entry[0], Some(fragment), wgpu::PolygonMode::Fill)
    }

    /// Draws nothing but depth.
    pub(crate) fn caster(&self, gpu: &Gpu, entry: &str) -> wgpu::RenderPipeline {
        self.pipeline(gpu, entry, None, wgpu::PolygonMode::Fill)
    }

    /// Counts the edges of what is visible in each pixel; `None` where the device cannot draw triangles as lines.
    pub(crate) fn wire(&self, gpu: &Gpu, entry: [&str; 2]) -> Option<wgpu::RenderPipeline> {
        let lines = gpu.device.features().contains(wgpu::Features::POLYGON_MODE_LINE);
        let sum = wgpu::BlendComponent {
            src_factor: wgpu::BlendFactor::One,
            dst_factor: wgpu::BlendFactor::One,
            operation: wgpu::BlendOperation::Add,
        };
        let blend = wgpu::BlendState { color: sum, alpha: sum };
        let target = wgpu::ColorTargetState { blend: Some(blend), ..EDGES.into() };
        let fragment = Fragment { entry: entry[1], constants: &[], targets: &[Some(target)] };
        lines.then(|| self.pipeline(gpu, entry[0], Some(fragment), wgpu::PolygonMode::Line))
    }

    fn pipeline(
        &self,
        gpu: &Gpu,
        vertex: &str,
        fragment: Option<Fragment<'_>>,
        polygon_mode: wgpu::PolygonMode,
    ) -> wgpu::RenderPipeline {
        gpu.device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: Some(fragment.as_ref().map_or(vertex, |fragment| fragment.entry)),
            layout: Some(self.layout),
            vertex: wgpu::VertexState {
                module: self.module,
                entry_point: Some(vertex),
                compilation_options: Default::default(),
                buffers: self.buffers,
            },
            primitive: wgpu::PrimitiveState { cull_mode: None, polygon_mode, ..Default::default() },
            depth_stencil: Some(wgpu::DepthStencilState {
                format: DEPTH,
                depth_write_enabled: Some(polygon_mode == wgpu::PolygonMode::Fill),
                // Reversed depth: nearer is greater.
                depth_compare: Some(wgpu::CompareFunction::Greater),
                stencil: Default::default(),
                bias: Default::default(),
            }),
            multisample: Default::default(),
            fragment: fragment.map(|Fragment { entry, constants, targets }| wgpu::FragmentState {
                module: self.module,
                entry_point: Some(entry),
                compilation_options: wgpu::PipelineCompilationOptions { constants, ..Default::default() },
                targets,
            }),
            multiview_mask: None,
            cache: None,
        })
    }
}

/// A shader module of a text that was put together when this was compiled.
pub(crate) fn shader(gpu: &Gpu, label: &str, text: &'static str) -> wgpu::ShaderModule {
    gpu.device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: Some(label),
        source: wgpu::ShaderSource::Wgsl(text.into()),
    })
}

/// One uniform block at binding 0 of its group, for both stages of a geometry pass.
pub(crate) const UNIFORM_BLOCK: wgpu::BindGroupLayoutEntry = wgpu::BindGroupLayoutEntry {
    binding: 0,
    visibility: wgpu::ShaderStages::VERTEX_FRAGMENT,
    ty: wgpu::BindingType::Buffer {
        ty: wgpu::BufferBindingType::Uniform,
        has_dynamic_offset: false,
        min_binding_size: None,
    },
    count: None,
};
