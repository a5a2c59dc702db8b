//! Pipelines of the terrain.

use std::sync::OnceLock;

use super::tile_raw::{TILE_ATTRIBUTES, TileRaw};
use crate::frame::graph::PassId;
use crate::passes::gbuffer::{GeometryPass, UNIFORM_BLOCK, shader};
use crate::resources::gpu::Gpu;

const TERRAIN: &str = concat!(
    include_str!("../../shaders/common.wgsl"),
    include_str!("../../shaders/targets.wgsl"),
    include_str!("../../shaders/anisotropic.wgsl"),
    include_str!("../../shaders/ground.wgsl"),
    include_str!("../../shaders/terrain.wgsl")
);

/// Pipelines of tiles, compiled on first use or ahead of it.
#[derive(Debug)]
pub(crate) struct TerrainPipelines {
    /// Group 1: the terrain's uniform block, heights and ground.
    pub(crate) layout: wgpu::BindGroupLayout,
    /// Groups of frame and terrain.
    pipeline_layout: wgpu::PipelineLayout,
    module: OnceLock<wgpu::ShaderModule>,
    /// Without relief and with.
    surfaces: [OnceLock<wgpu::RenderPipeline>; 2],
    /// `None` where the device cannot draw triangles as lines.
    wire: OnceLock<Option<wgpu::RenderPipeline>>,
    overdraw: OnceLock<wgpu::RenderPipeline>,
    caster: OnceLock<wgpu::RenderPipeline>,
}

impl TerrainPipelines {
    pub(crate) fn new(gpu: &Gpu, frame_layout: &wgpu::BindGroupLayout) -> Self {
        let device = &gpu.device;
        let entry =
            |binding, visibility, ty| wgpu::BindGroupLayoutEntry { binding, visibility, ty, count: None };
        let texture = |sample_type, view_dimension| wgpu::BindingType::Texture {
            sample_type,
            view_dimension,
            multisampled: false,
        };
        let layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("terrain"),
            entries: &[
                UNIFORM_BLOCK,
                entry(
                    1,
                    wgpu::ShaderStages::VERTEX,
                    texture(wgpu::TextureSampleType::Sint, wgpu::TextureViewDimension::D2),
                ),
                entry(
                    2,
                    wgpu::ShaderStages::FRAGMENT,
                    texture(
                        wgpu::TextureSampleType::Float { filterable: true },
                        wgpu::TextureViewDimension::D2Array,
                    ),
                ),
                entry(
                    3,
                    wgpu::ShaderStages::FRAGMENT,
                    wgpu::BindingType::Sampler(wgpu::SamplerBindingType::Filtering),
                ),
                wgpu::BindGroupLayoutEntry { binding: 4, ..UNIFORM_BLOCK },
                entry(
                    5,
                    wgpu::ShaderStages::FRAGMENT,
                    texture(
                        wgpu::TextureSampleType::Float { filterable: true },
                        wgpu::TextureViewDimension::D2,
                    ),
                ),
            ],
        });
        let pipeline_layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some("terrain"),
            bind_group_layouts: &[Some(frame_layout), Some(&layout)],
            immediate_size: 0,
        });
        Self {
            layout,
            pipeline_layout,
            module: OnceLock::new(),
            surfaces: Default::default(),
            wire: OnceLock::new(),
            overdraw: OnceLock::new(),
            caster: OnceLock::new(),
        }
    }

    /// Into the G-buffer, with relief or without.
    pub(crate) fn surface(&self, gpu: &Gpu, relief: bool) -> &wgpu::RenderPipeline {
        self.surfaces[usize::from(relief)].get_or_init(|| {
            let constants: &[(&str, f64)] = if relief { &[("RELIEF", 1.0)] } else { &[] };
            self.with_tiles(gpu, |tiles| tiles.surface(gpu, ["vs_terrain", "fs_terrain"], constants))
        })
    }

    /// Into shadow maps.
    pub(crate) fn caster(&self, gpu: &Gpu) -> &wgpu::RenderPipeline {
        self.caster.get_or_init(|| self.with_tiles(gpu, |tiles| tiles.caster(gpu, "vs_terrain_caster")))
    }

    /// Wireframe; `None` where the device cannot draw triangles as lines.
    pub(crate) fn wire(&self, gpu: &Gpu) -> Option<&wgpu::RenderPipeline> {
        let make = || self.with_tiles(gpu, |tiles| tiles.wire(gpu, ["vs_terrain_wire", "fs_terrain_wire"]));
        self.wire.get_or_init(make).as_ref()
    }

    /// Overdraw counter.
    fn overdraw(&self, gpu: &Gpu) -> &wgpu::RenderPipeline {
        self.overdraw.get_or_init(|| self.with_tiles(gpu, |tiles| tiles.overdraw(gpu, "vs_terrain_caster")))
    }

    /// The pipeline of tiles in a pass, if they are drawn there.
    pub(crate) fn of(&self, gpu: &Gpu, pass: PassId, relief: bool) -> Option<&wgpu::RenderPipeline> {
        match pass {
            PassId::GBuffer => Some(self.surface(gpu, relief)),
            PassId::Edges => self.wire(gpu),
            PassId::Overdraw => Some(self.overdraw(gpu)),
            _ => None,
        }
    }

    /// Shader, bindings and vertices of tiles.
    fn with_tiles<R>(&self, gpu: &Gpu, make: impl FnOnce(&GeometryPass<'_>) -> R) -> R {
        make(&GeometryPass {
            module: self.module.get_or_init(|| shader(gpu, "terrain", TERRAIN)),
            layout: &self.pipeline_layout,
            buffers: &[Some(wgpu::VertexBufferLayout {
                array_stride: size_of::<TileRaw>() as u64,
                step_mode: wgpu::VertexStepMode::Instance,
                attributes: &TILE_ATTRIBUTES,
            })],
        })
    }
}
