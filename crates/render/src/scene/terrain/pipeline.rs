//! Pipelines of the terrain.

use std::sync::OnceLock;

use super::tile_raw::{TILE_ATTRIBUTES, TileRaw};
use crate::frame::graph::PassId;
use crate::passes::gbuffer::{GeometryPass, UNIFORM_BLOCK, shader};
use crate::resources::descriptors::{group_layout, layout_entry, pipeline_layout, texture_binding, wgsl};
use crate::resources::gpu::Gpu;

const TERRAIN: &str = wgsl!("common", "targets", "anisotropic", "ground", "terrain");

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
        let heights = wgpu::BindingType::Texture {
            sample_type: wgpu::TextureSampleType::Sint,
            view_dimension: wgpu::TextureViewDimension::D2,
            multisampled: false,
        };
        let sampler = wgpu::BindingType::Sampler(wgpu::SamplerBindingType::Filtering);
        let [layers, slopes] = [wgpu::TextureViewDimension::D2Array, wgpu::TextureViewDimension::D2]
            .map(|dimension| texture_binding(true, dimension));
        let fragment = wgpu::ShaderStages::FRAGMENT;
        let entries = [
            UNIFORM_BLOCK,
            layout_entry(1, wgpu::ShaderStages::VERTEX, heights),
            layout_entry(2, fragment, layers),
            layout_entry(3, fragment, sampler),
            wgpu::BindGroupLayoutEntry { binding: 4, ..UNIFORM_BLOCK },
            layout_entry(5, fragment, slopes),
        ];
        let layout = group_layout(gpu, "terrain", &entries);
        let pipeline_layout = pipeline_layout(gpu, "terrain", &[Some(frame_layout), Some(&layout)]);
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
            vertex_constants: &[],
            buffers: &[Some(wgpu::VertexBufferLayout {
                array_stride: size_of::<TileRaw>() as u64,
                step_mode: wgpu::VertexStepMode::Instance,
                attributes: &TILE_ATTRIBUTES,
            })],
        })
    }
}
