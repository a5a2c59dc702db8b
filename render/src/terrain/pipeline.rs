//! Pipelines of the terrain.

use std::sync::OnceLock;

use super::tile_raw::{TILE_ATTRIBUTES, TileRaw};
use crate::gbuffer::{GeometryPass, UNIFORM_BLOCK, shader};
use crate::gpu::Gpu;
use crate::graph::PassId;

const TERRAIN: &str = concat!(
    include_str!("../shaders/common.wgsl"),
    include_str!("../shaders/targets.wgsl"),
    include_str!("../shaders/anisotropic.wgsl"),
    include_str!("../shaders/ground.wgsl"),
    include_str!("../shaders/terrain.wgsl")
);

/// What draws tiles.
#[derive(Debug)]
pub(crate) struct TerrainPipelines {
    /// Group 1: the terrain's uniform block, heights and ground.
    pub(crate) layout: wgpu::BindGroupLayout,
    plain: wgpu::RenderPipeline,
    relief: wgpu::RenderPipeline,
    /// Absent where the device cannot draw triangles as lines.
    wire: Option<wgpu::RenderPipeline>,
    /// Made when it is first asked for.
    overdraw: OnceLock<wgpu::RenderPipeline>,
    /// Into maps of shadows.
    pub(crate) caster: wgpu::RenderPipeline,
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
        with_tiles(gpu, frame_layout, &layout, |tiles| Self {
            plain: tiles.surface(gpu, ["vs_terrain", "fs_terrain"], &[]),
            relief: tiles.surface(gpu, ["vs_terrain", "fs_terrain"], &[("RELIEF", 1.0)]),
            wire: tiles.wire(gpu, ["vs_terrain_wire", "fs_terrain_wire"]),
            caster: tiles.caster(gpu, "vs_terrain_caster"),
            overdraw: OnceLock::new(),
            layout: layout.clone(),
        })
    }

    /// Makes what counts how often pixels are drawn, once.
    pub(crate) fn prepare_overdraw(&self, gpu: &Gpu, frame_layout: &wgpu::BindGroupLayout) {
        self.overdraw.get_or_init(|| {
            with_tiles(gpu, frame_layout, &self.layout, |tiles| tiles.overdraw(gpu, "vs_terrain_caster"))
        });
    }

    /// What draws tiles in a pass, if they are drawn there.
    pub(crate) fn of(&self, pass: PassId, relief: bool) -> Option<&wgpu::RenderPipeline> {
        match pass {
            PassId::GBuffer => Some(if relief { &self.relief } else { &self.plain }),
            PassId::Edges => self.wire.as_ref(),
            PassId::Overdraw => self.overdraw.get(),
            _ => None,
        }
    }
}

/// Shader, bindings and vertices of tiles.
fn with_tiles<R>(
    gpu: &Gpu,
    frame_layout: &wgpu::BindGroupLayout,
    layout: &wgpu::BindGroupLayout,
    make: impl FnOnce(&GeometryPass<'_>) -> R,
) -> R {
    let layout = gpu.device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        label: Some("terrain"),
        bind_group_layouts: &[Some(frame_layout), Some(layout)],
        immediate_size: 0,
    });
    make(&GeometryPass {
        module: &shader(gpu, "terrain", TERRAIN),
        layout: &layout,
        buffers: &[Some(wgpu::VertexBufferLayout {
            array_stride: size_of::<TileRaw>() as u64,
            step_mode: wgpu::VertexStepMode::Instance,
            attributes: &TILE_ATTRIBUTES,
        })],
    })
}
