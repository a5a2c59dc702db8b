//! Shader modules and pipelines, one per pass.

use super::gbuffer::{GeometryPass, UNIFORM_BLOCK, shader};
use super::gpu::Gpu;
use super::instance::{INSTANCE_ATTRIBUTES, InstanceRaw};
use super::material::MaterialKit;
use super::targets::{DISPLAY, OCCLUSION, RADIANCE, SUNLIGHT};
use super::vertex::{PackedVertex, VERTEX_ATTRIBUTES};

/// For [`super::debug`], too.
pub(crate) const GBUFFER: &str = concat!(
    include_str!("shaders/common.wgsl"),
    include_str!("shaders/gbuffer.wgsl"),
    include_str!("shaders/relief.wgsl")
);
const SSAO: &str = concat!(
    include_str!("shaders/common.wgsl"),
    include_str!("shaders/fullscreen.wgsl"),
    include_str!("shaders/surface.wgsl"),
    include_str!("shaders/ssao.wgsl")
);
const SHADOWS: &str = concat!(
    include_str!("shaders/common.wgsl"),
    include_str!("shaders/fullscreen.wgsl"),
    include_str!("shaders/surface.wgsl"),
    include_str!("shaders/sunlight.wgsl")
);
const LIGHTING: &str = concat!(
    include_str!("shaders/common.wgsl"),
    include_str!("shaders/fullscreen.wgsl"),
    include_str!("shaders/sky.wgsl"),
    include_str!("shaders/lighting.wgsl")
);
const ANTIALIAS: &str = concat!(
    include_str!("shaders/common.wgsl"),
    include_str!("shaders/fullscreen.wgsl"),
    include_str!("shaders/antialias.wgsl")
);
const TONEMAP: &str = concat!(
    include_str!("shaders/common.wgsl"),
    include_str!("shaders/fullscreen.wgsl"),
    include_str!("shaders/tonemap.wgsl")
);
/// For [`super::composite`].
pub(crate) const COMPOSITE: &str = concat!(
    include_str!("shaders/common.wgsl"),
    include_str!("shaders/fullscreen.wgsl"),
    include_str!("shaders/tonemap.wgsl"),
    include_str!("shaders/composite.wgsl")
);

/// For [`super::debug`].
pub(crate) const DEBUG: &str = concat!(
    include_str!("shaders/common.wgsl"),
    include_str!("shaders/fullscreen.wgsl"),
    include_str!("shaders/debug.wgsl")
);

/// Vertices and instances of meshes.
pub(crate) const MESH_BUFFERS: [Option<wgpu::VertexBufferLayout<'_>>; 2] = [
    Some(wgpu::VertexBufferLayout {
        array_stride: size_of::<PackedVertex>() as u64,
        step_mode: wgpu::VertexStepMode::Vertex,
        attributes: &VERTEX_ATTRIBUTES,
    }),
    Some(wgpu::VertexBufferLayout {
        array_stride: size_of::<InstanceRaw>() as u64,
        step_mode: wgpu::VertexStepMode::Instance,
        attributes: &INSTANCE_ATTRIBUTES,
    }),
];

/// Everything compiled for one target format.
#[derive(Debug)]
pub(crate) struct Pipelines {
    /// Group 0 of the geometry passes: the frame's uniform block.
    pub(crate) frame_layout: wgpu::BindGroupLayout,
    pub(crate) surface: wgpu::RenderPipeline,
    pub(crate) surface_relief: wgpu::RenderPipeline,
    /// Absent where the device cannot draw triangles as lines.
    pub(crate) wire: Option<wgpu::RenderPipeline>,
    pub(crate) occlusion: wgpu::RenderPipeline,
    pub(crate) blur: wgpu::RenderPipeline,
    /// Into maps of shadows.
    pub(crate) caster: wgpu::RenderPipeline,
    pub(crate) sunlight: wgpu::RenderPipeline,
    /// Without occlusion and with, of each without shadows and with.
    pub(crate) lighting: [[wgpu::RenderPipeline; 2]; 2],
    pub(crate) sky: wgpu::RenderPipeline,
    pub(crate) tonemap: wgpu::RenderPipeline,
    /// The same where edges are smoothed after it.
    pub(crate) tonemap_display: wgpu::RenderPipeline,
    pub(crate) antialias: wgpu::RenderPipeline,
}

impl Pipelines {
    pub(crate) fn new(gpu: &Gpu, kit: &MaterialKit, target: wgpu::TextureFormat) -> Self {
        let device = &gpu.device;
        let (gbuffer, ssao) = (shader(gpu, "gbuffer", GBUFFER), shader(gpu, "ssao", SSAO));
        let sunlight = shader(gpu, "sunlight", SHADOWS);
        let antialias = shader(gpu, "antialias", ANTIALIAS);
        let (lighting, tonemap) = (shader(gpu, "lighting", LIGHTING), shader(gpu, "tonemap", TONEMAP));

        let frame_layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("frame"),
            entries: &[UNIFORM_BLOCK],
        });
        let layout = |label, groups: &[Option<&wgpu::BindGroupLayout>]| {
            device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
                label: Some(label),
                bind_group_layouts: groups,
                immediate_size: 0,
            })
        };
        let geometry_layout = layout("geometry", &[Some(&frame_layout), Some(&kit.layout)]);
        let caster_layout = layout("casters", &[Some(&frame_layout)]);
        let geometry = GeometryPass { module: &gbuffer, layout: &geometry_layout, buffers: &MESH_BUFFERS };
        let full = |module: &wgpu::ShaderModule,
                    entry,
                    format: wgpu::TextureFormat,
                    constants: &[(&str, f64)]| {
            device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
                label: Some(entry),
                layout: None,
                vertex: wgpu::VertexState {
                    module,
                    entry_point: Some("vs_fullscreen"),
                    compilation_options: Default::default(),
                    buffers: &[],
                },
                primitive: Default::default(),
                depth_stencil: None,
                multisample: Default::default(),
                fragment: Some(wgpu::FragmentState {
                    module,
                    entry_point: Some(entry),
                    compilation_options: wgpu::PipelineCompilationOptions { constants, ..Default::default() },
                    targets: &[Some(format.into())],
                }),
                multiview_mask: None,
                cache: None,
            })
        };
        let decode: &[(&str, f64)] = if target.is_srgb() { &[("DECODE_SRGB", 1.0)] } else { &[] };
        let encode: &[(&str, f64)] = if target.is_srgb() { &[] } else { &[("ENCODE_SRGB", 1.0)] };
        Self {
            surface: geometry.surface(gpu, ["vs_surface", "fs_surface"], false),
            surface_relief: geometry.surface(gpu, ["vs_surface", "fs_surface"], true),
            wire: geometry.wire(gpu, ["vs_wire", "fs_wire"]),
            occlusion: full(&ssao, "fs_occlusion", OCCLUSION, &[]),
            blur: full(&ssao, "fs_blur", OCCLUSION, &[]),
            caster: GeometryPass { layout: &caster_layout, ..geometry }.caster(gpu, "vs_caster"),
            sunlight: full(&sunlight, "fs_sunlight", SUNLIGHT, &[]),
            lighting: [0.0, 1.0].map(|occlusion| {
                [0.0, 1.0].map(|shadows| {
                    let constants = [("OCCLUSION", occlusion), ("SHADOWS", shadows)];
                    full(&lighting, "fs_lighting", RADIANCE, &constants)
                })
            }),
            sky: full(&lighting, "fs_sky", RADIANCE, &[]),
            tonemap: full(&tonemap, "fs_tonemap", target, encode),
            tonemap_display: full(&tonemap, "fs_tonemap", DISPLAY, &[("ENCODE_SRGB", 1.0)]),
            antialias: full(&antialias, "fs_antialias", target, decode),
            frame_layout,
        }
    }
}
