//! Everything that is compiled for one format of targets. Each part is when it is needed first, or before
//! ([`super::compiler`]).

use std::sync::{Arc, OnceLock};

use super::fullscreen::fullscreen_pipeline;
use super::gbuffer::{UNIFORM_BLOCK, shader};
use super::gpu::Gpu;
use super::material_kit::MaterialKit;
use super::mesh_pipelines::MeshPipelines;
use super::targets::{DISPLAY, OCCLUSION, RADIANCE, SUNLIGHT};
use super::temporal::Resolve;
use super::terrain::TerrainPipelines;
use super::water::WaterPipelines;

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
const ENLARGE: &str = concat!(
    include_str!("shaders/common.wgsl"),
    include_str!("shaders/fullscreen.wgsl"),
    include_str!("shaders/between.wgsl"),
    include_str!("shaders/enlarge.wgsl")
);
const TONEMAP: &str = concat!(
    include_str!("shaders/common.wgsl"),
    include_str!("shaders/fullscreen.wgsl"),
    include_str!("shaders/between.wgsl"),
    include_str!("shaders/tonemap.wgsl")
);
/// For [`super::composite`].
pub(crate) const COMPOSITE: &str = concat!(
    include_str!("shaders/common.wgsl"),
    include_str!("shaders/fullscreen.wgsl"),
    include_str!("shaders/between.wgsl"),
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

/// A pass over the whole of a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Whole {
    /// The edges over the lit picture.
    Wireframe,
    Occlusion,
    Blur,
    Sunlight,
    Lighting {
        occlusion: bool,
        shadows: bool,
    },
    /// Of a picture without surfaces.
    Sky,
    ToneMap,
    /// The same of a mean of frames.
    ToneMapTemporal,
    /// The same where edges are smoothed after it.
    ToneMapDisplay,
    AntiAlias,
    /// The same where the picture is enlarged after it.
    AntiAliasSmall,
    Enlarge,
}

impl Whole {
    const COUNT: usize = 15;

    const fn number(self) -> usize {
        match self {
            Self::Lighting { occlusion, shadows } => (occlusion as usize) << 1 | shadows as usize,
            Self::Wireframe => 4,
            Self::Occlusion => 5,
            Self::Blur => 6,
            Self::Sunlight => 7,
            Self::Sky => 8,
            Self::ToneMap => 9,
            Self::ToneMapTemporal => 10,
            Self::ToneMapDisplay => 11,
            Self::AntiAlias => 12,
            Self::AntiAliasSmall => 13,
            Self::Enlarge => 14,
        }
    }
}

/// Texts of shaders.
#[derive(Clone, Copy)]
enum Module {
    Ssao,
    Sunlight,
    AntiAlias,
    Wireframe,
    Lighting,
    ToneMap,
    Enlarge,
}

/// See the module.
#[derive(Debug)]
pub(crate) struct Pipelines {
    /// Group 0 of the geometry passes: the frame's uniform block.
    pub(crate) frame_layout: wgpu::BindGroupLayout,
    pub(crate) meshes: MeshPipelines,
    terrain: OnceLock<TerrainPipelines>,
    water: OnceLock<WaterPipelines>,
    /// Of means over time, whose pass has it too.
    pub(crate) resolve: Arc<OnceLock<Resolve>>,
    modules: [OnceLock<wgpu::ShaderModule>; 7],
    whole: [OnceLock<wgpu::RenderPipeline>; Whole::COUNT],
    target: wgpu::TextureFormat,
}

impl Pipelines {
    pub(crate) fn new(gpu: &Gpu, kit: &MaterialKit, target: wgpu::TextureFormat) -> Self {
        let frame_layout = gpu.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("frame"),
            entries: &[UNIFORM_BLOCK],
        });
        Self {
            meshes: MeshPipelines::new(gpu, kit, &frame_layout),
            terrain: OnceLock::new(),
            water: OnceLock::new(),
            resolve: Arc::default(),
            modules: Default::default(),
            whole: Default::default(),
            target,
            frame_layout,
        }
    }

    /// What draws tiles of a terrain.
    pub(crate) fn terrain(&self, gpu: &Gpu) -> &TerrainPipelines {
        self.terrain.get_or_init(|| TerrainPipelines::new(gpu, &self.frame_layout))
    }

    /// What draws water.
    pub(crate) fn water(&self, gpu: &Gpu) -> &WaterPipelines {
        self.water.get_or_init(|| WaterPipelines::new(gpu, self.meshes.light_layout(gpu, false)))
    }

    /// What draws a pass over the whole of a picture.
    pub(crate) fn whole(&self, gpu: &Gpu, pass: Whole) -> &wgpu::RenderPipeline {
        self.whole[pass.number()].get_or_init(|| self.compile(gpu, pass))
    }

    fn module(&self, gpu: &Gpu, module: Module) -> &wgpu::ShaderModule {
        let (label, text) = match module {
            Module::Ssao => ("ssao", SSAO),
            Module::Sunlight => ("sunlight", SHADOWS),
            Module::AntiAlias => ("antialias", ANTIALIAS),
            Module::Wireframe => ("wireframe", WIREFRAME),
            Module::Lighting => ("lighting", LIGHTING),
            Module::ToneMap => ("tonemap", TONEMAP),
            Module::Enlarge => ("enlarge", ENLARGE),
        };
        self.modules[module as usize].get_or_init(|| shader(gpu, label, text))
    }

    fn compile(&self, gpu: &Gpu, pass: Whole) -> wgpu::RenderPipeline {
        let full = |module, entry, target: wgpu::ColorTargetState, constants: &[(&str, f64)]| {
            fullscreen_pipeline(gpu, self.module(gpu, module), entry, target, constants)
        };
        let share = |on: bool| f64::from(u8::from(on));
        // What the target does not encode, the shader does; what it decodes, too.
        let decode: &[(&str, f64)] = if self.target.is_srgb() { &[("DECODE_SRGB", 1.0)] } else { &[] };
        let encode: &[(&str, f64)] = if self.target.is_srgb() { &[] } else { &[("ENCODE_SRGB", 1.0)] };
        match pass {
            Whole::Wireframe => {
                let blend = Some(wgpu::BlendState::ALPHA_BLENDING);
                full(
                    Module::Wireframe,
                    "fs_wireframe",
                    wgpu::ColorTargetState { blend, ..RADIANCE.into() },
                    &[],
                )
            }
            Whole::Occlusion => full(Module::Ssao, "fs_occlusion", OCCLUSION.into(), &[]),
            Whole::Blur => full(Module::Ssao, "fs_blur", OCCLUSION.into(), &[]),
            Whole::Sunlight => full(Module::Sunlight, "fs_sunlight", SUNLIGHT.into(), &[]),
            Whole::Lighting { occlusion, shadows } => {
                let constants = [("OCCLUSION", share(occlusion)), ("SHADOWS", share(shadows))];
                full(Module::Lighting, "fs_lighting", RADIANCE.into(), &constants)
            }
            Whole::Sky => full(Module::Lighting, "fs_sky", RADIANCE.into(), &[]),
            Whole::ToneMap => full(Module::ToneMap, "fs_tonemap", self.target.into(), encode),
            Whole::ToneMapTemporal => {
                let constants = [encode, &[("TEMPORAL", 1.0)]].concat();
                full(Module::ToneMap, "fs_tonemap", self.target.into(), &constants)
            }
            Whole::ToneMapDisplay => {
                let constants = [("ENCODE_SRGB", 1.0), ("AS_IT_IS", 1.0)];
                full(Module::ToneMap, "fs_tonemap", DISPLAY.into(), &constants)
            }
            Whole::AntiAlias => full(Module::AntiAlias, "fs_antialias", self.target.into(), decode),
            Whole::AntiAliasSmall => full(Module::AntiAlias, "fs_antialias", DISPLAY.into(), &[]),
            Whole::Enlarge => full(Module::Enlarge, "fs_enlarge", self.target.into(), decode),
        }
    }
}
