//! Screen-space reflections: settings, the depth pyramid and the uniforms of tracing. The algorithm is in
//! `docs/design/reflections.md`.

use bytemuck::{Pod, Zeroable};

use crate::frame::fullscreen::fullscreen;
use crate::frame::graph::PassId;
use crate::frame::target::Target;
use crate::frame::timing::PassEncoder;
use crate::resources::descriptors::{
    DRAWN_AND_SAMPLED, texel_bytes, texture_2d, texture_bytes, uniform_buffer,
};
use crate::resources::gpu::Gpu;

/// Most steps of a ray.
pub const MAX_REFLECTION_STEPS: u32 = 4096;
/// Assumed thickness of surfaces, as a share of their depth.
pub const REFLECTION_THICKNESS: f32 = 0.02;
/// Levels of the depth pyramid above full resolution.
pub const PYRAMID_LEVELS: u32 = 7;

/// Search for the intersection of a ray. Figures of each are in `docs/benchmarks/reflections.md`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub enum ReflectionMethod {
    /// Linear search, pixel by pixel (after McGuire and Mara, "Efficient GPU screen-space ray tracing", 2014).
    Linear,
    /// Hierarchical search through a pyramid of nearest depths (Uludag, "Hi-Z screen-space cone-traced reflections",
    /// 2014).
    #[default]
    HiZ,
}

impl ReflectionMethod {
    /// All variants.
    pub const ALL: [Self; 2] = [Self::Linear, Self::HiZ];

    /// Name on command lines and in the overlay.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Linear => "linear",
            Self::HiZ => "hi-z",
        }
    }
}

/// Screen-space reflections: a ray for each pixel of a smooth surface, and of water.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Reflections {
    /// Search for the intersection of a ray. Figures of each are in `docs/benchmarks/reflections.md`.
    pub method: ReflectionMethod,
    /// Most steps of a ray, 1 to [`MAX_REFLECTION_STEPS`]; rays that find nothing reflect the sky.
    pub steps: u32,
}

impl Default for Reflections {
    fn default() -> Self {
        Self { method: ReflectionMethod::default(), steps: 100 }
    }
}

/// Mirrors `struct Tracing` of `tracing.wgsl`; keep the two in step.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct TracingUniform {
    steps: u32,
    levels: u32,
    thickness: f32,
    unused: u32,
}

/// Inputs of the tracing passes besides the picture's targets.
#[derive(Debug)]
pub(crate) struct Tracer {
    uniform: wgpu::Buffer,
    /// Levels of the depth pyramid, beginning at half resolution.
    pyramid: Option<wgpu::Texture>,
}

impl Tracer {
    pub(crate) fn new(gpu: &Gpu) -> Self {
        Self { uniform: uniform_buffer::<TracingUniform>(gpu, "tracing"), pyramid: None }
    }

    /// Uploads a frame's settings, and allocates the pyramid if the search needs one.
    pub(crate) fn prepare(&mut self, gpu: &Gpu, reflections: Reflections, size: (u32, u32)) {
        let levels = PYRAMID_LEVELS;
        let steps = reflections.steps.clamp(1, MAX_REFLECTION_STEPS);
        let uniform = TracingUniform { steps, levels, thickness: REFLECTION_THICKNESS, unused: 0 };
        gpu.queue.write_buffer(&self.uniform, 0, bytemuck::bytes_of(&uniform));
        if reflections.method != ReflectionMethod::HiZ {
            self.pyramid = None;
            return;
        }
        let size = pyramid_size(size);
        let descriptor = wgpu::TextureDescriptor {
            mip_level_count: levels,
            ..texture_2d("depth pyramid", size, PYRAMID, DRAWN_AND_SAMPLED)
        };
        if self.pyramid.as_ref().is_none_or(|pyramid| pyramid.size() != descriptor.size) {
            self.pyramid = Some(gpu.device.create_texture(&descriptor));
        }
    }

    /// Memory of the pyramid, in bytes.
    pub(crate) fn bytes(&self) -> u64 {
        self.pyramid.as_ref().map_or(0, texture_bytes)
    }

    /// The whole pyramid, if the search needs one.
    pub(crate) fn pyramid(&self) -> Option<wgpu::TextureView> {
        self.pyramid.as_ref().map(|pyramid| pyramid.create_view(&Default::default()))
    }

    /// The settings, as a binding.
    pub(crate) fn binding(&self) -> wgpu::BindingResource<'_> {
        self.uniform.as_entire_binding()
    }

    /// Builds the pyramid from the depth buffer, level by level.
    pub(crate) fn build(
        &self,
        gpu: &Gpu,
        encoder: &mut PassEncoder<'_>,
        pipeline: &wgpu::RenderPipeline,
        depth: &wgpu::TextureView,
    ) {
        let Some(pyramid) = &self.pyramid else { return };
        let level = |base_mip_level| {
            let one = wgpu::TextureViewDescriptor {
                base_mip_level,
                mip_level_count: Some(1),
                ..Default::default()
            };
            pyramid.create_view(&one)
        };
        let mut finer = depth.clone();
        for number in 0..pyramid.mip_level_count() {
            let group = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some("depth pyramid"),
                layout: &pipeline.get_bind_group_layout(0),
                entries: &[wgpu::BindGroupEntry {
                    binding: 1,
                    resource: wgpu::BindingResource::TextureView(&finer),
                }],
            });
            let into = level(number);
            fullscreen(encoder, PassId::DepthPyramid, pipeline, &group, &Target::colour(&into, (0, 0)));
            finer = into;
        }
    }
}

/// Size of the pyramid's first level: rounded up to whole cells of the last one, so that downsampling covers every pixel.
fn pyramid_size((width, height): (u32, u32)) -> (u32, u32) {
    let side = |side: u32| side.next_multiple_of(1 << PYRAMID_LEVELS) / 2;
    (side(width), side(height))
}

/// Memory of the pyramid for a picture of a size, in bytes.
pub(crate) fn pyramid_bytes(size: (u32, u32)) -> u64 {
    let (width, height) = pyramid_size(size);
    let texels = |level: u32| u64::from(width >> level) * u64::from(height >> level);
    (0..PYRAMID_LEVELS).map(texels).sum::<u64>() * texel_bytes(PYRAMID)
}

/// Format of the pyramid's depths.
pub(crate) const PYRAMID: wgpu::TextureFormat = wgpu::TextureFormat::R32Float;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn methods_have_names_of_their_own_and_are_numbered_in_their_order() {
        assert_ne!(ReflectionMethod::Linear.name(), ReflectionMethod::HiZ.name());
        assert!(ReflectionMethod::ALL.is_sorted());
    }
}
