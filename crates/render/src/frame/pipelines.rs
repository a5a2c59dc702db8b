//! All pipelines for one target format. Each is compiled on first use, or ahead of it ([`crate::frame::compiler`]).

use std::sync::{Arc, OnceLock};

use crate::frame::fullscreen::fullscreen_pipeline;
use crate::frame::targets::{DISPLAY, OCCLUSION, OCCLUSION_MEAN, RADIANCE, SUNLIGHT};
use crate::passes::bloom::BloomPipelines;
use crate::passes::caps::Caps;
use crate::passes::floor::FloorPipelines;
use crate::passes::gbuffer::{ADD, UNIFORM_BLOCK, shader};
#[cfg(any(test, feature = "methods"))]
use crate::passes::ink::InkPipelines;
use crate::passes::mesh_pipelines::MeshPipelines;
use crate::passes::occlusion::{OcclusionMethod, OcclusionNormals};
#[cfg(any(test, feature = "methods"))]
use crate::passes::occlusion_layers::LayerPipelines;
use crate::passes::pn_triangles::{PatchPipelines, PnTriangles};
use crate::passes::reflections::PYRAMID;
use crate::passes::temporal::Resolve;
use crate::passes::water::WaterPipelines;
use crate::resources::descriptors::{blend, group_layout, wgsl};
use crate::resources::gpu::Gpu;
use crate::scene::material_bindings::MaterialBindings;
use crate::scene::terrain::TerrainPipelines;

/// Shader source of an occlusion estimator.
macro_rules! occlusion {
    ($($file:literal),+) => {
        wgsl!("common", "fullscreen", "surface", "occlusion_radius", "targets", "occlusion_normal", $($file),+)
    };
}

#[cfg(any(test, feature = "methods"))]
const SSAO: &str = occlusion!("occlusion", "ssao", "occlusion_half", "whole");
#[cfg(any(test, feature = "methods"))]
const HBAO: &str = occlusion!("occlusion", "hbao", "occlusion_half", "whole");
#[cfg(any(test, feature = "methods"))]
/// For [`crate::passes::occlusion_layers`].
const HBAO_PLUS: &str = occlusion!("occlusion", "hbao", "layers");
#[cfg(any(test, feature = "methods"))]
const ALCHEMY: &str = occlusion!("occlusion", "alchemy", "occlusion_half", "whole");
const GTAO: &str = occlusion!("occlusion", "slices", "gtao", "occlusion_half", "whole");
#[cfg(any(test, feature = "methods"))]
const BITMASK: &str = occlusion!("occlusion", "slices", "bitmask", "occlusion_half", "whole");
const BLUR: &str = occlusion!("occlusion_blur");
const UPSAMPLE: &str = occlusion!("occlusion_half", "occlusion_upsample");
const SHADOWS: &str = wgsl!("common", "fullscreen", "surface", "shadows", "sunlight");
/// Shader sources without and with materials that set the specular reflection of dielectrics.
macro_rules! by_specular {
    ($($file:literal),+) => {
        [
            wgsl!("common", "fullscreen", "targets", "sky", "brdf", "usual_specular", $($file),+),
            wgsl!("common", "fullscreen", "targets", "sky", "brdf", "specular", $($file),+),
        ]
    };
}

const LIGHTING: [&str; 2] = by_specular!("lighting");
const REFLECTIONS: [&str; 2] = by_specular!("surface", "tracing", "reflections");
const DEPTH_PYRAMID: &str = wgsl!("fullscreen", "pyramid");
const WIREFRAME: &str = wgsl!("common", "fullscreen", "wireframe");
const ANTIALIAS: &str = wgsl!("common", "fullscreen", "antialias");
const ENLARGE: &str = wgsl!("common", "fullscreen", "enlarge");
const TONEMAP: &str = wgsl!("common", "fullscreen", "between", "tonemap");
/// For [`crate::frame::composite`].
pub(crate) const COMPOSITE: &str = wgsl!("common", "fullscreen", "between", "tonemap", "composite");

/// For [`crate::passes::debug`].
pub(crate) const DEBUG: &str = wgsl!("common", "fullscreen", "targets", "motion", "debug");

/// Blends by the blend constant.
const BY_SHARE: wgpu::BlendState =
    blend(wgpu::BlendFactor::Constant, wgpu::BlendFactor::OneMinusConstant, wgpu::BlendOperation::Add);

/// Variant of an occlusion estimator.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct OcclusionVariant {
    pub(crate) method: OcclusionMethod,
    pub(crate) normals: OcclusionNormals,
    pub(crate) into: OcclusionOutput,
}

/// Target of an occlusion estimate.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum OcclusionOutput {
    /// The frame's texture.
    Frame,
    /// The frame's texture at half resolution.
    Half,
    /// The accumulated mean, weighted by the blend constant.
    Mean,
}

impl OcclusionVariant {
    const COUNT: usize = 3 * OcclusionNormals::ALL.len() * OcclusionMethod::ALL.len();

    const fn number(self) -> usize {
        (self.method as usize * OcclusionNormals::ALL.len() + self.normals as usize) * 3 + self.into as usize
    }
}

/// A fullscreen pass.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum FullscreenPass {
    /// Edges over the lit picture.
    Wireframe,
    Occlusion(OcclusionVariant),
    Blur,
    /// Upsampling from half resolution.
    Upsample,
    Sunlight,
    /// `specular`: materials set the specular reflection of dielectrics.
    Lighting {
        occlusion: bool,
        shadows: bool,
        specular: bool,
    },
    DepthPyramid,
    Reflections {
        occlusion: bool,
        by_cells: bool,
        specular: bool,
    },
    /// A picture without surfaces.
    Sky,
    ToneMap,
    /// Tone mapping of the accumulated picture.
    ToneMapTemporal,
    /// Tone mapping before post-process anti-aliasing.
    ToneMapDisplay,
    AntiAlias,
    /// Anti-aliasing before upscaling.
    AntiAliasSmall,
    Enlarge,
}

impl FullscreenPass {
    const COUNT: usize = 28 + OcclusionVariant::COUNT;

    const fn number(self) -> usize {
        match self {
            Self::Lighting { occlusion, shadows, specular } => {
                (specular as usize * 20) + ((occlusion as usize) << 1 | shadows as usize)
            }
            Self::Wireframe => 4,
            Self::Enlarge => 5,
            Self::Blur => 6,
            Self::Sunlight => 7,
            Self::Sky => 8,
            Self::ToneMap => 9,
            Self::ToneMapTemporal => 10,
            Self::ToneMapDisplay => 11,
            Self::AntiAlias => 12,
            Self::AntiAliasSmall => 13,
            Self::DepthPyramid => 14,
            Self::Reflections { occlusion, by_cells, specular } => {
                (specular as usize * 9) + 15 + ((occlusion as usize) << 1 | by_cells as usize)
            }
            Self::Upsample => 19,
            Self::Occlusion(estimate) => 28 + estimate.number(),
        }
    }
}

/// Shader modules.
#[derive(Clone, Copy)]
enum Module {
    Sunlight,
    AntiAlias,
    Wireframe,
    Lighting,
    SpecularLighting,
    DepthPyramid,
    Reflections,
    SpecularReflections,
    ToneMap,
    Enlarge,
    Blur,
    Upsample,
    Gtao,
    #[cfg(any(test, feature = "methods"))]
    Ssao,
    #[cfg(any(test, feature = "methods"))]
    Hbao,
    #[cfg(any(test, feature = "methods"))]
    Alchemy,
    #[cfg(any(test, feature = "methods"))]
    Bitmask,
}

impl Module {
    const COUNT: usize = Self::Gtao as usize + if cfg!(any(test, feature = "methods")) { 5 } else { 1 };

    const fn of(method: OcclusionMethod) -> Self {
        match method {
            #[cfg(any(test, feature = "methods"))]
            // The two differ by their kernel.
            OcclusionMethod::Ssao | OcclusionMethod::SsaoCentred => Self::Ssao,
            #[cfg(any(test, feature = "methods"))]
            // HBAO+ has its own pipelines.
            OcclusionMethod::Hbao | OcclusionMethod::HbaoPlus => Self::Hbao,
            #[cfg(any(test, feature = "methods"))]
            OcclusionMethod::Alchemy => Self::Alchemy,
            OcclusionMethod::Gtao => Self::Gtao,
            #[cfg(any(test, feature = "methods"))]
            OcclusionMethod::Bitmask => Self::Bitmask,
        }
    }
}

/// Pipelines for one target format, compiled lazily.
#[derive(Debug)]
pub(crate) struct Pipelines {
    /// Group 0 of the geometry passes: the frame's uniform block.
    pub(crate) frame_layout: wgpu::BindGroupLayout,
    pub(crate) meshes: MeshPipelines,
    /// Of meshes that section planes cut.
    cut_meshes: OnceLock<MeshPipelines>,
    caps: OnceLock<Caps>,
    kit: MaterialBindings,
    /// Whole, and cut by section planes.
    patches: [OnceLock<PatchPipelines>; 2],
    terrain: OnceLock<TerrainPipelines>,
    /// Reflecting the sky only; and with screen-space reflections by linear and hierarchical search.
    water: [OnceLock<WaterPipelines>; 3],
    bloom: OnceLock<BloomPipelines>,
    floor: OnceLock<FloorPipelines>,
    #[cfg(any(test, feature = "methods"))]
    ink: OnceLock<InkPipelines>,
    #[cfg(any(test, feature = "methods"))]
    /// By source of normals.
    layers: [OnceLock<LayerPipelines>; OcclusionNormals::ALL.len()],
    /// Temporal resolve, shared with its pass.
    pub(crate) resolve: Arc<OnceLock<Resolve>>,
    modules: [OnceLock<wgpu::ShaderModule>; Module::COUNT],
    fullscreen: [OnceLock<wgpu::RenderPipeline>; FullscreenPass::COUNT],
    target: wgpu::TextureFormat,
    /// Bilinear, without repetition.
    between: wgpu::Sampler,
}

impl Pipelines {
    pub(crate) fn new(gpu: &Gpu, kit: &MaterialBindings, target: wgpu::TextureFormat) -> Self {
        // Lists of patches and strokes are made as the frame's eye sees them.
        let lists = if gpu.can_curve() { wgpu::ShaderStages::COMPUTE } else { wgpu::ShaderStages::NONE };
        let visibility = UNIFORM_BLOCK.visibility | lists;
        let entry = wgpu::BindGroupLayoutEntry { visibility, ..UNIFORM_BLOCK };
        let frame_layout = group_layout(gpu, "frame", &[entry]);
        Self {
            meshes: MeshPipelines::new(gpu, (kit, &frame_layout), false),
            cut_meshes: OnceLock::new(),
            caps: OnceLock::new(),
            kit: kit.clone(),
            patches: Default::default(),
            terrain: OnceLock::new(),
            water: Default::default(),
            bloom: OnceLock::new(),
            floor: OnceLock::new(),
            #[cfg(any(test, feature = "methods"))]
            ink: OnceLock::new(),
            #[cfg(any(test, feature = "methods"))]
            layers: Default::default(),
            resolve: Arc::default(),
            modules: Default::default(),
            fullscreen: std::array::from_fn(|_| OnceLock::new()),
            target,
            frame_layout,
            between: gpu.device.create_sampler(&wgpu::SamplerDescriptor {
                label: Some("between texels"),
                mag_filter: wgpu::FilterMode::Linear,
                min_filter: wgpu::FilterMode::Linear,
                ..Default::default()
            }),
        }
    }

    /// The sampler of enlarging.
    pub(crate) fn between(&self) -> &wgpu::Sampler {
        &self.between
    }

    /// Pipelines of meshes, of those that section planes cut or of whole ones.
    pub(crate) fn meshes_of(&self, gpu: &Gpu, cut: bool) -> &MeshPipelines {
        if !cut {
            return &self.meshes;
        }
        self.cut_meshes.get_or_init(|| MeshPipelines::new(gpu, (&self.kit, &self.frame_layout), true))
    }

    /// The depth of caps.
    pub(crate) fn caps(&self, gpu: &Gpu) -> &Caps {
        self.caps.get_or_init(|| Caps::new(gpu))
    }

    /// Pipelines of PN triangles, for a device that can draw them; `cut` by section planes or whole. Their lists are the
    /// same.
    pub(crate) fn patches(&self, gpu: &Gpu, settings: PnTriangles, cut: bool) -> &PatchPipelines {
        self.patches[usize::from(cut)]
            .get_or_init(|| PatchPipelines::new(gpu, settings, (&self.kit, &self.frame_layout), cut))
    }

    /// Pipelines of terrain tiles.
    pub(crate) fn terrain(&self, gpu: &Gpu) -> &TerrainPipelines {
        self.terrain.get_or_init(|| TerrainPipelines::new(gpu, &self.frame_layout))
    }

    /// Pipelines of water; `by_cells` selects the search of screen-space reflections.
    pub(crate) fn water(&self, gpu: &Gpu, by_cells: Option<bool>) -> &WaterPipelines {
        let number = by_cells.map_or(0, |by_cells| 1 + usize::from(by_cells));
        self.water[number]
            .get_or_init(|| WaterPipelines::new(gpu, self.meshes.light_layout(gpu, false), by_cells))
    }

    /// Pipelines of bloom.
    pub(crate) fn bloom(&self, gpu: &Gpu) -> &BloomPipelines {
        self.bloom.get_or_init(|| BloomPipelines::new(gpu))
    }

    /// Pipelines of a studio's ground.
    pub(crate) fn floor(&self, gpu: &Gpu) -> &FloorPipelines {
        self.floor.get_or_init(|| FloorPipelines::new(gpu))
    }

    #[cfg(any(test, feature = "methods"))]
    /// Pipelines of ink.
    pub(crate) fn ink(&self, gpu: &Gpu) -> &InkPipelines {
        self.ink.get_or_init(|| InkPipelines::new(gpu, &self.frame_layout))
    }

    #[cfg(any(test, feature = "methods"))]
    /// Pipelines of HBAO+.
    pub(crate) fn layers(&self, gpu: &Gpu, normals: OcclusionNormals) -> &LayerPipelines {
        self.layers[normals as usize].get_or_init(|| LayerPipelines::new(gpu, HBAO_PLUS, BY_SHARE, normals))
    }

    /// The pipeline of a fullscreen pass.
    pub(crate) fn fullscreen(&self, gpu: &Gpu, pass: FullscreenPass) -> &wgpu::RenderPipeline {
        self.fullscreen[pass.number()].get_or_init(|| self.compile(gpu, pass))
    }

    fn module(&self, gpu: &Gpu, module: Module) -> &wgpu::ShaderModule {
        let (label, text) = match module {
            Module::Sunlight => ("sunlight", SHADOWS),
            Module::AntiAlias => ("antialias", ANTIALIAS),
            Module::Wireframe => ("wireframe", WIREFRAME),
            Module::Lighting => ("lighting", LIGHTING[0]),
            Module::SpecularLighting => ("lighting", LIGHTING[1]),
            Module::DepthPyramid => ("depth pyramid", DEPTH_PYRAMID),
            Module::Reflections => ("reflections", REFLECTIONS[0]),
            Module::SpecularReflections => ("reflections", REFLECTIONS[1]),
            Module::ToneMap => ("tonemap", TONEMAP),
            Module::Enlarge => ("enlarge", ENLARGE),
            Module::Blur => ("occlusion blur", BLUR),
            Module::Upsample => ("occlusion upsampling", UPSAMPLE),
            #[cfg(any(test, feature = "methods"))]
            Module::Ssao => ("ssao", SSAO),
            #[cfg(any(test, feature = "methods"))]
            Module::Hbao => ("hbao", HBAO),
            #[cfg(any(test, feature = "methods"))]
            Module::Alchemy => ("alchemy", ALCHEMY),
            Module::Gtao => ("gtao", GTAO),
            #[cfg(any(test, feature = "methods"))]
            Module::Bitmask => ("bitmask", BITMASK),
        };
        self.modules[module as usize].get_or_init(|| shader(gpu, label, text))
    }

    fn compile(&self, gpu: &Gpu, pass: FullscreenPass) -> wgpu::RenderPipeline {
        let full = |module, entry, target: wgpu::ColorTargetState, constants: &[(&str, f64)]| {
            fullscreen_pipeline(gpu, self.module(gpu, module), entry, target, constants)
        };
        let share = |on: bool| f64::from(u8::from(on));
        // sRGB encoding is done by the target's format if it can, else by the shader; likewise decoding.
        let decode: &[(&str, f64)] = if self.target.is_srgb() { &[("DECODE_SRGB", 1.0)] } else { &[] };
        let encode: &[(&str, f64)] = if self.target.is_srgb() { &[] } else { &[("ENCODE_SRGB", 1.0)] };
        match pass {
            FullscreenPass::Wireframe => {
                let blend = Some(wgpu::BlendState::ALPHA_BLENDING);
                full(
                    Module::Wireframe,
                    "fs_wireframe",
                    wgpu::ColorTargetState { blend, ..RADIANCE.into() },
                    &[],
                )
            }
            FullscreenPass::Occlusion(OcclusionVariant { method, normals, into }) => {
                let mean = wgpu::ColorTargetState { blend: Some(BY_SHARE), ..OCCLUSION_MEAN.into() };
                let (entry, target) = match into {
                    OcclusionOutput::Frame => ("fs_occlusion", OCCLUSION.into()),
                    OcclusionOutput::Half => ("fs_occlusion_half", OCCLUSION.into()),
                    OcclusionOutput::Mean => ("fs_occlusion", mean),
                };
                full(Module::of(method), entry, target, &normals.constants())
            }
            FullscreenPass::Blur => full(Module::Blur, "fs_blur", OCCLUSION.into(), &[]),
            FullscreenPass::Upsample => full(Module::Upsample, "fs_upsample", OCCLUSION.into(), &[]),
            FullscreenPass::Sunlight => full(Module::Sunlight, "fs_sunlight", SUNLIGHT.into(), &[]),
            FullscreenPass::Lighting { occlusion, shadows, specular } => {
                let constants = [("OCCLUSION", share(occlusion)), ("SHADOWS", share(shadows))];
                let module = if specular { Module::SpecularLighting } else { Module::Lighting };
                full(module, "fs_lighting", RADIANCE.into(), &constants)
            }
            FullscreenPass::DepthPyramid => full(Module::DepthPyramid, "fs_pyramid", PYRAMID.into(), &[]),
            FullscreenPass::Reflections { occlusion, by_cells, specular } => {
                let constants = [("OCCLUSION", share(occlusion)), ("HI_Z", share(by_cells))];
                let over = wgpu::ColorTargetState { blend: Some(ADD), ..RADIANCE.into() };
                let module = if specular { Module::SpecularReflections } else { Module::Reflections };
                full(module, "fs_reflections", over, &constants)
            }
            FullscreenPass::Sky => full(Module::Lighting, "fs_sky", RADIANCE.into(), &[]),
            FullscreenPass::ToneMap => full(Module::ToneMap, "fs_tonemap", self.target.into(), encode),
            FullscreenPass::ToneMapTemporal => {
                let constants = [encode, &[("TEMPORAL", 1.0)]].concat();
                full(Module::ToneMap, "fs_tonemap", self.target.into(), &constants)
            }
            FullscreenPass::ToneMapDisplay => {
                let constants = [("ENCODE_SRGB", 1.0), ("AS_IT_IS", 1.0)];
                full(Module::ToneMap, "fs_tonemap", DISPLAY.into(), &constants)
            }
            FullscreenPass::AntiAlias => full(Module::AntiAlias, "fs_antialias", self.target.into(), decode),
            FullscreenPass::AntiAliasSmall => full(Module::AntiAlias, "fs_antialias", DISPLAY.into(), &[]),
            FullscreenPass::Enlarge => full(Module::Enlarge, "fs_enlarge", self.target.into(), decode),
        }
    }
}
