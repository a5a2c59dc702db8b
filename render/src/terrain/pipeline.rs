//! Pipelines of the terrain.

use super::tile_raw::{TILE_ATTRIBUTES, TileRaw};
use crate::gbuffer::{GeometryPass, UNIFORM_BLOCK, shader};
use crate::gpu::Gpu;

const TERRAIN: &str = concat!(
    include_str!("../shaders/common.wgsl"),
    include_str!("../shaders/targets.wgsl"),
    include_str!("../shaders/terrain.wgsl")
);

/// What draws tiles.
#[derive(Debug)]
pub(crate) struct TerrainPipelines {
    /// Group 1: the terrain's uniform block, heights and ground.
    pub(crate) layout: wgpu::BindGroupLayout,
    pub(crate) plain: wgpu::RenderPipeline,
    pub(crate) relief: wgpu::RenderPipeline,
    /// Absent where the device cannot draw triangles as lines.
    pub(crate) wire: Option<wgpu::RenderPipeline>,
    /// Into maps of shadows.
    pub(crate) caster: wgpu::RenderPipeline,
}

impl TerrainPipelines {
    pub(crate) fn new(gpu: &Gpu, frame_layout: &wgpu::BindGroupLayout) -> Self {
        let device = &gpu.device;
        let module = shader(gpu, "terrain", TERRAIN);
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
        let tiles = GeometryPass {
            module: &module,
            layout: &pipeline_layout,
            buffers: &[Some(wgpu::VertexBufferLayout {
                array_stride: size_of::<TileRaw>() as u64,
                step_mode: wgpu::VertexStepMode::Instance,
                attributes: &TILE_ATTRIBUTES,
            })],
        };
        Self {
            plain: tiles.surface(gpu, ["vs_terrain", "fs_terrain"], &[]),
            relief: tiles.surface(gpu, ["vs_terrain", "fs_terrain"], &[("RELIEF", 1.0)]),
            wire: tiles.wire(gpu, ["vs_terrain_wire", "fs_terrain_wire"]),
            caster: tiles.caster(gpu, "vs_terrain_caster"),
            layout,
        }
    }
}
