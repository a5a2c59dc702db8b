//! Punctual light pass: tiled light culling and deferred lighting.

use std::sync::OnceLock;

use super::list::{PunctualLightList, PunctualLightRaw, PunctualLightsUniform};
use crate::frame::fullscreen::fullscreen_pipeline;
use crate::frame::targets::RADIANCE;
use crate::passes::gbuffer::{ADD, shader};
use crate::resources::buffer::GrowingBuffer;
use crate::resources::descriptors::wgsl;
use crate::resources::gpu::{Gpu, RenderError};

const CULL: &str = wgsl!("common", "punctual_light", "cull_lights");

macro_rules! light {
    ($specular:literal) => {
        wgsl!(
            "common",
            "fullscreen",
            "targets",
            "sky",
            "brdf",
            $specular,
            "punctual_light",
            "lights",
            "punctual_light_pass"
        )
    };
}

const LIGHT: &str = light!("usual_specular");
/// With materials that set the specular reflection of dielectrics.
const SPECULAR_LIGHT: &str = light!("specular");

/// Binding of the light list.
const LIST: u32 = 7;

/// The punctual light pass.
#[derive(Debug)]
pub(crate) struct PunctualLightPass {
    uniform: wgpu::Buffer,
    punctual_lights: GrowingBuffer<PunctualLightRaw>,
    masks: GrowingBuffer<u32>,
    bins: GrowingBuffer<u32>,
    /// Number of tiles across and down.
    tiles: [u32; 2],
    cull: OnceLock<wgpu::ComputePipeline>,
    light: OnceLock<[wgpu::RenderPipeline; 2]>,
    specular_light: OnceLock<wgpu::RenderPipeline>,
}

impl PunctualLightPass {
    /// Bindings in group 0 for forward-lit surfaces: uniform block, lights, and the masks of tiles and depth bins.
    pub(crate) const LAYOUT: [(u32, wgpu::BufferBindingType); 4] = {
        let list = wgpu::BufferBindingType::Storage { read_only: true };
        [(6, wgpu::BufferBindingType::Uniform), (LIST, list), (8, list), (9, list)]
    };

    pub(crate) fn new(gpu: &Gpu) -> Self {
        let storage = wgpu::BufferUsages::STORAGE;
        Self {
            uniform: gpu.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("punctual_lights"),
                size: size_of::<PunctualLightsUniform>() as u64,
                usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
                mapped_at_creation: false,
            }),
            punctual_lights: GrowingBuffer::new("punctual_lights", storage),
            masks: GrowingBuffer::new("punctual lights of tiles", storage),
            bins: GrowingBuffer::new("punctual lights of depths", storage),
            tiles: [0; 2],
            cull: OnceLock::new(),
            light: OnceLock::new(),
            specular_light: OnceLock::new(),
        }
    }

    /// Whether the device supports light culling.
    pub(crate) fn is_possible(gpu: &Gpu) -> bool {
        let limits = gpu.device.limits();
        limits.max_compute_invocations_per_workgroup >= 64 && limits.max_storage_buffers_per_shader_stage >= 3
    }

    /// Uploads a frame's punctual lights.
    pub(crate) fn prepare(&mut self, gpu: &Gpu, list: &PunctualLightList) -> Result<(), RenderError> {
        self.tiles = list.tiles;
        gpu.queue.write_buffer(&self.uniform, 0, bytemuck::bytes_of(&list.uniform));
        self.punctual_lights.write(gpu, 0, &list.punctual_lights)?;
        self.bins.write(gpu, 0, &list.bins)?;
        let words = list.tiles[0] as usize * list.tiles[1] as usize * list.uniform.words as usize;
        if self.masks.len() < words as u64 {
            // Its content is written before it is read.
            self.masks.write(gpu, 0, &vec![0; words])?;
        }
        Ok(())
    }

    /// Culls lights by tiles of the depth buffer.
    pub(crate) fn cull(
        &self,
        gpu: &Gpu,
        pass: &mut wgpu::ComputePass<'_>,
        frame: &wgpu::Buffer,
        depth: &wgpu::TextureView,
    ) {
        let pipeline = self.cull.get_or_init(|| {
            let module = shader(gpu, "punctual_lights", CULL);
            gpu.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
                label: Some("punctual_lights"),
                layout: None,
                module: &module,
                entry_point: Some("cs_cull"),
                compilation_options: Default::default(),
                cache: None,
            })
        });
        let Some([uniform, punctual_lights, masks, _]) = self.bindings() else { return };
        let group = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("punctual_lights"),
            layout: &pipeline.get_bind_group_layout(0),
            entries: &[
                wgpu::BindGroupEntry { binding: 0, resource: frame.as_entire_binding() },
                wgpu::BindGroupEntry { binding: 1, resource: wgpu::BindingResource::TextureView(depth) },
                uniform,
                punctual_lights,
                masks,
            ],
        });
        pass.set_pipeline(pipeline);
        pass.set_bind_group(0, &group, &[]);
        pass.dispatch_workgroups(self.tiles[0], self.tiles[1], 1);
    }

    /// Adds the lights to the picture, or shows their number per pixel. `surfaces` are depth, normal and albedo, and the
    /// specular reflection of dielectrics if a material sets it.
    pub(crate) fn light(
        &self,
        gpu: &Gpu,
        pass: &mut wgpu::RenderPass<'_>,
        frame: &wgpu::Buffer,
        (surfaces, specular): (&[wgpu::TextureView; 3], Option<&wgpu::TextureView>),
        counted: bool,
    ) {
        let compile = |module: &_, entry, blend| {
            let target = wgpu::ColorTargetState { blend, ..RADIANCE.into() };
            fullscreen_pipeline(gpu, module, entry, target, &[])
        };
        let specular = specular.filter(|_| !counted);
        let pipeline = match specular {
            Some(_) => self.specular_light.get_or_init(|| {
                let module = shader(gpu, "punctual_lights", SPECULAR_LIGHT);
                compile(&module, "fs_punctual_lights", Some(ADD))
            }),
            None => {
                let pipelines = self.light.get_or_init(|| {
                    let module = shader(gpu, "punctual_lights", LIGHT);
                    [("fs_punctual_lights", Some(ADD)), ("fs_punctual_lights_left", None)]
                        .map(|(entry, blend)| compile(&module, entry, blend))
                });
                &pipelines[usize::from(counted)]
            }
        };
        let Some(punctual_lights) = self.bindings() else { return };
        let read = if counted { 1 } else { 3 };
        let textures = surfaces.iter().zip(1..).take(read).map(|(view, binding)| wgpu::BindGroupEntry {
            binding,
            resource: wgpu::BindingResource::TextureView(view),
        });
        // Counting reads no light.
        let punctual_lights = punctual_lights.into_iter().filter(|entry| !counted || entry.binding != LIST);
        let specular = specular.map(|view| wgpu::BindGroupEntry {
            binding: 14,
            resource: wgpu::BindingResource::TextureView(view),
        });
        let frame = wgpu::BindGroupEntry { binding: 0, resource: frame.as_entire_binding() };
        let group = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("punctual_lights"),
            layout: &pipeline.get_bind_group_layout(0),
            entries: &std::iter::once(frame)
                .chain(textures)
                .chain(specular)
                .chain(punctual_lights)
                .collect::<Vec<_>>(),
        });
        pass.set_pipeline(pipeline);
        pass.set_bind_group(0, &group, &[]);
        pass.draw(0..3, 0..1);
    }

    /// Bindings 6 to 9: [`PunctualLightPass::LAYOUT`]; `None` before there was a light.
    pub(crate) fn bindings(&self) -> Option<[wgpu::BindGroupEntry<'_>; 4]> {
        let buffers =
            [Some(&self.uniform), self.punctual_lights.buffer(), self.masks.buffer(), self.bins.buffer()];
        let [Some(uniform), Some(punctual_lights), Some(masks), Some(bins)] = buffers else { return None };
        let mut binding = 5;
        Some([uniform, punctual_lights, masks, bins].map(|buffer| {
            binding += 1;
            wgpu::BindGroupEntry { binding, resource: buffer.as_entire_binding() }
        }))
    }
}
