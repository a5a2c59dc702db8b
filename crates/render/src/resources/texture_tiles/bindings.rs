//! The bind group of pages and page table: group 2 of the passes that draw meshes.

use crate::resources::descriptors::{group_layout, layout_entry, texture_2d, texture_binding};
use crate::resources::gpu::Gpu;

/// Layout, sampler, stand-ins and the group as of the last frame.
#[derive(Debug)]
pub(crate) struct TileBindings {
    pub(super) layout: wgpu::BindGroupLayout,
    sampler: wgpu::Sampler,
    no_pages: wgpu::TextureView,
    no_table: wgpu::TextureView,
    group: Option<wgpu::BindGroup>,
}

/// A view of an array texture, in a format.
fn array_view(texture: &wgpu::Texture, format: wgpu::TextureFormat) -> wgpu::TextureView {
    texture.create_view(&wgpu::TextureViewDescriptor {
        format: Some(format),
        dimension: Some(wgpu::TextureViewDimension::D2Array),
        ..Default::default()
    })
}

impl TileBindings {
    pub(super) fn new(gpu: &Gpu) -> Self {
        let entry = |binding, ty| layout_entry(binding, wgpu::ShaderStages::FRAGMENT, ty);
        let pages = texture_binding(true, wgpu::TextureViewDimension::D2Array);
        let words = wgpu::BindingType::Texture {
            sample_type: wgpu::TextureSampleType::Uint,
            view_dimension: wgpu::TextureViewDimension::D2,
            multisampled: false,
        };
        let sampler = wgpu::BindingType::Sampler(wgpu::SamplerBindingType::Filtering);
        let entries = [entry(0, pages), entry(1, pages), entry(2, sampler), entry(3, words)];
        let texel = |format| {
            let usage = wgpu::TextureUsages::TEXTURE_BINDING;
            gpu.device.create_texture(&texture_2d("no texture tiles", (1, 1), format, usage))
        };
        let no_pages = texel(wgpu::TextureFormat::Rgba8Unorm);
        Self {
            layout: group_layout(gpu, "texture tiles", &entries),
            sampler: gpu.device.create_sampler(&wgpu::SamplerDescriptor {
                label: Some("texture tiles"),
                mag_filter: wgpu::FilterMode::Linear,
                min_filter: wgpu::FilterMode::Linear,
                ..Default::default()
            }),
            no_pages: array_view(&no_pages, wgpu::TextureFormat::Rgba8Unorm),
            no_table: texel(wgpu::TextureFormat::R32Uint).create_view(&Default::default()),
            group: None,
        }
    }

    /// Makes a new group for the next frame.
    pub(super) fn forget(&mut self) {
        self.group = None;
    }

    /// The group of pages of colours and of other maps, and of the table.
    pub(super) fn group(
        &mut self,
        gpu: &Gpu,
        pages: [Option<&wgpu::Texture>; 2],
        table: Option<&wgpu::Texture>,
    ) -> wgpu::BindGroup {
        let made = self.group.get_or_insert_with(|| {
            let formats = [wgpu::TextureFormat::Rgba8UnormSrgb, wgpu::TextureFormat::Rgba8Unorm];
            let [colours, others] = [0, 1].map(|at| {
                pages[at].map_or_else(|| self.no_pages.clone(), |pages| array_view(pages, formats[at]))
            });
            let words = table.map(|table| table.create_view(&Default::default()));
            let words = words.as_ref().unwrap_or(&self.no_table);
            let view = |binding, view| wgpu::BindGroupEntry {
                binding,
                resource: wgpu::BindingResource::TextureView(view),
            };
            let sampler = wgpu::BindingResource::Sampler(&self.sampler);
            gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some("texture tiles"),
                layout: &self.layout,
                entries: &[
                    view(0, &colours),
                    view(1, &others),
                    wgpu::BindGroupEntry { binding: 2, resource: sampler },
                    view(3, words),
                ],
            })
        });
        made.clone()
    }
}
