//! Pipelines of the geometry passes: G-buffer, shadow casters, emission, motion, transparency and wireframe.

use crate::frame::targets::{ALBEDO, DEPTH, EDGES, MOTION, NORMAL, OVERDRAW, RADIANCE, SPECULAR};
use crate::resources::descriptors::{blend, buffer_binding, layout_entry, wgsl};
use crate::resources::gpu::Gpu;

const COUNT: &str = wgsl!("overdraw");

/// Shader, bindings and vertex layout of geometry.
pub(crate) struct GeometryPass<'a> {
    pub(crate) module: &'a wgpu::ShaderModule,
    pub(crate) layout: &'a wgpu::PipelineLayout,
    pub(crate) buffers: &'a [Option<wgpu::VertexBufferLayout<'a>>],
    /// Override constants of the vertex stage.
    pub(crate) vertex_constants: &'a [(&'a str, f64)],
}

/// Fragment stage and its targets.
struct Fragment<'a> {
    module: &'a wgpu::ShaderModule,
    entry: &'a str,
    constants: &'a [(&'a str, f64)],
    targets: &'a [Option<wgpu::ColorTargetState>],
}

/// What is drawn over the picture for a facing, one after the other.
pub(crate) type Steps = Vec<wgpu::RenderPipeline>;

/// Rasterisation and depth state.
#[derive(Clone, Copy)]
struct Raster {
    polygon_mode: wgpu::PolygonMode,
    cull: Option<wgpu::Face>,
    compare: wgpu::CompareFunction,
    write: bool,
}

impl Raster {
    /// Reversed depth: nearer is greater.
    const FILL: Self = Self {
        polygon_mode: wgpu::PolygonMode::Fill,
        cull: None,
        compare: wgpu::CompareFunction::Greater,
        write: true,
    };
}

/// Additive blending.
pub(crate) const ADD: wgpu::BlendState =
    blend(wgpu::BlendFactor::One, wgpu::BlendFactor::One, wgpu::BlendOperation::Add);

/// Multiplies the colours of the picture.
pub(crate) const MULTIPLY: wgpu::BlendState = wgpu::BlendState {
    color: blend(wgpu::BlendFactor::Zero, wgpu::BlendFactor::Src, wgpu::BlendOperation::Add).color,
    alpha: blend(wgpu::BlendFactor::Zero, wgpu::BlendFactor::One, wgpu::BlendOperation::Add).alpha,
};

impl GeometryPass<'_> {
    /// Pipeline into the G-buffer; takes the entry points of both stages and the override constants.
    pub(crate) fn surface(
        &self,
        gpu: &Gpu,
        entry: [&str; 2],
        constants: &[(&str, f64)],
    ) -> wgpu::RenderPipeline {
        let targets = [Some(NORMAL.into()), Some(ALBEDO.into())];
        let fragment = Fragment { module: self.module, entry: entry[1], constants, targets: &targets };
        self.pipeline(gpu, entry[0], Some(fragment), Raster::FILL)
    }

    /// Depth-only pipeline for shadow maps.
    pub(crate) fn caster(&self, gpu: &Gpu, entry: &str) -> wgpu::RenderPipeline {
        self.pipeline(gpu, entry, None, Raster::FILL)
    }

    /// Depth-only pipeline with alpha test.
    pub(crate) fn pierced_caster(
        &self,
        gpu: &Gpu,
        entry: [&str; 2],
        constants: &[(&str, f64)],
    ) -> wgpu::RenderPipeline {
        let fragment = Fragment { module: self.module, entry: entry[1], constants, targets: &[] };
        self.pipeline(gpu, entry[0], Some(fragment), Raster::FILL)
    }

    /// Depth-only pipeline whose fragment stage writes the depth.
    pub(crate) fn sunken_caster(
        &self,
        gpu: &Gpu,
        entry: [&str; 2],
        constants: &[(&str, f64)],
    ) -> wgpu::RenderPipeline {
        let fragment = Fragment { module: self.module, entry: entry[1], constants, targets: &[] };
        self.pipeline(gpu, entry[0], Some(fragment), Raster::FILL)
    }

    /// Adds emission to the picture, where depth equals the G-buffer's.
    pub(crate) fn emission(
        &self,
        gpu: &Gpu,
        entry: [&str; 2],
        constants: &[(&str, f64)],
    ) -> wgpu::RenderPipeline {
        let target = wgpu::ColorTargetState { blend: Some(ADD), ..RADIANCE.into() };
        let fragment = Fragment { module: self.module, entry: entry[1], constants, targets: &[Some(target)] };
        let raster = Raster { compare: wgpu::CompareFunction::Equal, write: false, ..Raster::FILL };
        self.pipeline(gpu, entry[0], Some(fragment), raster)
    }

    /// Writes specular reflection, where depth equals the G-buffer's.
    pub(crate) fn specular(
        &self,
        gpu: &Gpu,
        entry: [&str; 2],
        constants: &[(&str, f64)],
    ) -> wgpu::RenderPipeline {
        let targets = [Some(SPECULAR.into())];
        let fragment = Fragment { module: self.module, entry: entry[1], constants, targets: &targets };
        let raster = Raster { compare: wgpu::CompareFunction::Equal, write: false, ..Raster::FILL };
        self.pipeline(gpu, entry[0], Some(fragment), raster)
    }

    /// Writes motion since the previous frame, where depth equals the G-buffer's.
    pub(crate) fn motion(&self, gpu: &Gpu, entry: [&str; 2]) -> wgpu::RenderPipeline {
        let targets = [Some(MOTION.into())];
        let fragment = Fragment { module: self.module, entry: entry[1], constants: &[], targets: &targets };
        let raster = Raster { compare: wgpu::CompareFunction::Equal, write: false, ..Raster::FILL };
        self.pipeline(gpu, entry[0], Some(fragment), raster)
    }

    /// Draws transparent faces over the picture by entry points of the fragment stage, each with its blending, one after
    /// the other: back faces first, then front faces.
    pub(crate) fn transparent(
        &self,
        gpu: &Gpu,
        vertex: &str,
        steps: &[(&str, wgpu::BlendState)],
        constants: &[(&str, f64)],
    ) -> [Steps; 2] {
        [wgpu::Face::Front, wgpu::Face::Back].map(|cull| {
            let step = |&(entry, blend): &(&str, wgpu::BlendState)| {
                let targets = [Some(wgpu::ColorTargetState { blend: Some(blend), ..RADIANCE.into() })];
                let fragment = Fragment { module: self.module, entry, constants, targets: &targets };
                let raster = Raster { cull: Some(cull), write: false, ..Raster::FILL };
                self.pipeline(gpu, vertex, Some(fragment), raster)
            };
            steps.iter().map(step).collect()
        })
    }

    /// Counts visible triangle edges per pixel; `None` where the device cannot draw triangles as lines.
    pub(crate) fn wire(&self, gpu: &Gpu, entry: [&str; 2]) -> Option<wgpu::RenderPipeline> {
        let lines = gpu.device.features().contains(wgpu::Features::POLYGON_MODE_LINE);
        let target = wgpu::ColorTargetState { blend: Some(ADD), ..EDGES.into() };
        let fragment =
            Fragment { module: self.module, entry: entry[1], constants: &[], targets: &[Some(target)] };
        let raster = Raster { polygon_mode: wgpu::PolygonMode::Line, write: false, ..Raster::FILL };
        lines.then(|| self.pipeline(gpu, entry[0], Some(fragment), raster))
    }

    /// Counts fragments that pass the depth test.
    pub(crate) fn overdraw(&self, gpu: &Gpu, entry: &str) -> wgpu::RenderPipeline {
        self.count(gpu, (&shader(gpu, "overdraw", COUNT), [entry, "fs_overdraw"]), &[], Raster::FILL)
    }

    /// Counts fragments that pass the depth test and the shader's alpha test.
    pub(crate) fn pierced_overdraw(
        &self,
        gpu: &Gpu,
        entry: [&str; 2],
        constants: &[(&str, f64)],
    ) -> wgpu::RenderPipeline {
        self.count(gpu, (self.module, entry), constants, Raster::FILL)
    }

    /// Counts fragments that section planes leave; `write`: those that pass the depth test among each other.
    pub(crate) fn cut_overdraw(
        &self,
        gpu: &Gpu,
        entry: [&str; 2],
        constants: &[(&str, f64)],
        write: bool,
    ) -> wgpu::RenderPipeline {
        self.count(gpu, (self.module, entry), constants, Raster { write, ..Raster::FILL })
    }

    /// Counts transparent fragments, without writing depth.
    pub(crate) fn transparent_overdraw(&self, gpu: &Gpu, entry: &str) -> wgpu::RenderPipeline {
        let raster = Raster { write: false, ..Raster::FILL };
        self.count(gpu, (&shader(gpu, "overdraw", COUNT), [entry, "fs_overdraw"]), &[], raster)
    }

    fn count(
        &self,
        gpu: &Gpu,
        (module, entry): (&wgpu::ShaderModule, [&str; 2]),
        constants: &[(&str, f64)],
        raster: Raster,
    ) -> wgpu::RenderPipeline {
        let target = wgpu::ColorTargetState { blend: Some(ADD), ..OVERDRAW.into() };
        let fragment = Fragment { module, entry: entry[1], constants, targets: &[Some(target)] };
        self.pipeline(gpu, entry[0], Some(fragment), raster)
    }

    fn pipeline(
        &self,
        gpu: &Gpu,
        vertex: &str,
        fragment: Option<Fragment<'_>>,
        Raster { polygon_mode, cull, compare, write }: Raster,
    ) -> wgpu::RenderPipeline {
        gpu.render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: Some(fragment.as_ref().map_or(vertex, |fragment| fragment.entry)),
            layout: Some(self.layout),
            vertex: wgpu::VertexState {
                module: self.module,
                entry_point: Some(vertex),
                compilation_options: wgpu::PipelineCompilationOptions {
                    constants: self.vertex_constants,
                    ..Default::default()
                },
                buffers: self.buffers,
            },
            primitive: wgpu::PrimitiveState { cull_mode: cull, polygon_mode, ..Default::default() },
            depth_stencil: Some(wgpu::DepthStencilState {
                format: DEPTH,
                depth_write_enabled: Some(write),
                depth_compare: Some(compare),
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

/// Compiles a shader module from WGSL source.
pub(crate) fn shader(gpu: &Gpu, label: &str, text: &'static str) -> wgpu::ShaderModule {
    gpu.shader(label, text)
}

/// A uniform block at binding 0, for both stages of a geometry pass.
pub(crate) const UNIFORM_BLOCK: wgpu::BindGroupLayoutEntry =
    layout_entry(0, wgpu::ShaderStages::VERTEX_FRAGMENT, buffer_binding(wgpu::BufferBindingType::Uniform));
