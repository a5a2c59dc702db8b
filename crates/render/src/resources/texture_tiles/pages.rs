//! Pages: squares of an array texture that hold one tile each. The array is replaced by a larger or smaller one and
//! copied on the device; the sizes are such that both are within the budget.

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
    /// Most layers at once, with those of an array that was being replaced.
    peak_layers: u32,
}

fn pages_of(layers: u32) -> PageNumber {
    (layers * PAGES_OF_LAYER) as PageNumber
}

/// The layers of the array that replaces one of `layers` layers so that both have at most `budget`; `None` if more
/// layers than now do not fit. It has twice the layers while at least as many can be added later, then all that fit:
/// two thirds of the budget or more.
fn next_layers(layers: u32, budget: u32, most: u32) -> Option<u32> {
    let next = match (layers, budget) {
        // A budget of few layers is used whole.
        (0, 0..=3) => budget,
        (0, _) => 1,
        _ if 6 * layers < budget => 2 * layers,
        _ => budget.saturating_sub(layers),
    };
    Some(next.min(most)).filter(|next| *next > layers)
}

/// Most layers within a budget.
pub(super) fn final_layers(budget: u32, most: u32) -> u32 {
    let mut layers = 0;
    while let Some(next) = next_layers(layers, budget, most) {
        layers = next;
    }
    layers
}

/// Where a page begins.
fn origin(page: PageNumber) -> wgpu::Origin3d {
    let (page, layer) = (u32::from(page) % PAGES_OF_LAYER, u32::from(page) / PAGES_OF_LAYER);
    wgpu::Origin3d { x: page % PAGES_ALONG * PAGE_SIDE, y: page / PAGES_ALONG * PAGE_SIDE, z: layer }
}

impl PageArray {
    /// Without a layer.
    pub(super) fn new(format: wgpu::TextureFormat) -> Self {
        Self { format, texture: None, free: BTreeSet::new(), peak_layers: 0 }
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

    /// Most memory that pages took at once, in bytes.
    pub(super) fn peak_bytes(&self) -> u64 {
        u64::from(self.peak_layers) * LAYER_BYTES
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

    /// Replaces the texture by one of `layers` layers that `copy` fills. The old one is freed before the return, except
    /// in a browser, which does so when the copy is done.
    fn replace(
        &mut self,
        gpu: &Gpu,
        layers: u32,
        copy: impl FnOnce(&mut wgpu::CommandEncoder, &wgpu::Texture, &wgpu::Texture),
    ) {
        self.peak_layers = self.peak_layers.max(self.layers() + layers);
        let new = (layers > 0).then(|| self.create(gpu, layers));
        let Some(old) = std::mem::replace(&mut self.texture, new) else { return };
        if let Some(new) = &self.texture {
            let mut encoder = gpu.device.create_command_encoder(&Default::default());
            copy(&mut encoder, &old, new);
            gpu.queue.submit([encoder.finish()]);
        }
        old.destroy();
        // Else several replacements before the next frame would add up. An error is of a lost device, which the next
        // frame reports.
        let _ = gpu.device.poll(wgpu::PollType::wait_indefinitely());
    }

    /// Adds layers within a budget, with all pages where they are; returns whether there was room.
    pub(super) fn grow(&mut self, gpu: &Gpu, budget: u32, most: u32) -> bool {
        let had = self.layers();
        let Some(layers) = next_layers(had, budget, most) else { return false };
        self.replace(gpu, layers, |encoder, old, new| {
            encoder.copy_texture_to_texture(old.as_image_copy(), new.as_image_copy(), old.size());
        });
        self.free.extend(pages_of(had)..pages_of(layers));
        true
    }

    /// Moves all tiles into `layers` layers, fewer than before. `used` are their pages, ascending; the first page
    /// becomes page 0 and so on.
    pub(super) fn shrink(&mut self, gpu: &Gpu, layers: u32, used: &[PageNumber]) {
        self.free = (used.len() as PageNumber..pages_of(layers)).collect();
        self.replace(gpu, layers, |encoder, old, new| {
            for (to, from) in (0..).zip(used) {
                let at = |texture, page| wgpu::TexelCopyTextureInfo {
                    origin: origin(page),
                    ..wgpu::Texture::as_image_copy(texture)
                };
                let size = wgpu::Extent3d { width: PAGE_SIDE, height: PAGE_SIDE, depth_or_array_layers: 1 };
                encoder.copy_texture_to_texture(at(old, *from), at(new, to), size);
            }
        });
    }

    /// The number of layers to shrink to, if much is free or the budget is smaller than it was: twice what is used, once
    /// a quarter is used, and so few that they fit beside the present ones, if tiles allow.
    pub(super) fn shrunk(&self, budget: u32, most: u32) -> Option<u32> {
        let (layers, used) = (self.layers(), self.used());
        let least = used.div_ceil(PAGES_OF_LAYER);
        let roomy = 4 * used <= layers * PAGES_OF_LAYER;
        let wanted = if roomy { (2 * used).div_ceil(PAGES_OF_LAYER) } else { layers };
        // Where there is no room for all, tiles have to be removed first.
        let wanted = wanted.min(most.max(least));
        let beside = budget.saturating_sub(layers).max(least);
        Some(wanted.min(if wanted < layers { beside } else { layers })).filter(|wanted| *wanted < layers)
    }
}

/// Whether a texture can be seen in its format and in its format with sRGB.
pub(super) fn has_view_formats(gpu: &Gpu) -> bool {
    gpu.adapter.get_downlevel_capabilities().flags.contains(wgpu::DownlevelFlags::VIEW_FORMATS)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_array_and_the_one_that_replaces_it_fit_the_budget() {
        for budget in 0..300 {
            let mut layers = 0;
            while let Some(next) = next_layers(layers, budget, 256) {
                assert!(next > layers && next + layers <= budget, "{layers} -> {next} of {budget}");
                layers = next;
            }
            assert!(3 * layers >= 2 * budget.min(256), "{layers} of {budget}");
            assert_eq!(layers, final_layers(budget, 256));
        }
        assert_eq!(
            [0, 1, 2, 4, 8, 16].map(|layers| next_layers(layers, 61, 256)),
            [1, 2, 4, 8, 16, 45].map(Some)
        );
        assert_eq!(next_layers(45, 61, 256), None);
        assert_eq!(final_layers(61, 7), 7);
    }
}
