//! The page table: words of all tiled textures in one texture, as fragment stages of some devices have no storage
//! buffers.

use std::collections::BTreeSet;
use std::ops::Range;

use crate::resources::descriptors::texture_2d;
use crate::resources::gpu::{Gpu, RenderError};
use crate::resources::pages::{give, take};

/// Words of a row: `PAGE_TABLE_WIDTH` of `tiled.wgsl`.
const WIDTH: u32 = 1024;
/// Most rows, 16 MB: enough for 3000 textures of 8192² texels, and forged sizes cannot claim more.
const MAX_ROWS: u32 = 4096;

/// Words of all tiled textures.
#[derive(Debug, Default)]
pub(super) struct PageTable {
    words: Vec<u32>,
    free: Vec<Range<u32>>,
    /// Rows that the device does not have.
    dirty: BTreeSet<u32>,
    texture: Option<wgpu::Texture>,
}

fn most_rows(gpu: &Gpu) -> u32 {
    gpu.device.limits().max_texture_dimension_2d.min(MAX_ROWS)
}

impl PageTable {
    /// A range of `count` words, all 0.
    ///
    /// # Errors
    /// [`RenderError::TooLarge`] past [`MAX_ROWS`], or past the device's limit of textures.
    pub(super) fn allocate(&mut self, gpu: &Gpu, count: u32) -> Result<Range<u32>, RenderError> {
        let start = match take(&mut self.free, count) {
            Some(start) => start,
            None => {
                let (len, rows) = (self.words.len() as u32, most_rows(gpu));
                let end = (len + count).next_multiple_of(WIDTH);
                if end / WIDTH > rows {
                    let [needed, allowed] = [end / WIDTH, rows].map(|rows| u64::from(rows * WIDTH) * 4);
                    return Err(RenderError::TooLarge { what: "page table of textures", needed, allowed });
                }
                self.words.resize(end as usize, 0);
                give(&mut self.free, len..end);
                take(&mut self.free, count).unwrap_or(len)
            }
        };
        let range = start..start + count;
        self.words_of(&range).fill(0);
        self.touch(range.clone());
        Ok(range)
    }

    /// Gives a range back.
    pub(super) fn free(&mut self, range: Range<u32>) {
        give(&mut self.free, range);
    }

    /// The words of a range.
    pub(super) fn words_of(&mut self, range: &Range<u32>) -> &mut [u32] {
        &mut self.words[range.start as usize..range.end as usize]
    }

    /// Marks words as written.
    pub(super) fn touch(&mut self, range: Range<u32>) {
        if !range.is_empty() {
            self.dirty.extend(range.start / WIDTH..=(range.end - 1) / WIDTH);
        }
    }

    /// The texture, once there are words.
    pub(super) fn texture(&self) -> Option<&wgpu::Texture> {
        self.texture.as_ref()
    }

    /// Uploads the rows that have been written. Returns whether the texture is another one.
    pub(super) fn flush(&mut self, gpu: &Gpu) -> bool {
        if self.dirty.is_empty() {
            return false;
        }
        let rows = self.words.len() as u32 / WIDTH;
        let grown = self.texture.as_ref().is_none_or(|texture| texture.height() < rows);
        if grown {
            let height = rows.next_power_of_two().min(most_rows(gpu));
            let usage = wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST;
            let descriptor = texture_2d("page table", (WIDTH, height), wgpu::TextureFormat::R32Uint, usage);
            self.texture = Some(gpu.device.create_texture(&descriptor));
            self.dirty.extend(0..rows);
        }
        let Some(texture) = &self.texture else { return grown };
        let dirty: Vec<u32> = std::mem::take(&mut self.dirty).into_iter().collect();
        for run in dirty.chunk_by(|a, b| a + 1 == *b) {
            let (first, count) = (run[0], run.len() as u32);
            let words = &self.words[(first * WIDTH) as usize..((first + count) * WIDTH) as usize];
            gpu.queue.write_texture(
                wgpu::TexelCopyTextureInfo {
                    origin: wgpu::Origin3d { x: 0, y: first, z: 0 },
                    ..texture.as_image_copy()
                },
                bytemuck::cast_slice(words),
                wgpu::TexelCopyBufferLayout {
                    offset: 0,
                    bytes_per_row: Some(4 * WIDTH),
                    rows_per_image: None,
                },
                wgpu::Extent3d { width: WIDTH, height: count, depth_or_array_layers: 1 },
            );
        }
        grown
    }
}
