//! Texture levels: image files to texels.

use std::io::Cursor;

use image::{DynamicImage, ImageFormat, ImageReader, Limits};
use lodestream_protocol::asset::{TextureFormat, TextureInfo, TextureKind};

/// Texels of one level, rows from the top.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Pixels {
    /// Width in texels.
    pub width: u32,
    /// Height in texels.
    pub height: u32,
    /// The texels.
    pub texels: Texels,
}

/// Texels by kind.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Texels {
    /// sRGB and opacity, four bytes each.
    Color(Vec<u8>),
    /// Heights, 65535 is the surface.
    Height(Vec<u16>),
}

impl Pixels {
    /// Memory held, in bytes.
    #[must_use]
    pub fn bytes(&self) -> usize {
        match &self.texels {
            Texels::Color(t) => t.len(),
            Texels::Height(t) => t.len() * 2,
        }
    }
}

/// A level that cannot be used.
#[derive(Debug, thiserror::Error)]
pub(crate) enum TextureError {
    #[error("no such level")]
    NoSuchLevel,
    #[error(transparent)]
    Image(#[from] image::ImageError),
    #[error("the image is {got:?} texels, but should be {expected:?}")]
    Size { got: (u32, u32), expected: (u32, u32) },
}

/// Decodes a level.
pub(crate) fn decode_level(info: &TextureInfo, level: u8, bytes: &[u8]) -> Result<Pixels, TextureError> {
    let expected = info.levels.get(usize::from(level)).ok_or(TextureError::NoSuchLevel)?;
    let size = (expected.width, expected.height);
    let format = match expected.format {
        TextureFormat::Jpeg => ImageFormat::Jpeg,
        TextureFormat::Png => ImageFormat::Png,
    };
    let mut reader = ImageReader::with_format(Cursor::new(bytes), format);
    let mut limits = Limits::default();
    limits.max_image_width = Some(size.0);
    limits.max_image_height = Some(size.1);
    // 16-bit RGBA, and as much again for the decoder's own rows.
    limits.max_alloc = Some(u64::from(size.0) * u64::from(size.1) * 16 + (1 << 16));
    reader.limits(limits);
    let image = reader.decode()?;
    if (image.width(), image.height()) != size {
        return Err(TextureError::Size { got: (image.width(), image.height()), expected: size });
    }
    Ok(to_pixels(image, info.kind))
}

fn to_pixels(image: DynamicImage, kind: TextureKind) -> Pixels {
    let (width, height) = (image.width(), image.height());
    let texels = match kind {
        TextureKind::Color => Texels::Color(image.into_rgba8().into_raw()),
        TextureKind::Height => Texels::Height(image.into_luma16().into_raw()),
    };
    Pixels { width, height, texels }
}

#[cfg(test)]
mod tests {
    use super::*;
    use lodestream_protocol::asset::TextureLevel;

    fn png(width: u32, height: u32) -> Vec<u8> {
        let image = image::RgbaImage::from_fn(width, height, |x, _| image::Rgba([x as u8 * 10, 20, 30, 255]));
        let mut out = Cursor::new(Vec::new());
        image.write_to(&mut out, ImageFormat::Png).unwrap();
        out.into_inner()
    }

    fn info() -> TextureInfo {
        let level = |width, height| TextureLevel { width, height, bytes: 0, format: TextureFormat::Png };
        TextureInfo {
            kind: TextureKind::Color,
            width: 12,
            height: 6,
            levels: vec![level(6, 3), level(12, 6)],
        }
    }

    #[test]
    fn levels_become_texels() {
        let pixels = decode_level(&info(), 0, &png(6, 3)).unwrap();
        assert_eq!((pixels.width, pixels.height, pixels.bytes()), (6, 3, 72));
        let Texels::Color(texels) = &pixels.texels else { panic!() };
        assert_eq!(texels[4..8], [10, 20, 30, 255]);
        let heights = TextureInfo { kind: TextureKind::Height, ..info() };
        let pixels = decode_level(&heights, 1, &png(12, 6)).unwrap();
        assert!(matches!(&pixels.texels, Texels::Height(t) if t.len() == 72));
    }

    #[test]
    fn wrong_sizes_levels_and_bytes_are_refused() {
        assert!(matches!(decode_level(&info(), 1, &png(6, 3)), Err(TextureError::Size { .. })));
        assert!(decode_level(&info(), 0, &png(12, 6)).is_err());
        assert!(matches!(decode_level(&info(), 2, &[]), Err(TextureError::NoSuchLevel)));
        let whole = png(6, 3);
        for length in 0..whole.len() - 12 {
            assert!(decode_level(&info(), 0, &whole[..length]).is_err(), "length {length}");
        }
    }
}
