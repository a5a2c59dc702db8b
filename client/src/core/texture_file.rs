//! The image files of texture levels: their headers, and their pixels where this crate decodes them; called on the
//! streaming thread.

use bytes::Bytes;
#[cfg(feature = "images")]
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

impl TextureFileError {
    pub(in crate::core) fn by_host(info: &TextureInfo, level: u32, why: String) -> Self {
        let [width, height] = size_of_level(info, level);
        Self { level, width, height, fault: TextureFileFault::Host(why) }
    }
}

/// What is wrong with the file of a texture level.
#[derive(Debug, Error)]
pub enum TextureFileFault {
    /// The file is not an intact image, or a larger one.
    #[cfg(feature = "images")]
    #[error(transparent)]
    Image(#[from] ImageError),
    /// The file does not begin as a PNG or JPEG file does.
    #[error("the file has no header of a PNG or JPEG image")]
    Header,
    /// The host could not decode the file.
    #[error("{0}")]
    Host(String),
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
    /// The level's PNG or JPEG file, for the host to decode; its header gives the level's size.
    File {
        /// The file.
        file: Bytes,
        /// Meaning of the texels: heights are grey, others have four bytes per texel.
        kind: TextureKind,
        /// Width and height, in texels.
        size: [u32; 2],
    },
    /// Texels that the host has decoded and keeps under a number.
    Held {
        /// The number.
        number: u32,
        /// Their size in bytes.
        bytes: u32,
    },
}

impl TexturePixels {
    /// Decodes the image file (PNG or JPEG) of a level; level 0 is the coarsest. The image must have the level's size;
    /// memory is reserved only after its header has been checked.
    ///
    /// # Errors
    /// The file is not an intact image of that size.
    #[cfg(feature = "images")]
    pub fn decode(file: &[u8], info: &TextureInfo, level: u32) -> Result<Self, TextureFileError> {
        let [width, height] = size_of_level(info, level);
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

    /// The image file of a level for the host to decode, once its header has been checked: what the host reserves is
    /// bounded by the level's size.
    ///
    /// # Errors
    /// The file does not begin as a PNG or JPEG file of that size.
    pub fn for_host(file: &Bytes, info: &TextureInfo, level: u32) -> Result<Self, TextureFileError> {
        let size @ [width, height] = size_of_level(info, level);
        let fault = match header_size(file) {
            Some(found) if found == size => {
                return Ok(Self::File { file: file.clone(), kind: info.kind, size });
            }
            Some([width, height]) => TextureFileFault::Size { width, height },
            None => TextureFileFault::Header,
        };
        Err(TextureFileError { level, width, height, fault })
    }

    /// Size of the pixels in bytes.
    #[must_use]
    pub fn bytes(&self) -> usize {
        match self {
            Self::Rgba8(texels) | Self::R8(texels) => texels.len(),
            Self::R16(texels) => 2 * texels.len(),
            // As decoded, which is more than the file.
            Self::File { size: [width, height], .. } => *width as usize * *height as usize * 4,
            Self::Held { bytes, .. } => *bytes as usize,
        }
    }
}

fn size_of_level(info: &TextureInfo, level: u32) -> [u32; 2] {
    let levels = u32::try_from(info.levels.len()).unwrap_or(u32::MAX);
    level_size([info.width, info.height], levels, level)
}

/// Width and height in the header of a PNG file (ISO/IEC 15948, 11.2.2) or of a JPEG file's frame (ITU-T T.81, B.2.2).
fn header_size(file: &[u8]) -> Option<[u32; 2]> {
    if file.starts_with(b"\x89PNG\r\n\x1a\n") {
        let header = file.get(12..24)?.strip_prefix(b"IHDR")?;
        let side = |at: usize| Some(u32::from_be_bytes(header.get(at..at + 4)?.try_into().ok()?));
        return Some([side(0)?, side(4)?]);
    }
    let mut rest = file.strip_prefix(&[0xff, 0xd8])?;
    // Segments: 0xff, possibly repeated, a marker, a length that counts itself, data.
    while let [0xff, marker, after @ ..] = rest {
        if *marker == 0xff {
            rest = &rest[1..];
            continue;
        }
        let length = usize::from(u16::from_be_bytes(after.get(..2)?.try_into().ok()?));
        let segment = after.get(2..length)?;
        // Frames of all processes; 0xc4, 0xc8 and 0xcc are tables.
        if (0xc0..=0xcf).contains(marker) && !matches!(marker, 0xc4 | 0xc8 | 0xcc) {
            let side =
                |at: usize| Some(u32::from(u16::from_be_bytes(segment.get(at..at + 2)?.try_into().ok()?)));
            return Some([side(3)?, side(1)?]);
        }
        rest = after.get(length..)?;
    }
    None
}

#[cfg(test)]
#[cfg(feature = "images")]
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

    #[test]
    fn a_host_gets_only_files_whose_header_has_the_size_of_the_level() {
        let shape = full(8, 4, TextureKind::Color);
        let jpeg = |width, height| {
            let mut file = std::io::Cursor::new(Vec::new());
            RgbImage::new(width, height).write_to(&mut file, ImageFormat::Jpeg).unwrap();
            file.into_inner()
        };
        for file in [png(RgbImage::new(8, 4)), jpeg(8, 4)] {
            let file = Bytes::from(file);
            let given = TexturePixels::for_host(&file, &shape, 3).unwrap();
            assert_eq!(
                given,
                TexturePixels::File { file: file.clone(), kind: TextureKind::Color, size: [8, 4] }
            );
            assert!(TexturePixels::for_host(&file, &shape, 2).is_err(), "larger than the level");
            // Every cut header is refused, and none panics.
            let accepted = |length| TexturePixels::for_host(&file.slice(..length), &shape, 3).is_ok();
            let shortest = (0..=file.len()).find(|length| accepted(*length)).unwrap();
            assert!((24..file.len()).contains(&shortest), "{shortest}");
        }
        for file in [png(RgbImage::new(4, 8)), jpeg(4, 8)] {
            let fault = TexturePixels::for_host(&file.into(), &shape, 3).unwrap_err().fault;
            assert!(matches!(fault, TextureFileFault::Size { width: 4, height: 8 }), "{fault}");
        }
        let forged = [&[0xff, 0xd8][..], &[0xff; 64], &[0xc0, 0, 0]].concat();
        assert!(TexturePixels::for_host(&forged.into(), &shape, 3).is_err());
    }
}
