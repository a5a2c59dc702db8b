//! Bloom over the lit picture. Its weights are explained in `docs/design/reflections.md`.

use crate::frame::fullscreen::{self, blended};
use crate::frame::graph::PassId;
use crate::frame::target::{Load, Target};
use crate::frame::targets::RADIANCE;
use crate::frame::timing::PassEncoder;
use crate::passes::gbuffer::shader;
use crate::resources::descriptors::{texel_bytes, texture_2d, texture_bytes, wgsl};
use crate::resources::gpu::Gpu;

const BLOOM: &str = wgsl!("bloom");

/// Most downsampling levels: the widest tent filter spans three times 64 pixels.
pub(crate) const MAX_LEVELS: u32 = 6;

/// Settings of bloom.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bloom {
    /// Share of a pixel's light that comes from its surroundings, 0 to 1.
    pub strength: f32,
}

impl Default for Bloom {
    fn default() -> Self {
        Self { strength: 0.04 }
    }
}

impl Bloom {
    /// The strength clamped to its range; `None` for 0 and NaN.
    pub(crate) fn share(self) -> Option<f64> {
        Some(f64::from(self.strength.clamp(0.0, 1.0))).filter(|share| *share > 0.0)
    }
}

/// Number of downsampling levels: until a side has one pixel.
pub(crate) fn levels((width, height): (u32, u32)) -> u32 {
    width.min(height).max(1).ilog2().min(MAX_LEVELS)
}

/// Size of a level.
fn level_size((width, height): (u32, u32), level: u32) -> (u32, u32) {
    ((width >> level).max(1), (height >> level).max(1))
}

/// Memory of the levels for a picture of a size, in bytes.
pub(crate) fn level_bytes(size: (u32, u32)) -> u64 {
    let texels = |level| {
        let (width, height) = level_size(size, level);
        u64::from(width) * u64::from(height)
    };
    (1..=levels(size)).map(texels).sum::<u64>() * texel_bytes(RADIANCE)
}

/// Pipelines of the pass.
#[derive(Debug)]
pub(crate) struct BloomPipelines {
    halved: wgpu::RenderPipeline,
    /// Blends with the target by the blend constant.
    tent: wgpu::RenderPipeline,
    sampler: wgpu::Sampler,
}

impl BloomPipelines {
    pub(crate) fn new(gpu: &Gpu) -> Self {
        let module = shader(gpu, "bloom", BLOOM);
        let over = wgpu::BlendComponent {
            src_factor: wgpu::BlendFactor::Constant,
            dst_factor: wgpu::BlendFactor::OneMinusConstant,
            operation: wgpu::BlendOperation::Add,
        };
        let pipeline = |entry, blend| {
            let target = wgpu::ColorTargetState { blend, ..RADIANCE.into() };
            fullscreen::pipeline(gpu, &module, ["vs_bloom", entry], (target, None), &[])
        };
        Self {
            halved: pipeline("fs_halved", None),
            tent: pipeline("fs_tent", Some(wgpu::BlendState { color: over, alpha: KEEP })),
            sampler: gpu.device.create_sampler(&wgpu::SamplerDescriptor {
                label: Some("bloom"),
                mag_filter: wgpu::FilterMode::Linear,
                min_filter: wgpu::FilterMode::Linear,
                ..Default::default()
            }),
        }
    }
}

/// Keeps alpha, which marks surfaces in the lit picture.
const KEEP: wgpu::BlendComponent = wgpu::BlendComponent {
    src_factor: wgpu::BlendFactor::Zero,
    dst_factor: wgpu::BlendFactor::One,
    operation: wgpu::BlendOperation::Add,
};

/// The downsampled pictures.
#[derive(Debug, Default)]
pub(crate) struct BloomPass {
    size: (u32, u32),
    levels: Vec<wgpu::TextureView>,
}

impl BloomPass {
    /// Allocates the levels for a picture of this size.
    pub(crate) fn prepare(&mut self, gpu: &Gpu, size: (u32, u32)) {
        if self.size == size {
            return;
        }
        self.size = size;
        let one = |level| {
            let size = level_size(size, level);
            let usage = wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::TEXTURE_BINDING;
            let texture = gpu.device.create_texture(&texture_2d("bloom", size, RADIANCE, usage));
            texture.create_view(&Default::default())
        };
        self.levels = (1..=levels(size)).map(one).collect();
    }

    /// Memory of the levels, in bytes.
    pub(crate) fn bytes(&self) -> u64 {
        self.levels.iter().map(|level| texture_bytes(level.texture())).sum()
    }

    /// Downsamples the picture, upsamples it level by level and blends the result over it.
    pub(crate) fn draw(
        &self,
        gpu: &Gpu,
        encoder: &mut PassEncoder<'_>,
        pipelines: &BloomPipelines,
        picture: &wgpu::TextureView,
        share: f64,
    ) {
        let mut step = |pipeline: &wgpu::RenderPipeline,
                        from: &wgpu::TextureView,
                        into: &wgpu::TextureView,
                        share| {
            let group = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some("bloom"),
                layout: &pipeline.get_bind_group_layout(0),
                entries: &[
                    wgpu::BindGroupEntry { binding: 1, resource: wgpu::BindingResource::TextureView(from) },
                    wgpu::BindGroupEntry {
                        binding: 2,
                        resource: wgpu::BindingResource::Sampler(&pipelines.sampler),
                    },
                ],
            });
            let target = Target { load: Load::Keep, ..Target::colour(into, (0, 0)) };
            blended(encoder, PassId::Bloom, pipeline, &group, &target, share);
        };
        let mut finer = picture;
        for level in &self.levels {
            step(&pipelines.halved, finer, level, 1.0);
            finer = level;
        }
        // All levels have equal weight.
        for (number, pair) in self.levels.windows(2).enumerate().rev() {
            let larger = self.levels.len() - 1 - number;
            step(&pipelines.tent, &pair[1], &pair[0], larger as f64 / (larger + 1) as f64);
        }
        if let Some(first) = self.levels.first() {
            step(&pipelines.tent, first, picture, share);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn small_pictures_are_halved_less_often() {
        assert_eq!([(1, 1), (1, 900), (2, 2), (3, 7), (64, 64), (1280, 720)].map(levels), [0, 0, 1, 1, 6, 6]);
    }

    #[test]
    fn a_strength_that_is_none_is_no_bloom() {
        let share = |strength| Bloom { strength }.share();
        assert_eq!([share(0.0), share(-1.0), share(f32::NAN)], [None; 3]);
        assert_eq!((share(0.5), share(7.0)), (Some(0.5), Some(1.0)));
    }
}
