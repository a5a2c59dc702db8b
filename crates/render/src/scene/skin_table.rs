//! The distinct skins of an asset's vertices in GPU memory.

use std::collections::HashMap;

use lodestream_geometry::mesh::skin::Skin;

use crate::resources::descriptors::texture_2d;
use crate::resources::gpu::Gpu;
use crate::resources::vertex::MAX_SKINS;

/// `SKINS_WIDTH` of `mesh_vertex.wgsl`.
const WIDTH: usize = 1024;

/// A texture of skins, each once: joints and weights as a word each. Vertices have their numbers ([`PackedVertex::of_skin`]).
/// It only grows, as skins of an asset are as many as its vertices at most.
///
/// [`PackedVertex::of_skin`]: crate::PackedVertex::of_skin
#[derive(Debug, Default)]
pub(crate) struct SkinTable {
    numbers: HashMap<Skin, u32>,
    words: Vec<[u32; 2]>,
    /// Skins that are in the texture.
    written: usize,
    texture: Option<wgpu::Texture>,
}

impl SkinTable {
    /// The number of a skin; `None` for the default one, and for those that no longer fit.
    pub(crate) fn number(&mut self, skin: Skin) -> Option<u32> {
        if skin == Skin::default() {
            return None;
        }
        if let Some(&known) = self.numbers.get(&skin) {
            return Some(known);
        }
        let number = u32::try_from(self.words.len()).ok().filter(|&number| number < MAX_SKINS)?;
        self.numbers.insert(skin, number);
        self.words.push([skin.joints(), skin.weights()].map(u32::from_le_bytes));
        Some(number)
    }

    /// Writes the skins that are new to the texture; returns whether there is another one, to be bound. Skins beyond the
    /// device's limit of textures are left out: what is read there is zero.
    pub(crate) fn write(&mut self, gpu: &Gpu) -> bool {
        if self.written == self.words.len() {
            return false;
        }
        let rows = |count: usize| u32::try_from(count.div_ceil(WIDTH)).unwrap_or(u32::MAX);
        let allowed = gpu.device.limits().max_texture_dimension_2d;
        let needed = rows(self.words.len()).min(allowed);
        let grows = self.texture.as_ref().is_none_or(|texture| texture.height() < needed);
        if grows {
            let usage = wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST;
            let size = (WIDTH as u32, needed.next_power_of_two().min(allowed));
            let texture = texture_2d("skins", size, wgpu::TextureFormat::Rg32Uint, usage);
            self.texture = Some(gpu.device.create_texture(&texture));
            self.written = 0;
        }
        let Some(texture) = &self.texture else { return false };
        // Whole rows, from the one that was not full.
        let first = self.written / WIDTH;
        let end = (needed as usize * WIDTH).min(self.words.len());
        let mut rows = self.words.get(first * WIDTH..end).unwrap_or_default().to_vec();
        rows.resize(rows.len().next_multiple_of(WIDTH), [0; 2]);
        let height = (rows.len() / WIDTH) as u32;
        if height > 0 {
            let place = wgpu::TexelCopyTextureInfo {
                origin: wgpu::Origin3d { x: 0, y: first as u32, z: 0 },
                ..texture.as_image_copy()
            };
            let layout = wgpu::TexelCopyBufferLayout {
                offset: 0,
                bytes_per_row: Some(8 * WIDTH as u32),
                rows_per_image: None,
            };
            let size = wgpu::Extent3d { width: WIDTH as u32, height, depth_or_array_layers: 1 };
            gpu.queue.write_texture(place, bytemuck::cast_slice(&rows), layout, size);
        }
        self.written = self.words.len();
        grows
    }

    /// The texture, once there are skins.
    pub(crate) fn texture(&self) -> Option<&wgpu::Texture> {
        self.texture.as_ref()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_skins_have_one_number_and_the_default_none() {
        let mut table = SkinTable::default();
        let (a, b) = (Skin::new([(1, 1.0)]), Skin::new([(1, 0.5), (2, 0.5)]));
        assert_eq!(
            [Skin::default(), a, b, a].map(|skin| table.number(skin)),
            [None, Some(0), Some(1), Some(0)]
        );
        assert_eq!(table.words, [[1, 255], [0x0201, 0x7f80]]);
    }
}
