//! Decodes the image files of texture levels; called on the streaming thread.

use image::{DynamicImage, ImageError, ImageReader, Limits};
use lodestream_scene::asset::{TextureInfo, TextureKind, level_size};
use thiserror::Error;

/// A texture level that cannot be used.
#[derive(Debug, Error)]
#[error("texture level {level} ({width}×{height}): {fault}")]
pub struct TextureFileError {
    /// The level; 0 is the coarsest.
    pub level: u32,
    /// Width that the image should have, in pixels.
    pub width: u32,
    /// Height that the image should have, in pixels.
    pub height: u32,
    /// What is wrong.
    #[source]
    pub fault: TextureFileFault,
}

/// What is wrong with the file of a texture level.
#[derive(Debug, Error)]
pub enum TextureFileFault {
    /// The file is not an intact image, or a larger one.
    #[error(transparent)]
    Image(#[from] ImageError),
    /// The image has another size.
    #[error("the image has {width}×{height} pixels")]
    Size {
        /// Its width.
        width: u32,
        /// Its height.
        height: u32,
    },
}

/// Decoded pixels of one texture level, in the format of the texture's kind.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum TexturePixels {
    /// Four bytes per texel.
    Rgba8(Vec<u8>),
    /// One byte per texel.
    R8(Vec<u8>),
    /// One 16-bit value per texel.
    R16(Vec<u16>),
}

impl TexturePixels {
    /// Decodes the image file (PNG or JPEG) of a level; level 0 is the coarsest. The image must have the level's size;
    /// memory is reserved only after its header has been checked.
    ///
    /// # Errors
    /// The file is not an intact image of that size.
    pub fn decode(file: &[u8], info: &TextureInfo, level: u32) -> Result<Self, TextureFileError> {
        let levels = u32::try_from(info.levels.len()).unwrap_or(u32::MAX);
        let [width, height] = level_size([info.width, info.height], levels, level);
        let error = |fault: TextureFileFault| TextureFileError { level, width, height, fault };
        let reader = ImageReader::new(std::io::Cursor::new(file)).with_guessed_format();
        let mut reader = reader.map_err(|why| error(ImageError::IoError(why).into()))?;
        let mut limits = Limits::default();
        limits.max_image_width = Some(width);
        limits.max_image_height = Some(height);
        // Four channels of 16 bits, the decoder's buffers, and a constant for small images.
        limits.max_alloc = Some(u64::from(width) * u64::from(height) * 24 + (1 << 20));
        reader.limits(limits);
        let image = reader.decode().map_err(|why| error(why.into()))?;
        let size = (image.width(), image.height());
        if size != (width, height) {
            return Err(error(TextureFileFault::Size { width: size.0, height: size.1 }));
        }
        Ok(match (info.kind, image) {
            (TextureKind::Height, DynamicImage::ImageLuma8(grey)) => Self::R8(grey.into_raw()),
            (TextureKind::Height, image) => Self::R16(image.into_luma16().into_raw()),
            (_, image) => Self::Rgba8(image.into_rgba8().into_raw()),
        })
    }

    /// Size of the pixels in bytes.
    #[must_use]
    pub fn bytes(&self) -> usize {
        match self {
            Self::Rgba8(texels) | Self::R8(texels) => texels.len(),
            Self::R16(texels) => 2 * texels.len(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::{GrayImage, ImageBuffer, ImageFormat, Luma, RgbImage};
    use lodestream_scene::asset::{TextureFormat, TextureLevel};

    /// A texture with all levels down to 1×1.
    fn full(width: u32, height: u32, kind: TextureKind) -> TextureInfo {
        let count = width.max(height).ilog2() + 1;
        let level = |level| {
            let [width, height] = level_size([width, height], count, level);
            TextureLevel { width, height, bytes: 1, format: TextureFormat::Png }
        };
        TextureInfo { kind, width, height, mean: None, levels: (0..count).map(level).collect() }
    }

    fn png(image: impl Into<DynamicImage>) -> Vec<u8> {
        let mut file = std::io::Cursor::new(Vec::new());
        image.into().write_to(&mut file, ImageFormat::Png).unwrap();
        file.into_inner()
    }

    #[test]
    fn levels_decode_in_the_format_of_their_kind() {
        let colour = full(4, 2, TextureKind::Color);
        let file = png(RgbImage::from_pixel(4, 2, image::Rgb([1, 2, 3])));
        let pixels = TexturePixels::decode(&file, &colour, 2).unwrap();
        assert_eq!(pixels, TexturePixels::Rgba8([1, 2, 3, 255].repeat(8)));

        let height = TextureInfo { kind: TextureKind::Height, ..colour };
        let file = png(GrayImage::from_pixel(2, 1, Luma([77])));
        assert_eq!(TexturePixels::decode(&file, &height, 1).unwrap(), TexturePixels::R8(vec![77; 2]));
        let deep: ImageBuffer<Luma<u16>, _> = ImageBuffer::from_pixel(2, 1, Luma([54_321u16]));
        let pixels = TexturePixels::decode(&png(deep), &height, 1).unwrap();
        assert_eq!(pixels, TexturePixels::R16(vec![54_321; 2]));
    }

    #[test]
    fn files_that_do_not_match_the_level_are_errors() {
        let shape = full(8, 8, TextureKind::Color);
        let right = png(RgbImage::new(8, 8));
        let fault =
            |file: &[u8], level| TexturePixels::decode(file, &shape, level).err().map(|why| why.fault);
        let refused = |file: &[u8], level| fault(file, level).is_some();
        assert!(!refused(&right, 3));
        assert!(refused(&right, 2), "larger than the level");
        let smaller = fault(&png(RgbImage::new(4, 4)), 3);
        assert!(matches!(smaller, Some(TextureFileFault::Size { width: 4, height: 4 })), "{smaller:?}");
        assert!(refused(b"not an image", 3));
        for length in 0..right.len() - 1 {
            // Cutting off the end marker alone may pass; cutting off pixels may not.
            let _ = TexturePixels::decode(&right[..length], &shape, 3);
        }
        assert!(refused(&right[..right.len() / 2], 3));
    }
}
