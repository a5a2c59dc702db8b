//! Image files to pixels, within limits.

use std::io::Cursor;
use std::path::Path;

use image::{DynamicImage, ImageError, ImageReader, Limits};

use super::error::{TextureError, one_line};
use super::limits::{MAX_PIXELS, MAX_SIDE_PX};
use crate::error::ImportError;
use crate::file::read_file;
use crate::model::ImageSource;

/// Largest texture file, in bytes.
const MAX_FILE_BYTES: u64 = 1 << 30;

/// Reads an image. The size is checked before anything is decoded.
pub(super) fn decode(source: &ImageSource) -> Result<DynamicImage, TextureError> {
    let path = &*source.path;
    match &source.bytes {
        Some(bytes) => decode_bytes(path, bytes),
        None => decode_bytes(path, &read(path)?),
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

fn decode_bytes(path: &Path, bytes: &[u8]) -> Result<DynamicImage, TextureError> {
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
