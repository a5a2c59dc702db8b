//! The image files of texture levels: their headers, and their pixels where this crate decodes them; called on the
//! streaming thread.

use bytes::Bytes;
#[cfg(feature = "images")]
use image::{DynamicImage, ImageError, ImageReader, Limits};
use lodestream_scene::asset::{Planes, TextureInfo, TextureKind, level_size, tile_place, tile_size};
use thiserror::Error;

use super::texture_header::{header_size, is_webp};

/// A texture level, or a tile of one, that cannot be used.
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
    pub(in crate::core) fn by_host(
        info: &TextureInfo,
        (level, tile): (u32, Option<u16>),
        why: String,
    ) -> Self {
        let [width, height] = size_of_image(info, (level, tile));
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
    /// The file does not begin as a PNG, JPEG or WebP file does.
    #[error("the file has no header of a PNG, JPEG or WebP image")]
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
    /// The level's PNG, JPEG or WebP file, for the host to decode; its header gives the level's size, or that of its
    /// planes.
    File {
        /// The file.
        file: Bytes,
        /// Meaning of the texels: heights are grey, others have four bytes per texel.
        kind: TextureKind,
        /// Width and height, in texels.
        size: [u32; 2],
        /// The planes that the file's picture is made of, if it is: [`Planes::texels`] gives the texels.
        planes: Option<Planes>,
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
    /// Decodes the image file (PNG, JPEG or WebP) of a level, or of a tile of it; level 0 is the coarsest. The image must
    /// have the size of the level or tile, or of its planes; memory is reserved only after its header has been checked.
    ///
    /// # Errors
    /// The file is not an intact image of that size.
    #[cfg(feature = "images")]
    pub fn decode(
        file: &[u8],
        info: &TextureInfo,
        (level, tile): (u32, Option<u16>),
    ) -> Result<Self, TextureFileError> {
        let planes = planes_of(file, info);
        let [width, height] = checked_size(file, info, (level, tile))?;
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
        if let Some(planes) = planes {
            return Ok(Self::Rgba8(planes.texels(image.into_rgb8().as_raw().as_chunks::<3>().0)));
        }
        Ok(match (info.kind, image) {
            (TextureKind::Height, DynamicImage::ImageLuma8(grey)) => Self::R8(grey.into_raw()),
            (TextureKind::Height, image) => Self::R16(image.into_luma16().into_raw()),
            (_, image) => Self::Rgba8(image.into_rgba8().into_raw()),
        })
    }

    /// The image file of a level or tile for the host to decode, once its header has been checked: what the host
    /// reserves is bounded by its size.
    ///
    /// # Errors
    /// The file does not begin as a PNG, JPEG or WebP file of that size.
    pub fn for_host(
        file: &Bytes,
        info: &TextureInfo,
        image: (u32, Option<u16>),
    ) -> Result<Self, TextureFileError> {
        checked_size(file, info, image)?;
        let (size, planes) = (size_of_image(info, image), planes_of(file, info));
        Ok(Self::File { file: file.clone(), kind: info.kind, size, planes })
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

/// Width and height of a level, or of a tile with its border.
fn size_of_image(info: &TextureInfo, (level, tile): (u32, Option<u16>)) -> [u32; 2] {
    let levels = u32::try_from(info.levels.len()).unwrap_or(u32::MAX);
    let size = level_size([info.width, info.height], levels, level);
    tile.map_or(size, |tile| {
        let [column, row] = tile_place(size, tile);
        tile_size(size, column, row)
    })
}

/// The planes that a file's picture is made of; `None` if it is the image itself.
fn planes_of(file: &[u8], info: &TextureInfo) -> Option<Planes> {
    info.planes().filter(|_| is_webp(file))
}

/// The size of the picture of a level or tile, which the file's header must state.
fn checked_size(
    file: &[u8],
    info: &TextureInfo,
    (level, tile): (u32, Option<u16>),
) -> Result<[u32; 2], TextureFileError> {
    let size = size_of_image(info, (level, tile));
    let size @ [width, height] = planes_of(file, info).map_or(size, |planes| planes.stacked(size));
    let fault = match header_size(file) {
        // A surface without planes has no WebP files.
        Some(found) if found == size && height > 0 => return Ok(size),
        Some([width, height]) => TextureFileFault::Size { width, height },
        None => TextureFileFault::Header,
    };
    Err(TextureFileError { level, width, height, fault })
}

#[cfg(test)]
#[cfg(feature = "images")]
mod tests {
    use super::*;
    use image::{GrayImage, ImageBuffer, ImageFormat, Luma, RgbImage};
    use lodestream_scene::asset::{NORMAL_PLANES, TextureFormat, TextureLevel};

    /// A texture with all levels down to 1×1.
    fn full(width: u32, height: u32, kind: TextureKind) -> TextureInfo {
        let count = width.max(height).ilog2() + 1;
        let level = |level| {
            let [width, height] = level_size([width, height], count, level);
            TextureLevel { width, height, bytes: 1, format: TextureFormat::Png }
        };
        TextureInfo {
            kind,
            width,
            height,
            planes: if kind == TextureKind::Normal { NORMAL_PLANES } else { 0 },
            mean: None,
            uv_per_unit: 1.0,
            levels: (0..count).map(level).collect(),
        }
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
        let pixels = TexturePixels::decode(&file, &colour, (2, None)).unwrap();
        assert_eq!(pixels, TexturePixels::Rgba8([1, 2, 3, 255].repeat(8)));

        let height = TextureInfo { kind: TextureKind::Height, ..colour };
        let file = png(GrayImage::from_pixel(2, 1, Luma([77])));
        assert_eq!(TexturePixels::decode(&file, &height, (1, None)).unwrap(), TexturePixels::R8(vec![77; 2]));
        let deep: ImageBuffer<Luma<u16>, _> = ImageBuffer::from_pixel(2, 1, Luma([54_321u16]));
        let pixels = TexturePixels::decode(&png(deep), &height, (1, None)).unwrap();
        assert_eq!(pixels, TexturePixels::R16(vec![54_321; 2]));
    }

    /// A lossy WebP file of 8×4 texels, red 200, green 60, blue 30, by libwebp.
    const WEBP: &[u8] = b"RIFF\x3e\0\0\0WEBPVP8 \x32\0\0\0\xd0\x01\0\x9d\x01\x2a\x08\0\x04\0\0\xc0\x12\x25\xa0\x02\x74\xba\
        \x01\xf8\0\x03\xb0\0\xfe\xf2\xa9\x7f\xfd\xbb\x3f\xae\xcf\xeb\xb3\xfe\xed\xbf\xfe\xb6\x0f\xeb\x60\xfe\xb6\x0f\xfe\xb4\0\0";

    #[test]
    fn webp_levels_decode() {
        let shape = full(8, 4, TextureKind::Color);
        let TexturePixels::Rgba8(texels) = TexturePixels::decode(WEBP, &shape, (3, None)).unwrap() else {
            panic!()
        };
        assert_eq!(texels.len(), 8 * 4 * 4);
        for texel in texels.chunks(4) {
            let off = texel.iter().zip([200, 60, 30, 255]).map(|(a, b)| a.abs_diff(b)).max();
            assert!(off <= Some(3), "{texel:?}");
        }
        // Cut anywhere it is an error or, in its last bytes, a picture; it never panics.
        let decodes = |length| TexturePixels::decode(&WEBP[..length], &shape, (3, None)).is_ok();
        let shortest = (0..=WEBP.len()).find(|&length| decodes(length)).unwrap();
        assert!(shortest > 40, "{shortest}");
    }

    #[test]
    fn a_webp_picture_larger_than_its_canvas_is_refused_before_memory_is_reserved() {
        let mut huge = WEBP[12..].to_vec();
        huge[14..18].copy_from_slice(&[0xff, 0x3f, 0xff, 0x3f]);
        let canvas = [&b"VP8X\x0a\0\0\0\0\0\0\0\x07\0\0\x03\0\0"[..], &huge].concat();
        let file = [b"RIFF", &(canvas.len() as u32 + 4).to_le_bytes()[..], b"WEBP", &canvas].concat();
        let fault =
            TexturePixels::decode(&file, &full(8, 4, TextureKind::Color), (3, None)).unwrap_err().fault;
        assert!(matches!(fault, TextureFileFault::Header), "{fault}");
    }

    /// A WebP file of grey values, without loss.
    fn grey_webp(width: u32, height: u32) -> Vec<u8> {
        let image = RgbImage::from_fn(width, height, |x, y| image::Rgb([(20 + 25 * x + 7 * y) as u8; 3]));
        let mut file = std::io::Cursor::new(Vec::new());
        image.write_to(&mut file, ImageFormat::WebP).unwrap();
        file.into_inner()
    }

    #[test]
    fn planes_of_normals_and_surfaces_become_texels() {
        let normal = full(8, 4, TextureKind::Normal);
        let value = |x: u32, y: u32| (20 + 25 * x + 7 * y) as u8;
        let texels = |info: &TextureInfo, rows: u32| {
            let file = Bytes::from(grey_webp(8, rows));
            let TexturePixels::Rgba8(texels) = TexturePixels::decode(&file, info, (3, None)).unwrap() else {
                panic!()
            };
            // A host gets the picture's size from the planes.
            let given = TexturePixels::for_host(&file, info, (3, None)).unwrap();
            let TexturePixels::File { size, planes, .. } = given else { panic!() };
            assert_eq!((size, planes.unwrap().stacked(size)), ([8, 4], [8, rows]));
            texels
        };
        for (at, texel) in (0..).zip(texels(&normal, 8).chunks(4)) {
            let (x, y) = (at % 8, at / 8);
            assert_eq!([texel[0], texel[1], texel[3]], [value(x, y), value(x, y + 4), 255]);
            assert!(texel[2] >= 128, "{texel:?} points out of the surface");
        }
        let (kind, mean) = (TextureKind::Surface, Some([9, 8, 7]));
        let surface = TextureInfo { kind, planes: 0b101, mean, ..normal.clone() };
        for (at, texel) in (0..).zip(texels(&surface, 8).chunks(4)) {
            assert_eq!(texel, [value(at % 8, at / 8), 8, value(at % 8, at / 8 + 4), 255]);
        }
        // PNG has all channels.
        let file = png(RgbImage::from_pixel(8, 4, image::Rgb([1, 2, 3])));
        let whole = TexturePixels::decode(&file, &surface, (3, None)).unwrap();
        assert_eq!(whole, TexturePixels::Rgba8([1, 2, 3, 255].repeat(32)));
    }

    #[test]
    fn planes_of_other_sizes_are_refused() {
        let normal = full(8, 4, TextureKind::Normal);
        let (kind, mean) = (TextureKind::Surface, Some([9, 8, 7]));
        let surface = |planes| TextureInfo { kind, planes, mean, ..normal.clone() };
        let refused = |file: Vec<u8>, info: &TextureInfo| {
            let file = Bytes::from(file);
            let [ours, hosts] = [
                TexturePixels::decode(&file, info, (3, None)).unwrap_err(),
                TexturePixels::for_host(&file, info, (3, None)).unwrap_err(),
            ];
            assert_eq!(ours.to_string(), hosts.to_string());
            assert!(matches!(ours.fault, TextureFileFault::Size { .. }), "{ours}");
        };
        for rows in [1, 4, 7, 9, 12] {
            refused(grey_webp(8, rows), &normal);
        }
        refused(grey_webp(16, 4), &normal);
        refused(grey_webp(8, 8), &surface(7));
        refused(grey_webp(8, 8), &surface(1));
        refused(grey_webp(8, 4), &surface(0));
        refused(png(RgbImage::new(8, 8)), &normal);
        // Of no rows, as a surface without planes would have.
        let mut none = WEBP.to_vec();
        none[28..30].copy_from_slice(&[0, 0]);
        refused(none, &surface(0));
        // Tiles have the same number of planes.
        let tiled = full(512, 512, TextureKind::Normal);
        assert!(TexturePixels::decode(&grey_webp(260, 520), &tiled, (9, Some(0))).is_ok());
        for rows in [260, 512, 519, 521, 780] {
            assert!(TexturePixels::decode(&grey_webp(260, rows), &tiled, (9, Some(0))).is_err(), "{rows}");
        }
    }

    #[test]
    fn files_that_do_not_match_the_level_are_errors() {
        let shape = full(8, 8, TextureKind::Color);
        let right = png(RgbImage::new(8, 8));
        let fault = |file: &[u8], level| {
            TexturePixels::decode(file, &shape, (level, None)).err().map(|why| why.fault)
        };
        let refused = |file: &[u8], level| fault(file, level).is_some();
        assert!(!refused(&right, 3));
        assert!(refused(&right, 2), "larger than the level");
        let smaller = fault(&png(RgbImage::new(4, 4)), 3);
        assert!(matches!(smaller, Some(TextureFileFault::Size { width: 4, height: 4 })), "{smaller:?}");
        assert!(refused(b"not an image", 3));
        for length in 0..right.len() - 1 {
            // Cutting off the end marker alone may pass; cutting off pixels may not.
            let _ = TexturePixels::decode(&right[..length], &shape, (3, None));
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
        for file in [png(RgbImage::new(8, 4)), jpeg(8, 4), WEBP.to_vec()] {
            let file = Bytes::from(file);
            let given = TexturePixels::for_host(&file, &shape, (3, None)).unwrap();
            assert_eq!(
                given,
                TexturePixels::File {
                    file: file.clone(),
                    kind: TextureKind::Color,
                    size: [8, 4],
                    planes: None
                }
            );
            assert!(TexturePixels::for_host(&file, &shape, (2, None)).is_err(), "larger than the level");
            // Every cut header is refused, and none panics.
            let accepted = |length| TexturePixels::for_host(&file.slice(..length), &shape, (3, None)).is_ok();
            let shortest = (0..=file.len()).find(|length| accepted(*length)).unwrap();
            assert!((24..file.len()).contains(&shortest), "{shortest}");
        }
        for file in [png(RgbImage::new(4, 8)), jpeg(4, 8)] {
            let fault = TexturePixels::for_host(&file.into(), &shape, (3, None)).unwrap_err().fault;
            assert!(matches!(fault, TextureFileFault::Size { width: 4, height: 8 }), "{fault}");
        }
        let forged = [&[0xff, 0xd8][..], &[0xff; 64], &[0xc0, 0, 0]].concat();
        assert!(TexturePixels::for_host(&forged.into(), &shape, (3, None)).is_err());
    }
}
