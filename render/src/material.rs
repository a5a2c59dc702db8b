//! Materials and what the shaders see of them.

use bytemuck::{Pod, Zeroable};
use lodestream_protocol::asset as protocol;
use wgpu::util::DeviceExt;

use super::gpu::Gpu;
use super::texture::{StreamedTexture, TextureKind, TextureShape};

/// How a surface looks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Material {
    /// Diffuse colour, linear; multiplied with the colour texture.
    pub base_colour: [f32; 3],
    /// 0 = mirror-like highlights, 1 = matt.
    pub roughness: f32,
    /// Depth of the height map below the surface, in units of texture coordinates (0.05 = a
    /// twentieth of the texture's width); 0 = no relief.
    pub relief_depth: f32,
    /// Index into the asset's textures.
    pub colour_texture: Option<usize>,
    /// Index into the asset's textures.
    pub height_texture: Option<usize>,
}

impl Default for Material {
    fn default() -> Self {
        Self {
            base_colour: [0.7; 3],
            roughness: 0.8,
            relief_depth: 0.0,
            colour_texture: None,
            height_texture: None,
        }
    }
}

impl From<&protocol::Material> for Material {
    fn from(m: &protocol::Material) -> Self {
        Self {
            base_colour: [m.base_color[0], m.base_color[1], m.base_color[2]],
            roughness: m.roughness,
            relief_depth: m.relief_depth,
            colour_texture: m.base_color_texture.map(usize::from),
            height_texture: m.height_texture.map(usize::from),
        }
    }
}

/// Linear light of an sRGB byte (IEC 61966-2-1).
fn from_srgb(encoded: u8) -> f32 {
    let encoded = f32::from(encoded) / 255.0;
    if encoded <= 0.04045 { encoded / 12.92 } else { ((encoded + 0.055) / 1.055).powf(2.4) }
}

impl From<&protocol::TextureInfo> for TextureShape {
    fn from(t: &protocol::TextureInfo) -> Self {
        let kind = match t.kind {
            protocol::TextureKind::Color => TextureKind::Colour,
            protocol::TextureKind::Height => TextureKind::Height,
            protocol::TextureKind::Normal => TextureKind::Normal,
            protocol::TextureKind::Surface => TextureKind::Surface,
        };
        let decode = |encoded| match kind {
            TextureKind::Colour => from_srgb(encoded),
            _ => f32::from(encoded) / 255.0,
        };
        let mean = t.mean.map_or([1.0; 3], |mean| mean.map(decode));
        Self { width: t.width, height: t.height, levels: t.levels.len() as u32, kind, mean }
    }
}

/// `Material` of `gbuffer.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct MaterialUniform {
    base_colour: [f32; 3],
    roughness: f32,
    relief_depth: f32,
    padding: [f32; 3],
}

/// What all materials share: layout, sampler, and textures that stand for absent ones.
#[derive(Clone, Debug)]
pub(crate) struct MaterialKit {
    pub(crate) layout: wgpu::BindGroupLayout,
    sampler: wgpu::Sampler,
    white: wgpu::TextureView,
    flat: wgpu::TextureView,
}

impl MaterialKit {
    pub(crate) fn new(gpu: &Gpu) -> Self {
        let texture = |binding| wgpu::BindGroupLayoutEntry {
            binding,
            visibility: wgpu::ShaderStages::FRAGMENT,
            ty: wgpu::BindingType::Texture {
                sample_type: wgpu::TextureSampleType::Float { filterable: true },
                view_dimension: wgpu::TextureViewDimension::D2,
                multisampled: false,
            },
            count: None,
        };
        let layout = gpu.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("material"),
            entries: &[
                wgpu::BindGroupLayoutEntry {
                    binding: 0,
                    visibility: wgpu::ShaderStages::FRAGMENT,
                    ty: wgpu::BindingType::Buffer {
                        ty: wgpu::BufferBindingType::Uniform,
                        has_dynamic_offset: false,
                        min_binding_size: None,
                    },
                    count: None,
                },
                texture(1),
                texture(2),
                wgpu::BindGroupLayoutEntry {
                    binding: 3,
                    visibility: wgpu::ShaderStages::FRAGMENT,
                    ty: wgpu::BindingType::Sampler(wgpu::SamplerBindingType::Filtering),
                    count: None,
                },
            ],
        });
        // Anisotropic filtering sharpens floors at grazing angles but multiplies the work of a
        // software driver, which is why only real GPUs use it.
        let software = gpu.adapter.get_info().device_type == wgpu::DeviceType::Cpu;
        let sampler = gpu.device.create_sampler(&wgpu::SamplerDescriptor {
            label: Some("material"),
            address_mode_u: wgpu::AddressMode::Repeat,
            address_mode_v: wgpu::AddressMode::Repeat,
            mag_filter: wgpu::FilterMode::Linear,
            min_filter: wgpu::FilterMode::Linear,
            mipmap_filter: wgpu::MipmapFilterMode::Linear,
            anisotropy_clamp: if software { 1 } else { 8 },
            ..Default::default()
        });
        let single = |format, data: &[u8]| {
            gpu.device
                .create_texture_with_data(
                    &gpu.queue,
                    &wgpu::TextureDescriptor {
                        label: Some("absent texture"),
                        size: wgpu::Extent3d { width: 1, height: 1, depth_or_array_layers: 1 },
                        mip_level_count: 1,
                        sample_count: 1,
                        dimension: wgpu::TextureDimension::D2,
                        format,
                        usage: wgpu::TextureUsages::TEXTURE_BINDING,
                        view_formats: &[],
                    },
                    wgpu::util::TextureDataOrder::LayerMajor,
                    data,
                )
                .create_view(&Default::default())
        };
        Self {
            layout,
            sampler,
            white: single(wgpu::TextureFormat::Rgba8UnormSrgb, &[255; 4]),
            flat: single(wgpu::TextureFormat::R8Unorm, &[255]),
        }
    }

    /// Makes what the shaders read for one material with its textures as they are now.
    pub(crate) fn bind(&self, gpu: &Gpu, material: &Material, textures: &[StreamedTexture]) -> BoundMaterial {
        let find =
            |index: Option<usize>, kind| index.and_then(|i| textures.get(i)).filter(|t| t.kind() == kind);
        let of_colour = find(material.colour_texture, TextureKind::Colour);
        let colour = of_colour.and_then(StreamedTexture::view);
        let height = find(material.height_texture, TextureKind::Height).and_then(StreamedTexture::view);
        let stand_in = of_colour.filter(|_| colour.is_none()).map_or([1.0; 3], StreamedTexture::mean);
        let relief = height.is_some() && material.relief_depth > 0.0;
        let uniform = gpu.device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
            label: Some("material"),
            contents: bytemuck::bytes_of(&MaterialUniform {
                base_colour: std::array::from_fn(|i| material.base_colour[i] * stand_in[i]),
                roughness: material.roughness.clamp(0.05, 1.0),
                relief_depth: if relief { material.relief_depth.min(1.0) } else { 0.0 },
                padding: [0.0; 3],
            }),
            usage: wgpu::BufferUsages::UNIFORM,
        });
        let group = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("material"),
            layout: &self.layout,
            entries: &[
                wgpu::BindGroupEntry { binding: 0, resource: uniform.as_entire_binding() },
                wgpu::BindGroupEntry {
                    binding: 1,
                    resource: wgpu::BindingResource::TextureView(colour.as_ref().unwrap_or(&self.white)),
                },
                wgpu::BindGroupEntry {
                    binding: 2,
                    resource: wgpu::BindingResource::TextureView(height.as_ref().unwrap_or(&self.flat)),
                },
                wgpu::BindGroupEntry { binding: 3, resource: wgpu::BindingResource::Sampler(&self.sampler) },
            ],
        });
        BoundMaterial { group, relief }
    }
}

/// A material ready to draw with.
#[derive(Debug)]
pub(crate) struct BoundMaterial {
    pub(crate) group: wgpu::BindGroup,
    /// Whether the relief pipeline has something to do.
    pub(crate) relief: bool,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_mean_colour_is_linear_and_white_where_none_is_said() {
        let info = |mean| protocol::TextureInfo {
            kind: protocol::TextureKind::Color,
            width: 8,
            height: 8,
            mean,
            levels: vec![protocol::TextureLevel {
                width: 8,
                height: 8,
                bytes: 100,
                format: protocol::TextureFormat::Png,
            }],
        };
        assert_eq!(TextureShape::from(&info(None)).mean, [1.0; 3]);
        let [r, g, b] = TextureShape::from(&info(Some([255, 188, 10]))).mean;
        assert!(
            (r - 1.0).abs() < 1e-6 && (g - 0.5029).abs() < 1e-4 && (b - 0.003_035).abs() < 1e-6,
            "{r} {g} {b}"
        );
    }
}
