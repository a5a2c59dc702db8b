//! Attributes that few assets have, in GPU memory, for those vertices that have them.

use std::collections::HashMap;

use lodestream_geometry::mesh::skin::Skin;

use crate::resources::descriptors::texture_2d;
use crate::resources::gpu::Gpu;
use crate::resources::vertex::MAX_NUMBERED;

/// `ATTRIBUTES_WIDTH` of `attributes.wgsl`.
const WIDTH: usize = 1024;

/// Attributes of a vertex that [`PackedVertex`](crate::PackedVertex) has no room for.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct RareAttributes {
    pub(crate) skin: Skin,
    /// Second set of texture coordinates, `v` up.
    pub(crate) second_uv: [f32; 2],
    /// The vertex's part, which no skinned vertex has.
    pub(crate) part: u32,
}

impl RareAttributes {
    /// As `attributes_of` of `attributes.wgsl` reads them; `None` where all but the part are the default ones.
    fn words(self) -> Option<[u32; 4]> {
        let uv = self.second_uv.map(f32::to_bits);
        let skinned = self.skin != Skin::default();
        let [first, weights] = match skinned {
            true => [self.skin.joints(), self.skin.weights()].map(u32::from_le_bytes),
            false => [self.part, 0],
        };
        (skinned || uv != [0; 2]).then_some([first, weights, uv[0], uv[1]])
    }
}

/// A texture of attributes, each combination once: joints and weights, or part and 0, then the second set of texture
/// coordinates. Vertices have their numbers ([`PackedVertex::numbered`]). It only grows, as combinations of an asset are as
/// many as its vertices at most.
///
/// [`PackedVertex::numbered`]: crate::PackedVertex::numbered
#[derive(Debug, Default)]
pub(crate) struct AttributeTable {
    numbers: HashMap<[u32; 4], u32>,
    rows: Vec<[u32; 4]>,
    /// Entries that are in the texture.
    written: usize,
    texture: Option<wgpu::Texture>,
}

impl AttributeTable {
    /// The number of attributes; `None` for the default ones, and for those that no longer fit.
    pub(crate) fn number(&mut self, attributes: RareAttributes) -> Option<u32> {
        let words = attributes.words()?;
        if let Some(&known) = self.numbers.get(&words) {
            return Some(known);
        }
        let number = u32::try_from(self.rows.len()).ok().filter(|&number| number < MAX_NUMBERED)?;
        self.numbers.insert(words, number);
        self.rows.push(words);
        Some(number)
    }

    /// Writes what is new to the texture; returns whether there is another one, to be bound. What is beyond the device's
    /// limit of textures is left out: what is read there is zero.
    pub(crate) fn write(&mut self, gpu: &Gpu) -> bool {
        if self.written == self.rows.len() {
            return false;
        }
        let lines = |count: usize| u32::try_from(count.div_ceil(WIDTH)).unwrap_or(u32::MAX);
        let allowed = gpu.device.limits().max_texture_dimension_2d;
        let needed = lines(self.rows.len()).min(allowed);
        let grows = self.texture.as_ref().is_none_or(|texture| texture.height() < needed);
        if grows {
            let usage = wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST;
            let size = (WIDTH as u32, needed.next_power_of_two().min(allowed));
            let texture = texture_2d("attributes", size, wgpu::TextureFormat::Rgba32Uint, usage);
            self.texture = Some(gpu.device.create_texture(&texture));
            self.written = 0;
        }
        let Some(texture) = &self.texture else { return false };
        // Whole lines, from the one that was not full.
        let first = self.written / WIDTH;
        let end = (needed as usize * WIDTH).min(self.rows.len());
        let mut texels = self.rows.get(first * WIDTH..end).unwrap_or_default().to_vec();
        texels.resize(texels.len().next_multiple_of(WIDTH), [0; 4]);
        let height = (texels.len() / WIDTH) as u32;
        if height > 0 {
            let place = wgpu::TexelCopyTextureInfo {
                origin: wgpu::Origin3d { x: 0, y: first as u32, z: 0 },
                ..texture.as_image_copy()
            };
            let layout = wgpu::TexelCopyBufferLayout {
                offset: 0,
                bytes_per_row: Some(16 * WIDTH as u32),
                rows_per_image: None,
            };
            let size = wgpu::Extent3d { width: WIDTH as u32, height, depth_or_array_layers: 1 };
            gpu.queue.write_texture(place, bytemuck::cast_slice(&texels), layout, size);
        }
        self.written = self.rows.len();
        grows
    }

    /// The texture, once there are attributes.
    pub(crate) fn texture(&self) -> Option<&wgpu::Texture> {
        self.texture.as_ref()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_attributes_have_one_number_and_the_default_ones_none() {
        let mut table = AttributeTable::default();
        let of_skin = |skin| RareAttributes { skin, ..RareAttributes::default() };
        let a = of_skin(Skin::new([(1, 1.0)]));
        let b = of_skin(Skin::new([(1, 0.5), (2, 0.5)]));
        let c = RareAttributes { second_uv: [0.5, -1.0], part: 3, ..RareAttributes::default() };
        let none = RareAttributes { part: 3, ..RareAttributes::default() };
        let numbers = [none, a, b, c, a, c].map(|attributes| table.number(attributes));
        assert_eq!(numbers, [None, Some(0), Some(1), Some(2), Some(0), Some(2)]);
        let [half, minus_one] = [0.5_f32, -1.0].map(f32::to_bits);
        assert_eq!(table.rows, [[1, 255, 0, 0], [0x0201, 0x7f80, 0, 0], [3, 0, half, minus_one]]);
    }
}
