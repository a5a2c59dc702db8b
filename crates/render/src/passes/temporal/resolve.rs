//! The resolve pass: blends a frame into the history.

use crate::frame::fullscreen::{fullscreen, fullscreen_pipeline};
use crate::frame::graph::PassId;
use crate::frame::target::Target;
use crate::frame::targets::RADIANCE;
use crate::frame::timing::PassEncoder;
use crate::passes::gbuffer::shader;
use crate::resources::descriptors::{DRAWN_AND_SAMPLED, texture_2d, wgsl};
use crate::resources::gpu::Gpu;

const TEMPORAL: &str = wgsl!("common", "fullscreen", "motion", "temporal");

/// The resolve pass.
#[derive(Debug)]
pub(crate) struct Resolve {
    /// Without and with moving objects.
    pipelines: [wgpu::RenderPipeline; 2],
    sampler: wgpu::Sampler,
}

impl Resolve {
    pub(crate) fn new(gpu: &Gpu) -> Self {
        let module = shader(gpu, "temporal", TEMPORAL);
        Self {
            pipelines: [0.0, 1.0].map(|motion| {
                fullscreen_pipeline(gpu, &module, "fs_temporal", RADIANCE.into(), &[("MOTION", motion)])
            }),
            sampler: gpu.device.create_sampler(&wgpu::SamplerDescriptor {
                label: Some("history"),
                mag_filter: wgpu::FilterMode::Linear,
                min_filter: wgpu::FilterMode::Linear,
                ..Default::default()
            }),
        }
    }

    /// A texture for weighted colours and their number of frames.
    pub(crate) fn history(&self, gpu: &Gpu, size: (u32, u32)) -> wgpu::Texture {
        gpu.device.create_texture(&texture_2d("history", size, RADIANCE, DRAWN_AND_SAMPLED))
    }

    /// Writes a new history from the old one and a frame: radiance, depth and, if objects move, motion.
    pub(crate) fn record(
        &self,
        gpu: &Gpu,
        encoder: &mut PassEncoder<'_>,
        frame: &wgpu::Buffer,
        (radiance, depth, motion): (&wgpu::TextureView, &wgpu::TextureView, Option<&wgpu::TextureView>),
        [old, new]: [&wgpu::Texture; 2],
    ) {
        let pipeline = &self.pipelines[usize::from(motion.is_some())];
        let [old, new] = [old, new].map(|texture| texture.create_view(&Default::default()));
        let view = |binding, view| wgpu::BindGroupEntry {
            binding,
            resource: wgpu::BindingResource::TextureView(view),
        };
        let group = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("temporal"),
            layout: &pipeline.get_bind_group_layout(0),
            entries: &[
                wgpu::BindGroupEntry { binding: 0, resource: frame.as_entire_binding() },
                view(1, radiance),
                view(2, depth),
                // Not read without motion, but the binding must be filled.
                view(3, motion.unwrap_or(radiance)),
                view(4, &old),
                wgpu::BindGroupEntry { binding: 5, resource: wgpu::BindingResource::Sampler(&self.sampler) },
            ],
        });
        fullscreen(encoder, PassId::Temporal, pipeline, &group, &Target::colour(&new, (0, 0)));
    }
}
