//! Readback of textures and buffers.

use std::sync::mpsc;

use image::RgbaImage;

use crate::resources::gpu::{Gpu, RenderError};

/// A pending copy of a 2D texture's mip level 0, all layers.
#[derive(Debug)]
struct PendingCopy {
    buffer: wgpu::Buffer,
    row_bytes: u32,
    padded_bytes: u32,
    rows: u32,
}

impl PendingCopy {
    /// Records the copy.
    fn record(
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        texture: &wgpu::Texture,
        bytes_per_texel: u32,
    ) -> Result<Self, RenderError> {
        let row_bytes = texture.width() * bytes_per_texel;
        let padded_bytes = row_bytes.next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT);
        let rows = texture.height() * texture.depth_or_array_layers();
        let size = u64::from(padded_bytes) * u64::from(rows);
        let limit = gpu.device.limits().max_buffer_size;
        if size > limit {
            return Err(RenderError::TooLarge {
                what: "a picture to read back",
                needed: size,
                allowed: limit,
            });
        }
        let buffer = gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("readback"),
            size,
            usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
            mapped_at_creation: false,
        });
        let layout = wgpu::TexelCopyBufferLayout {
            offset: 0,
            bytes_per_row: Some(padded_bytes),
            rows_per_image: Some(texture.height()),
        };
        let into = wgpu::TexelCopyBufferInfo { buffer: &buffer, layout };
        encoder.copy_texture_to_buffer(texture.as_image_copy(), into, texture.size());
        Ok(Self { buffer, row_bytes, padded_bytes, rows })
    }

    /// The texels, rows from the top, tightly packed. Waits for the device.
    fn read(self, gpu: &Gpu) -> Result<Vec<u8>, RenderError> {
        let mut texels = Vec::with_capacity(self.row_bytes as usize * self.rows as usize);
        mapped(gpu, &self.buffer, |bytes| {
            for line in bytes.chunks_exact(self.padded_bytes as usize) {
                texels.extend_from_slice(&line[..self.row_bytes as usize]);
            }
        })?;
        Ok(texels)
    }
}

/// Maps a buffer for reading and passes its bytes to `take`. Waits for the device.
fn mapped(gpu: &Gpu, buffer: &wgpu::Buffer, take: impl FnOnce(&[u8])) -> Result<(), RenderError> {
    let (done, answer) = mpsc::sync_channel(1);
    buffer.map_async(wgpu::MapMode::Read, .., move |result| {
        // The receiver lives until after the wait below.
        let _ = done.send(result);
    });
    let failed = |e: &dyn std::fmt::Display| RenderError::Picture(format!("cannot read it back: {e}"));
    gpu.device.poll(wgpu::PollType::wait_indefinitely()).map_err(|e| failed(&e))?;
    gpu.check()?;
    answer.try_recv().map_err(|e| failed(&e))?.map_err(|e| failed(&e))?;
    take(&buffer.get_mapped_range(..).map_err(|e| failed(&e))?);
    Ok(())
}

/// Reads the first `bytes` of a buffer whose usages include [`wgpu::BufferUsages::COPY_SRC`]. Waits for the device.
#[cfg(any(test, feature = "reference"))]
pub(crate) fn read_buffer(gpu: &Gpu, buffer: &wgpu::Buffer, bytes: u64) -> Result<Vec<u8>, RenderError> {
    let copy = gpu.device.create_buffer(&wgpu::BufferDescriptor {
        label: Some("readback"),
        size: bytes,
        usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
        mapped_at_creation: false,
    });
    let mut encoder = gpu.device.create_command_encoder(&Default::default());
    encoder.copy_buffer_to_buffer(buffer, 0, &copy, 0, bytes);
    gpu.queue.submit([encoder.finish()]);
    let mut read = Vec::new();
    mapped(gpu, &copy, |bytes| read.extend_from_slice(bytes))?;
    Ok(read)
}

/// Reads the whole of mip level 0 of a 2D texture with `bytes_per_texel`, rows from the top,
/// tightly packed. Waits for the device.
pub(crate) fn read_texture(
    gpu: &Gpu,
    texture: &wgpu::Texture,
    bytes_per_texel: u32,
) -> Result<Vec<u8>, RenderError> {
    let mut encoder = gpu.device.create_command_encoder(&Default::default());
    let copied = PendingCopy::record(gpu, &mut encoder, texture, bytes_per_texel)?;
    gpu.queue.submit([encoder.finish()]);
    copied.read(gpu)
}

/// A copy of a host's target, taken without waiting for the device.
#[derive(Debug)]
pub struct TargetCopy {
    copied: PendingCopy,
    size: (u32, u32),
    bgra: bool,
}

impl TargetCopy {
    /// Records the copy of a colour target with four bytes a texel, whose usages include
    /// [`wgpu::TextureUsages::COPY_SRC`], as it is when the commands recorded so far are done.
    ///
    /// # Errors
    /// [`RenderError::Target`] for other formats, [`RenderError::TooLarge`] for a target that no buffer can hold.
    pub fn record(
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        target: &wgpu::Texture,
    ) -> Result<Self, RenderError> {
        use wgpu::TextureFormat::{Bgra8Unorm, Bgra8UnormSrgb, Rgba8Unorm, Rgba8UnormSrgb};
        let bgra = match target.format() {
            Rgba8Unorm | Rgba8UnormSrgb => false,
            Bgra8Unorm | Bgra8UnormSrgb => true,
            other => return Err(RenderError::Target(format!("pictures of {other:?} cannot be read back"))),
        };
        let size = (target.width(), target.height());
        Ok(Self { copied: PendingCopy::record(gpu, encoder, target, 4)?, size, bgra })
    }

    /// Memory that the copy takes.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        self.copied.buffer.size()
    }

    /// The picture, opaque. Waits for the device; call once the commands have been submitted.
    ///
    /// # Errors
    /// [`RenderError::Picture`] or [`RenderError::Device`] if it cannot be read back.
    pub fn picture(self, gpu: &Gpu) -> Result<RgbaImage, RenderError> {
        let Self { copied, size: (width, height), bgra } = self;
        let mut texels = copied.read(gpu)?;
        for texel in texels.chunks_exact_mut(4) {
            if bgra {
                texel.swap(0, 2);
            }
            texel[3] = 255;
        }
        RgbaImage::from_raw(width, height, texels)
            .ok_or_else(|| RenderError::Picture("size and pixels disagree".into()))
    }
}
