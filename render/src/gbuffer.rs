//! Pipelines of the geometry passes: what fills the G-buffer, and the wireframe over the picture.

use super::gpu::Gpu;
use super::targets::{ALBEDO, DEPTH, NORMAL, OVERDRAW, RADIANCE};

const COUNT: &str = include_str!("shaders/overdraw.wgsl");

/// Shader, bindings and vertices of something that is drawn into the G-buffer.
pub(crate) struct GeometryPass<'a> {
    pub(crate) module: &'a wgpu::ShaderModule,
    pub(crate) layout: &'a wgpu::PipelineLayout,
    pub(crate) buffers: &'a [Option<wgpu::VertexBufferLayout<'a>>],
}

/// What is made of the pixels.
struct Fragment<'a> {
    module: &'a wgpu::ShaderModule,
    entry: &'a str,
    constants: &'a [(&'a str, f64)],
    targets: &'a [Option<wgpu::ColorTargetState>],
}

impl GeometryPass<'_> {
    /// Fills the G-buffer, with relief mapping or without; entry points of the vertex and fragment stages.
    pub(crate) fn surface(&self, gpu: &Gpu, entry: [&str; 2], relief: bool) -> wgpu::RenderPipeline {
        let constants: &[(&str, f64)] = if relief { &[("RELIEF", 1.0)] } else { &[] };
        let targets = [Some(NORMAL.into()), Some(ALBEDO.into())];
        let fragment = Fragment { module: self.module, entry: entry[1], constants, targets: &targets };
        self.pipeline(gpu, entry[0], Some(fragment), wgpu::PolygonMode::Fill)
    }

    /// Draws nothing but depth.
    pub(crate) fn caster(&self, gpu: &Gpu, entry: &str) -> wgpu::RenderPipeline {
        self.pipeline(gpu, entry, None, wgpu::PolygonMode::Fill)
    }

    /// Draws the edges of what is visible; `None` where the device cannot draw triangles as lines.
    pub(crate) fn wire(&self, gpu: &Gpu, entry: [&str; 2]) -> Option<wgpu::RenderPipeline> {
        let lines = gpu.device.features().contains(wgpu::Features::POLYGON_MODE_LINE);
        let targets = [Some(RADIANCE.into())];
        let fragment = Fragment { module: self.module, entry: entry[1], constants: &[], targets: &targets };
        lines.then(|| self.pipeline(gpu, entry[0], Some(fragment), wgpu::PolygonMode::Line))
    }

    /// Adds one to a pixel whenever something is drawn there that lies before what was drawn.
    pub(crate) fn overdraw(&self, gpu: &Gpu, entry: &str) -> wgpu::RenderPipeline {
        let module = shader(gpu, "overdraw", COUNT);
        let add = wgpu::BlendComponent {
            src_factor: wgpu::BlendFactor::One,
            dst_factor: wgpu::BlendFactor::One,
            operation: wgpu::BlendOperation::Add,
        };
        let targets = [Some(wgpu::ColorTargetState {
            format: OVERDRAW,
            blend: Some(wgpu::BlendState { color: add, alpha: add }),
            write_mask: wgpu::ColorWrites::ALL,
        })];
        let fragment = Fragment { module: &module, entry: "fs_overdraw", constants: &[], targets: &targets };
        self.pipeline(gpu, entry, Some(fragment), wgpu::PolygonMode::Fill)
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
            fragment: fragment.map(|Fragment { module, entry, constants, targets }| wgpu::FragmentState {
                module,
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
