//! Textures that passes draw into, allocated when a plan first needs them.

use std::collections::BTreeMap;

use crate::frame::graph::Resource;
use crate::resources::descriptors::{DRAWN_AND_SAMPLED, texel_bytes, texture_2d, texture_bytes};
use crate::resources::gpu::{Gpu, RenderError};

/// Depth: reversed, 32-bit floating point.
pub(crate) const DEPTH: wgpu::TextureFormat = wgpu::TextureFormat::Depth32Float;
/// Albedo, linear values stored with sRGB's spacing; metalness in alpha.
pub(crate) const ALBEDO: wgpu::TextureFormat = wgpu::TextureFormat::Rgba8UnormSrgb;
/// World normal, octahedral, in xy; roughness; the material's ambient occlusion.
pub(crate) const NORMAL: wgpu::TextureFormat = wgpu::TextureFormat::Rgba16Float;
/// Specular reflection of dielectrics, and clear coats, as `specular_of` of `brdf.wgsl` reads them.
pub(crate) const SPECULAR: wgpu::TextureFormat = wgpu::TextureFormat::Rg32Uint;
/// Ambient occlusion, 1 = open.
pub(crate) const OCCLUSION: wgpu::TextureFormat = wgpu::TextureFormat::R8Unorm;
/// Accumulated ambient occlusion.
pub(crate) const OCCLUSION_MEAN: wgpu::TextureFormat = wgpu::TextureFormat::R16Float;
/// Share of the sun's light, and the index of its cascade in 255ths (255: none).
pub(crate) const SUNLIGHT: wgpu::TextureFormat = wgpu::TextureFormat::Rg8Unorm;
/// Display values, sRGB-encoded by the shader.
pub(crate) const DISPLAY: wgpu::TextureFormat = wgpu::TextureFormat::Rgba8Unorm;
/// Triangle edges per pixel, in sixteenths.
pub(crate) const EDGES: wgpu::TextureFormat = wgpu::TextureFormat::R8Unorm;
/// Overdraw per pixel: integers up to 2048 are exact.
pub(crate) const OVERDRAW: wgpu::TextureFormat = wgpu::TextureFormat::R16Float;
/// Vector from a surface's position to its previous position, in pixels.
pub(crate) const MOTION: wgpu::TextureFormat = wgpu::TextureFormat::Rg16Float;
/// Coverage of a pixel by strokes of ink.
pub(crate) const STROKES: wgpu::TextureFormat = wgpu::TextureFormat::R8Unorm;
/// Linear radiance.
pub(crate) const RADIANCE: wgpu::TextureFormat = wgpu::TextureFormat::Rgba16Float;

/// Format of a resource, if it is allocated here.
const fn format(resource: Resource) -> Option<wgpu::TextureFormat> {
    Some(match resource {
        Resource::Depth => DEPTH,
        Resource::Normal => NORMAL,
        Resource::Albedo => ALBEDO,
        Resource::Specular => SPECULAR,
        Resource::OcclusionRaw | Resource::OcclusionHalf | Resource::Occlusion => OCCLUSION,
        Resource::OcclusionMean => OCCLUSION_MEAN,
        Resource::Sunlight => SUNLIGHT,
        Resource::Edges => EDGES,
        Resource::Radiance | Resource::Lit => RADIANCE,
        Resource::Display | Resource::Smoothed => DISPLAY,
        Resource::Strokes => STROKES,
        Resource::Overdraw => OVERDRAW,
        Resource::Motion => MOTION,
        Resource::Patches
        | Resource::ShadowMaps
        | Resource::Pyramid
        | Resource::History
        | Resource::Target => return None,
    })
}

/// Size of a resource in pictures of a size.
fn size_of_target(resource: Resource, (width, height): (u32, u32)) -> (u32, u32) {
    match resource {
        Resource::OcclusionHalf => (width.div_ceil(2), height.div_ceil(2)),
        _ => (width, height),
    }
}

/// Memory of a resource in pictures of a size, in bytes; 0 if it is not allocated here.
pub(crate) fn target_bytes(resource: Resource, size: (u32, u32)) -> u64 {
    let (width, height) = size_of_target(resource, size);
    u64::from(width) * u64::from(height) * format(resource).map_or(0, texel_bytes)
}

/// The intermediate pictures of one size.
#[derive(Debug, Default)]
pub(crate) struct Targets {
    size: (u32, u32),
    textures: BTreeMap<Resource, wgpu::Texture>,
}

impl Targets {
    /// Allocates what `resources` lacks; a new size drops the old textures.
    pub(crate) fn ensure(
        &mut self,
        gpu: &Gpu,
        size: (u32, u32),
        resources: &[Resource],
    ) -> Result<(), RenderError> {
        let limit = gpu.device.limits().max_texture_dimension_2d;
        let side = size.0.max(size.1);
        if side > limit || size.0.min(size.1) == 0 {
            return Err(RenderError::TooLarge {
                what: "a picture's side in pixels (at least 1)",
                needed: u64::from(side),
                allowed: u64::from(limit),
            });
        }
        if self.size != size {
            self.textures.clear();
            self.size = size;
        }
        for resource in resources {
            let Some(format) = format(*resource) else { continue };
            let copied = match resource {
                Resource::Lit => wgpu::TextureUsages::COPY_DST,
                _ => wgpu::TextureUsages::empty(),
            };
            let size = size_of_target(*resource, size);
            self.textures.entry(*resource).or_insert_with(|| {
                let usage = DRAWN_AND_SAMPLED | copied;
                gpu.device.create_texture(&texture_2d("frame target", size, format, usage))
            });
        }
        Ok(())
    }

    /// Memory of all, in bytes.
    pub(crate) fn bytes(&self) -> u64 {
        self.textures.values().map(texture_bytes).sum()
    }

    pub(crate) fn texture(&self, resource: Resource) -> Option<&wgpu::Texture> {
        self.textures.get(&resource)
    }

    pub(crate) fn view(&self, resource: Resource) -> Option<wgpu::TextureView> {
        self.texture(resource).map(|t| t.create_view(&Default::default()))
    }
}
