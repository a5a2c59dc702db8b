//! Pipelines of the terrain.

use super::list::{TILE_ATTRIBUTES, TileRaw};
use crate::render::gpu::Gpu;
use crate::render::targets::{ALBEDO, DEPTH, NORMAL, RADIANCE};

const TERRAIN: &str =
    concat!(include_str!("../shaders/common.wgsl"), include_str!("../shaders/terrain.wgsl"));

/// What draws tiles.
#[derive(Debug)]
pub(crate) struct TerrainPipelines {
    /// Group 1: the terrain's uniform block, heights and ground.
    pub(crate) layout: wgpu::BindGroupLayout,
    pub(crate) plain: wgpu::RenderPipeline,
    pub(crate) relief: wgpu::RenderPipeline,
    /// Absent where the device cannot draw triangles as lines.
    pub(crate) wire: Option<wgpu::RenderPipeline>,
}

impl TerrainPipelines {
    pub(crate) fn new(gpu: &Gpu, frame_layout: &wgpu::BindGroupLayout) -> Self {
        let device = &gpu.device;
        let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: Some("terrain"),
            source: wgpu::ShaderSource::Wgsl(TERRAIN.into()),
        });
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
                entry(
                    0,
                    wgpu::ShaderStages::VERTEX_FRAGMENT,
                    wgpu::BindingType::Buffer {
                        ty: wgpu::BufferBindingType::Uniform,
                        has_dynamic_offset: false,
                        min_binding_size: None,
                    },
                ),
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
            ],
        });
        let pipeline_layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some("terrain"),
            bind_group_layouts: &[Some(frame_layout), Some(&layout)],
            immediate_size: 0,
        });
        let pipeline = |entry: [&str; 2],
                        targets: &[Option<wgpu::ColorTargetState>],
                        relief: bool,
                        wire: bool| {
            let constants: &[(&str, f64)] = if relief { &[("RELIEF", 1.0)] } else { &[] };
            device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
                label: Some(entry[1]),
                layout: Some(&pipeline_layout),
                vertex: wgpu::VertexState {
                    module: &module,
                    entry_point: Some(entry[0]),
                    compilation_options: Default::default(),
                    buffers: &[Some(wgpu::VertexBufferLayout {
                        array_stride: size_of::<TileRaw>() as u64,
                        step_mode: wgpu::VertexStepMode::Instance,
                        attributes: &TILE_ATTRIBUTES,
                    })],
                },
                primitive: wgpu::PrimitiveState {
                    cull_mode: None,
                    polygon_mode: if wire { wgpu::PolygonMode::Line } else { wgpu::PolygonMode::Fill },
                    ..Default::default()
                },
                depth_stencil: Some(wgpu::DepthStencilState {
                    format: DEPTH,
                    depth_write_enabled: Some(!wire),
                    depth_compare: Some(wgpu::CompareFunction::Greater),
                    stencil: Default::default(),
                    bias: Default::default(),
                }),
                multisample: Default::default(),
                fragment: Some(wgpu::FragmentState {
                    module: &module,
                    entry_point: Some(entry[1]),
                    compilation_options: wgpu::PipelineCompilationOptions { constants, ..Default::default() },
                    targets,
                }),
                multiview_mask: None,
                cache: None,
            })
        };
        let surfaces = [Some(NORMAL.into()), Some(ALBEDO.into())];
        let lines = gpu.device.features().contains(wgpu::Features::POLYGON_MODE_LINE);
        let edges = [Some(RADIANCE.into())];
        Self {
            plain: pipeline(["vs_terrain", "fs_terrain"], &surfaces, false, false),
            relief: pipeline(["vs_terrain", "fs_terrain"], &surfaces, true, false),
            wire: lines.then(|| pipeline(["vs_terrain_wire", "fs_terrain_wire"], &edges, false, true)),
            layout,
        }
    }
}
