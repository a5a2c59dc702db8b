//! Decoded pixels, on their way to the device.

use std::borrow::Cow;
use std::ops::Range;

use crate::resources::gpu::Gpu;

/// Decoded pixels of one mip level, rows from the top, tightly packed.
#[derive(Clone, Copy, Debug)]
pub enum TextureData<'a> {
    /// Four bytes per texel. A height texture takes the red channel.
    Rgba8(&'a [u8]),
    /// One byte per texel. A colour texture takes it as grey.
    R8(&'a [u8]),
    /// One 16-bit value per texel. A colour texture takes the high byte as grey.
    R16(&'a [u16]),
    /// A picture that the browser has decoded.
    #[cfg(target_family = "wasm")]
    Bitmap(&'a web_sys::ImageBitmap),
}

impl<'a> TextureData<'a> {
    /// The given rows, of `width` texels each.
    fn rows(self, width: u32, rows: &Range<u32>) -> Self {
        let [first, end] = [rows.start, rows.end].map(|row| row as usize * width as usize);
        match self {
            Self::Rgba8(d) => Self::Rgba8(&d[4 * first..4 * end]),
            Self::R8(d) => Self::R8(&d[first..end]),
            Self::R16(d) => Self::R16(&d[first..end]),
            #[cfg(target_family = "wasm")]
            Self::Bitmap(_) => self,
        }
    }

    /// Number of texels.
    pub(crate) fn texels(&self) -> usize {
        match self {
            Self::Rgba8(d) if d.len().is_multiple_of(4) => d.len() / 4,
            Self::Rgba8(_) => 0,
            Self::R8(d) => d.len(),
            Self::R16(d) => d.len(),
            #[cfg(target_family = "wasm")]
            Self::Bitmap(picture) => picture.width() as usize * picture.height() as usize,
        }
    }

    fn convert(self, format: wgpu::TextureFormat) -> Cow<'a, [u8]> {
        let grey = |g: u8| [g, g, g, 255];
        use wgpu::TextureFormat::{R16Unorm, Rgba8Unorm, Rgba8UnormSrgb};
        match (format, self) {
            (Rgba8UnormSrgb | Rgba8Unorm, Self::Rgba8(d)) => d.into(),
            (Rgba8UnormSrgb | Rgba8Unorm, Self::R8(d)) => d.iter().flat_map(|&g| grey(g)).collect(),
            (Rgba8UnormSrgb | Rgba8Unorm, Self::R16(d)) => {
                d.iter().flat_map(|&g| grey((g >> 8) as u8)).collect()
            }
            // × 257 maps 0..=255 onto 0..=65535 exactly.
            (R16Unorm, Self::Rgba8(d)) => {
                d.chunks_exact(4).flat_map(|p| (u16::from(p[0]) * 257).to_le_bytes()).collect()
            }
            (R16Unorm, Self::R8(d)) => d.iter().flat_map(|&g| (u16::from(g) * 257).to_le_bytes()).collect(),
            (R16Unorm, Self::R16(d)) => d.iter().flat_map(|g| g.to_le_bytes()).collect(),
            (_, Self::Rgba8(d)) => d.chunks_exact(4).map(|p| p[0]).collect(),
            (_, Self::R8(d)) => d.into(),
            (_, Self::R16(d)) => d.iter().map(|g| (g >> 8) as u8).collect(),
            // Not read by the CPU.
            #[cfg(target_family = "wasm")]
            (_, Self::Bitmap(_)) => Cow::default(),
        }
    }

    /// Whether it is a picture of this size; of pixels only the number is known.
    pub(crate) fn has_size(&self, [width, height]: [u32; 2]) -> bool {
        #[cfg(target_family = "wasm")]
        if let Self::Bitmap(picture) = self {
            return [picture.width(), picture.height()] == [width, height];
        }
        self.texels() == width as usize * height as usize
    }

    /// Uploads some rows of a picture of `width` texels a row. `to` is where the first of these rows goes.
    pub(crate) fn write(
        self,
        gpu: &Gpu,
        to: wgpu::TexelCopyTextureInfo<'_>,
        format: wgpu::TextureFormat,
        (width, rows): (u32, &Range<u32>),
    ) {
        let height = rows.end - rows.start;
        #[cfg(target_family = "wasm")]
        if let Self::Bitmap(picture) = self {
            copy_bitmap(gpu, picture, to, rows.start, [width, height]);
            return;
        }
        let bytes_per_row = Some(width * format.block_copy_size(None).unwrap_or(1));
        gpu.queue.write_texture(
            to,
            &self.rows(width, rows).convert(format),
            wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row, rows_per_image: None },
            wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
        );
    }
}

/// Copies rows of a picture from `first` on, as its file has them: neither colour space nor alpha is converted.
#[cfg(target_family = "wasm")]
fn copy_bitmap(
    gpu: &Gpu,
    picture: &web_sys::ImageBitmap,
    to: wgpu::TexelCopyTextureInfo<'_>,
    first: u32,
    [width, height]: [u32; 2],
) {
    let from = wgpu::CopyExternalImageSourceInfo {
        source: wgpu::ExternalImageSource::ImageBitmap(picture.clone()),
        origin: wgpu::Origin2d { x: 0, y: first },
        flip_y: false,
    };
    let to = to.to_tagged(wgpu::PredefinedColorSpace::Srgb, false);
    gpu.queue.copy_external_image_to_texture(
        &from,
        to,
        wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
    );
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn conversions_keep_the_extremes() {
        let r16 = TextureData::R8(&[0, 255]).convert(wgpu::TextureFormat::R16Unorm);
        assert_eq!(*r16, [0, 0, 255, 255]);
        let rgba = TextureData::R16(&[0xffff]).convert(wgpu::TextureFormat::Rgba8UnormSrgb);
        assert_eq!(*rgba, [255; 4]);
        assert_eq!(TextureData::Rgba8(&[1, 2, 3]).texels(), 0);
    }
}
