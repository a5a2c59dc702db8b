//! Pages: squares of an array texture that hold one tile each. The array grows by doubling and is copied on the device.

use std::collections::BTreeSet;

use lodestream_scene::asset::tiles::{TILE_BORDER, TILE_SIDE};

use super::grid::PageNumber;
use crate::resources::descriptors::{STREAMED, texture_2d};
use crate::resources::gpu::Gpu;

/// Pages along a layer's side: `PAGES` of `tiled.wgsl`.
const PAGES_ALONG: u32 = 4;
/// Pages of a layer.
pub(super) const PAGES_OF_LAYER: u32 = PAGES_ALONG * PAGES_ALONG;
/// Texels along a page: `PAGE_SIDE` of `tiled.wgsl`.
const PAGE_SIDE: u32 = TILE_SIDE + 2 * TILE_BORDER;
const LAYER_SIDE: u32 = PAGES_ALONG * PAGE_SIDE;
/// Memory of a layer, 4.3 MB.
pub(super) const LAYER_BYTES: u64 = 4 * (LAYER_SIDE as u64).pow(2);

/// An array texture of pages.
#[derive(Debug)]
pub(super) struct PageArray {
    format: wgpu::TextureFormat,
    texture: Option<wgpu::Texture>,
    /// The lowest is taken first, so that later layers empty.
    free: BTreeSet<PageNumber>,
}

fn pages_of(layers: u32) -> PageNumber {
    (layers * PAGES_OF_LAYER) as PageNumber
}

/// Where a page begins.
fn origin(page: PageNumber) -> wgpu::Origin3d {
    let (page, layer) = (u32::from(page) % PAGES_OF_LAYER, u32::from(page) / PAGES_OF_LAYER);
    wgpu::Origin3d { x: page % PAGES_ALONG * PAGE_SIDE, y: page / PAGES_ALONG * PAGE_SIDE, z: layer }
}

impl PageArray {
    /// Without a layer.
    pub(super) fn new(format: wgpu::TextureFormat) -> Self {
        Self { format, texture: None, free: BTreeSet::new() }
    }

    pub(super) fn format(&self) -> wgpu::TextureFormat {
        self.format
    }

    pub(super) fn layers(&self) -> u32 {
        self.texture.as_ref().map_or(0, wgpu::Texture::depth_or_array_layers)
    }

    pub(super) fn bytes(&self) -> u64 {
        u64::from(self.layers()) * LAYER_BYTES
    }

    /// Number of pages with a tile.
    pub(super) fn used(&self) -> u32 {
        self.layers() * PAGES_OF_LAYER - self.free.len() as u32
    }

    /// Whether all pages have a tile.
    pub(super) fn is_full(&self) -> bool {
        self.free.is_empty()
    }

    /// The texture, if there are pages.
    pub(super) fn texture(&self) -> Option<&wgpu::Texture> {
        self.texture.as_ref()
    }

    /// A free page.
    pub(super) fn take(&mut self) -> Option<PageNumber> {
        self.free.pop_first()
    }

    /// Gives a page back.
    pub(super) fn give(&mut self, page: PageNumber) {
        self.free.insert(page);
    }

    /// Where to write a page.
    pub(super) fn place(&self, page: PageNumber) -> Option<wgpu::TexelCopyTextureInfo<'_>> {
        let texture = self.texture.as_ref()?;
        Some(wgpu::TexelCopyTextureInfo { origin: origin(page), ..texture.as_image_copy() })
    }

    fn create(&self, gpu: &Gpu, layers: u32) -> wgpu::Texture {
        let usage = STREAMED;
        let mut descriptor = texture_2d("texture tiles", (LAYER_SIDE, LAYER_SIDE), self.format, usage);
        descriptor.size.depth_or_array_layers = layers;
        // Seen as the other format too, where the device can.
        let other = self.format.add_srgb_suffix();
        let formats = [other];
        if other != self.format && has_view_formats(gpu) {
            descriptor.view_formats = &formats;
        }
        gpu.device.create_texture(&descriptor)
    }

    /// Adds layers, with all pages where they are.
    pub(super) fn grow(&mut self, gpu: &Gpu, layers: u32) {
        let (new, had) = (self.create(gpu, layers), self.layers());
        if let Some(old) = &self.texture {
            let mut encoder = gpu.device.create_command_encoder(&Default::default());
            encoder.copy_texture_to_texture(old.as_image_copy(), new.as_image_copy(), old.size());
            gpu.queue.submit([encoder.finish()]);
        }
        self.free.extend(pages_of(had)..pages_of(layers));
        self.texture = Some(new);
    }

    /// Moves all tiles into `layers` layers, fewer than before. `used` are their pages, ascending; the first page
    /// becomes page 0 and so on.
    pub(super) fn shrink(&mut self, gpu: &Gpu, layers: u32, used: &[PageNumber]) {
        let Some(old) = self.texture.take() else { return };
        self.free = (used.len() as PageNumber..pages_of(layers)).collect();
        if layers == 0 {
            return;
        }
        let new = self.create(gpu, layers);
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        for (to, from) in (0..).zip(used) {
            let at = |texture, page| wgpu::TexelCopyTextureInfo {
                origin: origin(page),
                ..wgpu::Texture::as_image_copy(texture)
            };
            let size = wgpu::Extent3d { width: PAGE_SIDE, height: PAGE_SIDE, depth_or_array_layers: 1 };
            encoder.copy_texture_to_texture(at(&old, *from), at(&new, to), size);
        }
        gpu.queue.submit([encoder.finish()]);
        self.texture = Some(new);
    }

    /// The number of layers to shrink to, if much is free: twice what is used, once a quarter is used.
    pub(super) fn shrunk(&self, most: u32) -> Option<u32> {
        let (layers, used) = (self.layers(), self.used());
        let roomy = 4 * used <= layers * PAGES_OF_LAYER;
        let wanted = if roomy { (2 * used).div_ceil(PAGES_OF_LAYER) } else { layers };
        // Where there is no room for all, tiles have to be removed first.
        let wanted = wanted.min(most.max(used.div_ceil(PAGES_OF_LAYER)));
        Some(wanted).filter(|wanted| *wanted < layers)
    }
}

/// Whether a texture can be seen in its format and in its format with sRGB.
pub(super) fn has_view_formats(gpu: &Gpu) -> bool {
    gpu.adapter.get_downlevel_capabilities().flags.contains(wgpu::DownlevelFlags::VIEW_FORMATS)
}
