//! Textures back to memory.

use std::sync::mpsc;

use super::gpu::{Gpu, RenderError};

/// Reads the whole of mip level 0 of a 2D texture with `bytes_per_texel`, rows from the top,
/// tightly packed. Waits for the device.
pub(crate) fn read_texture(
    gpu: &Gpu,
    texture: &wgpu::Texture,
    bytes_per_texel: u32,
) -> Result<Vec<u8>, RenderError> {
    let (width, height) = (texture.width(), texture.height());
    let row = width * bytes_per_texel;
    let padded = row.next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT);
    let size = u64::from(padded) * u64::from(height);
    let limit = gpu.device.limits().max_buffer_size;
    if size > limit {
        return Err(RenderError::TooLarge { what: "a picture to read back", needed: size, allowed: limit });
    }
    let buffer = gpu.device.create_buffer(&wgpu::BufferDescriptor {
        label: Some("readback"),
        size,
        usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
        mapped_at_creation: false,
    });
    let mut encoder = gpu.device.create_command_encoder(&Default::default());
    encoder.copy_texture_to_buffer(
        texture.as_image_copy(),
        wgpu::TexelCopyBufferInfo {
            buffer: &buffer,
            layout: wgpu::TexelCopyBufferLayout {
                offset: 0,
                bytes_per_row: Some(padded),
                rows_per_image: None,
            },
        },
        texture.size(),
    );
    gpu.queue.submit([encoder.finish()]);
    let (done, answer) = mpsc::sync_channel(1);
    buffer.map_async(wgpu::MapMode::Read, .., move |result| {
        // The receiver lives until after the wait below.
        let _ = done.send(result);
    });
    let failed = |e: &dyn std::fmt::Display| RenderError::Picture(format!("cannot read it back: {e}"));
    gpu.device.poll(wgpu::PollType::wait_indefinitely()).map_err(|e| failed(&e))?;
    gpu.check()?;
    answer.try_recv().map_err(|e| failed(&e))?.map_err(|e| failed(&e))?;
    let mapped = buffer.get_mapped_range(..).map_err(|e| failed(&e))?;
    let mut pixels = Vec::with_capacity(row as usize * height as usize);
    for line in mapped.chunks_exact(padded as usize) {
        pixels.extend_from_slice(&line[..row as usize]);
    }
    Ok(pixels)
}
