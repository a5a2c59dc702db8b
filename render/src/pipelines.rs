//! Shader modules and pipelines, one per pass.

use super::fullscreen::fullscreen_pipeline;
use super::gbuffer::{UNIFORM_BLOCK, shader};
use super::gpu::Gpu;
use super::material_kit::MaterialKit;
use super::mesh_pipelines::MeshPipelines;
use super::targets::{DISPLAY, OCCLUSION, RADIANCE, SUNLIGHT};

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
    include_str!("shaders/shadows.wgsl"),
    include_str!("shaders/sunlight.wgsl")
);
const LIGHTING: &str = concat!(
    include_str!("shaders/common.wgsl"),
    include_str!("shaders/fullscreen.wgsl"),
    include_str!("shaders/targets.wgsl"),
    include_str!("shaders/sky.wgsl"),
    include_str!("shaders/brdf.wgsl"),
    include_str!("shaders/lighting.wgsl")
);
const WIREFRAME: &str = concat!(
    include_str!("shaders/common.wgsl"),
    include_str!("shaders/fullscreen.wgsl"),
    include_str!("shaders/wireframe.wgsl")
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
    include_str!("shaders/targets.wgsl"),
    include_str!("shaders/motion.wgsl"),
    include_str!("shaders/debug.wgsl")
);

/// Everything compiled for one target format.
#[derive(Debug)]
pub(crate) struct Pipelines {
    /// Group 0 of the geometry passes: the frame's uniform block.
    pub(crate) frame_layout: wgpu::BindGroupLayout,
    pub(crate) meshes: MeshPipelines,
    /// The edges over the lit picture.
    pub(crate) wireframe: wgpu::RenderPipeline,
    pub(crate) occlusion: wgpu::RenderPipeline,
    pub(crate) blur: wgpu::RenderPipeline,
    pub(crate) sunlight: wgpu::RenderPipeline,
    /// Without occlusion and with, of each without shadows and with.
    pub(crate) lighting: [[wgpu::RenderPipeline; 2]; 2],
    pub(crate) sky: wgpu::RenderPipeline,
    pub(crate) tonemap: wgpu::RenderPipeline,
    /// The same of a mean of frames.
    pub(crate) tonemap_temporal: wgpu::RenderPipeline,
    /// The same where edges are smoothed after it.
    pub(crate) tonemap_display: wgpu::RenderPipeline,
    pub(crate) antialias: wgpu::RenderPipeline,
}

impl Pipelines {
    pub(crate) fn new(gpu: &Gpu, kit: &MaterialKit, target: wgpu::TextureFormat) -> Self {
        let device = &gpu.device;
        let ssao = shader(gpu, "ssao", SSAO);
        let sunlight = shader(gpu, "sunlight", SHADOWS);
        let (antialias, wireframe) =
            (shader(gpu, "antialias", ANTIALIAS), shader(gpu, "wireframe", WIREFRAME));
        let (lighting, tonemap) = (shader(gpu, "lighting", LIGHTING), shader(gpu, "tonemap", TONEMAP));

        let frame_layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("frame"),
            entries: &[UNIFORM_BLOCK],
        });
        let full = |module: &wgpu::ShaderModule, entry, target, constants: &[(&str, f64)]| {
            fullscreen_pipeline(gpu, module, entry, target, constants)
        };
        let over =
            wgpu::ColorTargetState { blend: Some(wgpu::BlendState::ALPHA_BLENDING), ..RADIANCE.into() };
        let decode: &[(&str, f64)] = if target.is_srgb() { &[("DECODE_SRGB", 1.0)] } else { &[] };
        let encode: &[(&str, f64)] = if target.is_srgb() { &[] } else { &[("ENCODE_SRGB", 1.0)] };
        Self {
            meshes: MeshPipelines::new(gpu, kit, &frame_layout),
            wireframe: full(&wireframe, "fs_wireframe", over, &[]),
            occlusion: full(&ssao, "fs_occlusion", OCCLUSION.into(), &[]),
            blur: full(&ssao, "fs_blur", OCCLUSION.into(), &[]),
            sunlight: full(&sunlight, "fs_sunlight", SUNLIGHT.into(), &[]),
            lighting: [0.0, 1.0].map(|occlusion| {
                [0.0, 1.0].map(|shadows| {
                    let constants = [("OCCLUSION", occlusion), ("SHADOWS", shadows)];
                    full(&lighting, "fs_lighting", RADIANCE.into(), &constants)
                })
            }),
            sky: full(&lighting, "fs_sky", RADIANCE.into(), &[]),
            tonemap: full(&tonemap, "fs_tonemap", target.into(), encode),
            tonemap_temporal: full(
                &tonemap,
                "fs_tonemap",
                target.into(),
                &[encode, &[("TEMPORAL", 1.0)]].concat(),
            ),
            tonemap_display: full(&tonemap, "fs_tonemap", DISPLAY.into(), &[("ENCODE_SRGB", 1.0)]),
            antialias: full(&antialias, "fs_antialias", target.into(), decode),
            frame_layout,
        }
    }
}
