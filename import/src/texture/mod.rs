//! Texture files to mip levels, one blob each, coarse first.
//!
//! Colours become JPEG, or PNG where that is smaller or where there is transparency; heights stay
//! lossless, as grey PNG of 8 or 16 bits. The same file gives the same bytes on every machine: mips
//! are integer arithmetic, and the encoders are too.

mod mip;

use std::io::Cursor;
use std::path::{Path, PathBuf};

use image::codecs::jpeg::JpegEncoder;
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{DynamicImage, ExtendedColorType, ImageEncoder as _, ImageError, ImageReader, Limits};

use mip::Plane;

use crate::error::ImportError;
use crate::file::read_file;
use crate::model::ImageSource;

/// Longest side of a texture, in pixels.
pub const MAX_SIDE_PX: u32 = 16_384;
/// Most pixels of a texture: its finest level takes 8 bytes each while mips are made.
pub const MAX_PIXELS: u64 = 1 << 26;
/// Largest texture file, in bytes.
const MAX_FILE_BYTES: u64 = 1 << 30;
/// Halving stops at a level whose longer side is at most this: smaller levels cost a message each
/// and save nothing, since an 8 × 8 level is about 200 bytes.
const COARSEST_SIDE_PX: u32 = 8;
/// Quality of colour JPEGs, 1–100. 85 is where the artefacts of a photograph stop being visible at
/// its own resolution; the size grows by half from there to 92.
const JPEG_QUALITY: u8 = 85;

/// What a texture holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum TextureKind {
    /// sRGB colours, perhaps with opacity.
    Color,
    /// Heights: black is low, white is high; linear.
    Height,
}

/// A texture's mip levels.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Texture {
    /// What it holds.
    pub kind: TextureKind,
    /// Width of the finest level, in pixels.
    pub width_px: u32,
    /// Height of the finest level, in pixels.
    pub height_px: u32,
    /// Whether any pixel is transparent.
    pub alpha: bool,
    /// Mean colour, sRGB, taken in linear light and weighted by opacity; of colours alone.
    pub mean: Option<[u8; 3]>,
    /// Encoded levels, coarse first. Counted from the finest, level k is
    /// `max(1, width_px >> k) × max(1, height_px >> k)`, as GPUs have it.
    pub levels: Vec<Vec<u8>>,
}

/// A texture that cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum TextureError {
    /// The file cannot be read.
    #[error("{}: cannot be read: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// The file is no image that is read here.
    #[error("{}: is not a readable PNG or JPEG: {why}", path.display())]
    Decode {
        /// The file.
        path: PathBuf,
        /// Why.
        why: String,
    },
    /// The image is larger than supported.
    #[error(
        "{}: is {width_px} × {height_px} pixels; at most {MAX_SIDE_PX} on a side and {MAX_PIXELS} in all are supported, so scale it down",
        path.display()
    )]
    TooLarge {
        /// The file.
        path: PathBuf,
        /// Width in pixels.
        width_px: u32,
        /// Height in pixels.
        height_px: u32,
    },
    /// Where heights belong, the colours of a normal map were found.
    #[error("{}: looks like a normal map, but heights (grey) are needed for relief", path.display())]
    NormalMap {
        /// The file.
        path: PathBuf,
    },
    /// An encoder failed.
    #[error("{}: a mip level cannot be encoded: {why}", path.display())]
    Encode {
        /// The file.
        path: PathBuf,
        /// Why.
        why: String,
    },
}

/// Reads an image and encodes its mip levels.
///
/// # Errors
/// See [`TextureError`]. The size is checked before anything is decoded.
pub fn load(source: &ImageSource, kind: TextureKind) -> Result<Texture, TextureError> {
    let path = &*source.path;
    let image = match &source.bytes {
        Some(bytes) => decode(path, bytes)?,
        None => decode(path, &read(path)?)?,
    };
    match kind {
        TextureKind::Color => encode_color(path, &image),
        TextureKind::Height => encode_height(path, image),
    }
}

fn read(path: &Path) -> Result<Vec<u8>, TextureError> {
    read_file(path, MAX_FILE_BYTES).map_err(|error| TextureError::Read {
        path: path.to_owned(),
        source: match error {
            ImportError::Read { source, .. } => source,
            _ => std::io::Error::other("not a regular file, or too large"),
        },
    })
}

fn decode(path: &Path, bytes: &[u8]) -> Result<DynamicImage, TextureError> {
    let bad = |why: String| TextureError::Decode { path: path.to_owned(), why: one_line(&why) };
    let reader = || {
        let reader = ImageReader::new(Cursor::new(bytes)).with_guessed_format();
        reader.map_err(|error| bad(error.to_string()))
    };
    let (width_px, height_px) = reader()?.into_dimensions().map_err(|error| bad(error.to_string()))?;
    let too_large = || TextureError::TooLarge { path: path.to_owned(), width_px, height_px };
    let pixels = u64::from(width_px) * u64::from(height_px);
    if width_px > MAX_SIDE_PX || height_px > MAX_SIDE_PX || pixels > MAX_PIXELS {
        return Err(too_large());
    }
    if pixels == 0 {
        return Err(bad("it has no pixels".to_owned()));
    }
    let mut reader = reader()?;
    let mut limits = Limits::default();
    limits.max_image_width = Some(MAX_SIDE_PX);
    limits.max_image_height = Some(MAX_SIDE_PX);
    // Eight bytes a pixel is the widest format (16-bit RGBA); the rest is the decoders' own.
    limits.max_alloc = Some(MAX_PIXELS * 8 + (64 << 20));
    reader.limits(limits);
    reader.decode().map_err(|error| match error {
        ImageError::Limits(_) => too_large(),
        other => bad(other.to_string()),
    })
}

fn one_line(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

fn encode_color(path: &Path, image: &DynamicImage) -> Result<Texture, TextureError> {
    let rgba = image.to_rgba8();
    let (width_px, height_px) = rgba.dimensions();
    let alpha = rgba.pixels().any(|p| p.0[3] != u8::MAX);
    let grey = rgba.pixels().all(|p| p.0[0] == p.0[1] && p.0[1] == p.0[2]);
    let mut plane = Plane::<4>::from_srgb(&rgba);
    drop(rgba);
    let mut levels = Vec::new();
    loop {
        let encoded = encode_color_level(&plane, alpha, grey).map_err(|error| TextureError::Encode {
            path: path.to_owned(),
            why: one_line(&error.to_string()),
        })?;
        levels.push(encoded);
        if plane.width.max(plane.height) <= COARSEST_SIDE_PX {
            break;
        }
        plane = plane.halve_premultiplied();
    }
    levels.reverse();
    let mean = Some(plane.mean_srgb());
    Ok(Texture { kind: TextureKind::Color, width_px, height_px, alpha, mean, levels })
}

fn encode_color_level(plane: &Plane<4>, alpha: bool, grey: bool) -> Result<Vec<u8>, ImageError> {
    let rgba = plane.to_srgb();
    let pixels = rgba.as_chunks::<4>().0;
    if alpha {
        return png(&rgba, plane.width, plane.height, ExtendedColorType::Rgba8);
    }
    let (bytes, format): (Vec<u8>, _) = if grey {
        (pixels.iter().map(|p| p[0]).collect(), ExtendedColorType::L8)
    } else {
        (pixels.iter().flat_map(|p| [p[0], p[1], p[2]]).collect(), ExtendedColorType::Rgb8)
    };
    let lossless = png(&bytes, plane.width, plane.height, format)?;
    let mut jpeg = Vec::new();
    JpegEncoder::new_with_quality(&mut jpeg, JPEG_QUALITY).encode(
        &bytes,
        plane.width,
        plane.height,
        format,
    )?;
    Ok(if lossless.len() <= jpeg.len() { lossless } else { jpeg })
}

fn png(bytes: &[u8], width: u32, height: u32, format: ExtendedColorType) -> Result<Vec<u8>, ImageError> {
    let mut out = Vec::new();
    PngEncoder::new_with_quality(&mut out, CompressionType::Default, FilterType::Adaptive)
        .write_image(bytes, width, height, format)?;
    Ok(out)
}

fn encode_height(path: &Path, image: DynamicImage) -> Result<Texture, TextureError> {
    if looks_like_normals(&image) {
        return Err(TextureError::NormalMap { path: path.to_owned() });
    }
    let deep = matches!(
        image,
        DynamicImage::ImageLuma16(_)
            | DynamicImage::ImageLumaA16(_)
            | DynamicImage::ImageRgb16(_)
            | DynamicImage::ImageRgba16(_)
    );
    let (width_px, height_px) = (image.width(), image.height());
    let mut plane = Plane::<1>::from_heights(&image, deep);
    drop(image);
    let mut levels = Vec::new();
    loop {
        let (bytes, format) = if deep {
            // Sixteen-bit samples are taken in native order and written in PNG's.
            (plane.samples.iter().flat_map(|s| s[0].to_ne_bytes()).collect(), ExtendedColorType::L16)
        } else {
            (plane.samples.iter().map(|s| s[0] as u8).collect::<Vec<u8>>(), ExtendedColorType::L8)
        };
        let encoded = png(&bytes, plane.width, plane.height, format).map_err(|error| {
            TextureError::Encode { path: path.to_owned(), why: one_line(&error.to_string()) }
        })?;
        levels.push(encoded);
        if plane.width.max(plane.height) <= COARSEST_SIDE_PX {
            break;
        }
        plane = plane.halve();
    }
    levels.reverse();
    Ok(Texture { kind: TextureKind::Height, width_px, height_px, alpha: false, mean: None, levels })
}

/// Exporters often write normal maps as `map_Bump`: bluish, with red and green about the middle.
fn looks_like_normals(image: &DynamicImage) -> bool {
    if !image.color().has_color() {
        return false;
    }
    let rgb = image.to_rgb8();
    let mut sums = [0u64; 3];
    for pixel in rgb.pixels() {
        for (sum, &value) in sums.iter_mut().zip(&pixel.0) {
            *sum += u64::from(value);
        }
    }
    let count = u64::from(rgb.width()) * u64::from(rgb.height());
    let [r, g, b] = sums.map(|sum| sum / count.max(1));
    b >= 200 && r.abs_diff(128) <= 32 && g.abs_diff(128) <= 32
}

#[cfg(test)]
mod tests;
