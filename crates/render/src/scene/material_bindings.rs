//! Bind groups of materials.

use std::sync::Arc;

use bytemuck::{Pod, Zeroable};
use lodestream_scene::asset::{Alpha, ClearCoat, Material, TextureKind, Wrap};
use wgpu::util::DeviceExt;

use crate::resources::gpu::Gpu;
use crate::resources::texture::Texture;
use crate::resources::texture_tiles::{TextureTiles, TiledMap};
use crate::scene::bound_material::{BoundMaterial, Features, MaterialCache, MaterialKey};
use crate::scene::relief_acceleration::ReliefAcceleration;
use crate::scene::vertex_tables::VertexTables;

/// `Material` of `gbuffer.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct MaterialUniform {
    base_colour: [f32; 4],
    emission: [f32; 3],
    normal_scale: f32,
    roughness: f32,
    metallic: f32,
    occlusion: f32,
    cutoff: f32,
    relief_depth: f32,
    unlit: u32,
    flat_faces: u32,
    /// Wrap modes as indices of [`WRAPS`]: of u, and of v from bit 8.
    wrap: u32,
    /// [`Specular::bytes`](lodestream_scene::asset::Specular::bytes), lowest first.
    specular: u32,
    /// [`packed_coat`].
    coat: u32,
    transmission: f32,
    /// A bit for each of `tiled` that uses the second set of texture coordinates.
    second_uv: u32,
    /// Tiled maps: colour, surface, normal, emission and occlusion.
    tiled: [TiledMap; 5],
}

/// A clear coat as `specular_of` of `brdf.wgsl` reads it, without its normal. Narrower lobes than of 0.05 flicker.
pub(crate) fn packed_coat(coat: ClearCoat) -> u32 {
    let steps = |share: f32, most: f32| (share.clamp(0.0, 1.0) * most).round() as u32;
    steps(coat.factor, 31.0) | steps((coat.roughness - 0.05) / 0.95, 127.0) << 5
}

/// Textures of a material in binding order, with their kinds.
const KINDS: [(u32, TextureKind); 6] = [
    (1, TextureKind::Color),
    (2, TextureKind::Height),
    (4, TextureKind::Surface),
    (5, TextureKind::Normal),
    (6, TextureKind::Color),
    (9, TextureKind::Surface),
];
const SAMPLER: u32 = 3;
const PART_STATES: u32 = 7;
const ATTRIBUTES: u32 = 8;
const WRAPS: [Wrap; 3] = [Wrap::Repeat, Wrap::Clamp, Wrap::Mirror];

/// Shared by all materials: layout, samplers and placeholder textures.
#[derive(Clone, Debug)]
pub(crate) struct MaterialBindings {
    pub(crate) layout: wgpu::BindGroupLayout,
    /// Layout of relief acceleration textures.
    pub(crate) acceleration_layout: wgpu::BindGroupLayout,
    /// By wrap mode in u and v.
    samplers: [[wgpu::Sampler; 3]; 3],
    white: wgpu::TextureView,
    /// Placeholder height map: the surface itself.
    flat: wgpu::TextureView,
    /// Placeholder surface map: leaves the factors unchanged.
    plain: wgpu::TextureView,
    /// Placeholder normal map: the surface's normal.
    straight: wgpu::TextureView,
    /// Placeholders of [`VertexTables`].
    no_states: wgpu::TextureView,
    no_attributes: wgpu::TextureView,
    pub(crate) cache: MaterialCache,
    /// Tiles of all textures.
    pub(crate) tiles: TextureTiles,
}

fn sampler(gpu: &Gpu, [u, v]: [Wrap; 2]) -> wgpu::Sampler {
    let mode = |wrap| match wrap {
        Wrap::Repeat => wgpu::AddressMode::Repeat,
        Wrap::Clamp => wgpu::AddressMode::ClampToEdge,
        Wrap::Mirror => wgpu::AddressMode::MirrorRepeat,
    };
    gpu.device.create_sampler(&wgpu::SamplerDescriptor {
        label: Some("material"),
        address_mode_u: mode(u),
        address_mode_v: mode(v),
        mag_filter: wgpu::FilterMode::Linear,
        min_filter: wgpu::FilterMode::Linear,
        mipmap_filter: wgpu::MipmapFilterMode::Linear,
        anisotropy_clamp: gpu.anisotropy_clamp(),
        ..Default::default()
    })
}

/// A texture of one texel.
fn texel(gpu: &Gpu, format: wgpu::TextureFormat, data: &[u8]) -> wgpu::TextureView {
    let descriptor = wgpu::TextureDescriptor {
        label: Some("texel"),
        size: wgpu::Extent3d { width: 1, height: 1, depth_or_array_layers: 1 },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format,
        usage: wgpu::TextureUsages::TEXTURE_BINDING,
        view_formats: &[],
    };
    gpu.device
        .create_texture_with_data(&gpu.queue, &descriptor, wgpu::util::TextureDataOrder::LayerMajor, data)
        .create_view(&Default::default())
}

impl MaterialBindings {
    pub(crate) fn new(gpu: &Gpu) -> Self {
        let entry = |binding, ty| wgpu::BindGroupLayoutEntry {
            binding,
            visibility: wgpu::ShaderStages::FRAGMENT,
            ty,
            count: None,
        };
        let block = wgpu::BindingType::Buffer {
            ty: wgpu::BufferBindingType::Uniform,
            has_dynamic_offset: false,
            min_binding_size: None,
        };
        let texture = wgpu::BindingType::Texture {
            sample_type: wgpu::TextureSampleType::Float { filterable: true },
            view_dimension: wgpu::TextureViewDimension::D2,
            multisampled: false,
        };
        let mut entries = vec![
            entry(0, block),
            entry(SAMPLER, wgpu::BindingType::Sampler(wgpu::SamplerBindingType::Filtering)),
        ];
        entries.extend(KINDS.map(|(binding, _)| entry(binding, texture)));
        entries.extend([PART_STATES, ATTRIBUTES].map(|binding| wgpu::BindGroupLayoutEntry {
            binding,
            visibility: wgpu::ShaderStages::VERTEX,
            ty: wgpu::BindingType::Texture {
                sample_type: wgpu::TextureSampleType::Uint,
                view_dimension: wgpu::TextureViewDimension::D2,
                multisampled: false,
            },
            count: None,
        }));
        let layout = gpu.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("material"),
            entries: &entries,
        });
        Self {
            layout,
            acceleration_layout: ReliefAcceleration::layout(gpu),
            samplers: WRAPS.map(|u| WRAPS.map(|v| sampler(gpu, [u, v]))),
            white: texel(gpu, wgpu::TextureFormat::Rgba8UnormSrgb, &[255; 4]),
            flat: texel(gpu, wgpu::TextureFormat::R8Unorm, &[255]),
            plain: texel(gpu, wgpu::TextureFormat::Rgba8Unorm, &[255; 4]),
            straight: texel(gpu, wgpu::TextureFormat::Rgba8Unorm, &[128, 128, 255, 255]),
            no_states: texel(gpu, wgpu::TextureFormat::R32Uint, &[0; 4]),
            no_attributes: texel(gpu, wgpu::TextureFormat::Rgba32Uint, &[0; 16]),
            cache: MaterialCache::default(),
            tiles: TextureTiles::new(gpu),
        }
    }

    /// A material with the current levels of its textures, and the asset's tables; equal ones share a bind group.
    pub(crate) fn bind(
        &self,
        gpu: &Gpu,
        material: &Material,
        textures: &[Texture],
        tables: &VertexTables,
    ) -> Arc<BoundMaterial> {
        let named = [
            material.base_color_texture,
            material.height_texture,
            material.surface_texture,
            material.normal_texture,
            material.emission_texture,
            material.occlusion_texture,
        ];
        let mut at = 0;
        let found = named.map(|index| {
            let kind = KINDS[at].1;
            at += 1;
            index.and_then(|i| textures.get(usize::from(i))).filter(|texture| texture.kind() == kind)
        });
        let used = found.map(|texture| texture.and_then(Texture::used_levels));
        // A texture's mean colour, until levels arrive.
        let stand_in = |i: usize| {
            let missing = found[i].filter(|_| used[i].is_none());
            missing.map_or([1.0; 3], Texture::mean)
        };
        let [colour, surface, given, open] = [0, 2, 4, 5].map(stand_in);
        let [_, height, surfaces, normals, _, occlusion] = used.each_ref().map(Option::is_some);
        let relief = height && material.relief_depth > 0.0;
        let wrap = material.wrap.map(|wrap| WRAPS.iter().position(|w| *w == wrap).unwrap_or(0));
        // Tiles stand beside whole levels: until the coarsest is there, the mean does.
        let tiled = [0, 2, 3, 4, 5].map(|i: usize| {
            let map = found[i].and_then(|texture| texture.tiled_map(&self.tiles));
            map.unwrap_or(TiledMap::zeroed())
        });
        // It is of the other set than the surface map.
        let second_occlusion = u32::from(!material.second_uv.surface);
        let [r, g, b, opacity] = material.base_color;
        let cutoff = if let Alpha::Mask(cutoff) = material.alpha { cutoff } else { 0.0 };
        let uniform = MaterialUniform {
            base_colour: [r * colour[0], g * colour[1], b * colour[2], opacity],
            emission: std::array::from_fn(|i| material.emission[i] * given[i]),
            normal_scale: material.normal_scale,
            roughness: material.roughness * surface[1],
            metallic: (material.metallic * surface[2]).clamp(0.0, 1.0),
            occlusion: surface[0] * open[0],
            cutoff,
            relief_depth: if relief { material.relief_depth.min(1.0) } else { 0.0 },
            unlit: u32::from(material.unlit),
            flat_faces: u32::from(material.flat),
            wrap: wrap[0] as u32 | (wrap[1] as u32) << 8,
            specular: u32::from_le_bytes(material.specular.bytes()),
            coat: packed_coat(material.clear_coat),
            transmission: material.transmission.clamp(0.0, 1.0),
            second_uv: u32::from(material.second_uv.bits()) | second_occlusion << 4,
            tiled,
        };
        // Acceleration textures assume a repeating map.
        let heights = found[1].filter(|_| relief && material.wrap == [Wrap::Repeat; 2]).cloned();
        let key = MaterialKey {
            uniform: bytemuck::bytes_of(&uniform).to_vec(),
            wrap,
            textures: used,
            tables: [tables.states.texture(), tables.attributes.texture()].map(Option::<&_>::cloned),
            features: Features {
                relief,
                maps: surfaces || normals || occlusion,
                tiled: tiled.iter().any(|map| *map != TiledMap::zeroed()),
                states: tables.states.texture().is_some(),
                ..Features::of(material)
            },
            accelerated: heights.is_some(),
        };
        self.cache.get(key, heights, &self.acceleration_layout, || {
            let views = found.map(|texture| texture.and_then(Texture::view));
            self.group(gpu, &uniform, wrap, &views, tables)
        })
    }

    fn group(
        &self,
        gpu: &Gpu,
        uniform: &MaterialUniform,
        [u, v]: [usize; 2],
        views: &[Option<wgpu::TextureView>; 6],
        tables: &VertexTables,
    ) -> wgpu::BindGroup {
        let uniform = gpu.device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
            label: Some("material"),
            contents: bytemuck::bytes_of(uniform),
            usage: wgpu::BufferUsages::UNIFORM,
        });
        let stand_ins = [&self.white, &self.flat, &self.plain, &self.straight, &self.white, &self.plain];
        let mut entries = vec![
            wgpu::BindGroupEntry { binding: 0, resource: uniform.as_entire_binding() },
            wgpu::BindGroupEntry {
                binding: SAMPLER,
                resource: wgpu::BindingResource::Sampler(&self.samplers[u][v]),
            },
        ];
        entries.extend(views.iter().zip(stand_ins).zip(KINDS).map(|((view, stand_in), (binding, _))| {
            let view = view.as_ref().unwrap_or(stand_in);
            wgpu::BindGroupEntry { binding, resource: wgpu::BindingResource::TextureView(view) }
        }));
        let view = |texture: Option<&wgpu::Texture>, none: &wgpu::TextureView| {
            texture.map_or_else(|| none.clone(), |texture| texture.create_view(&Default::default()))
        };
        let states = view(tables.states.texture(), &self.no_states);
        let attributes = view(tables.attributes.texture(), &self.no_attributes);
        entries.extend([(PART_STATES, &states), (ATTRIBUTES, &attributes)].map(|(binding, view)| {
            wgpu::BindGroupEntry { binding, resource: wgpu::BindingResource::TextureView(view) }
        }));
        gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("material"),
            layout: &self.layout,
            entries: &entries,
        })
    }
}
