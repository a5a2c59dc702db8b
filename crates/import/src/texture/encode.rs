//! Levels from fine to coarse, and their image files.

use std::path::Path;

use image::codecs::jpeg::JpegEncoder;
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder as _, ImageError};

use super::error::{TextureError, one_line};
use super::mip::Plane;

/// Halving stops at a level whose longer side is at most this: smaller levels cost a message each
/// and save nothing, since an 8 × 8 level is about 200 bytes.
const COARSEST_SIDE_PX: u32 = 8;

/// Encoded levels, coarse first, and the coarsest as a plane.
pub(super) fn levels<const N: usize>(
    path: &Path,
    mut plane: Plane<N>,
    halve: impl Fn(&Plane<N>) -> Plane<N>,
    encode: impl Fn(&Plane<N>) -> Result<Vec<u8>, ImageError>,
) -> Result<(Vec<Vec<u8>>, Plane<N>), TextureError> {
    let mut levels = Vec::new();
    loop {
        let encoded = encode(&plane).map_err(|error| TextureError::Encode {
            path: path.to_owned(),
            why: one_line(&error.to_string()),
        })?;
        levels.push(encoded);
        if plane.width.max(plane.height) <= COARSEST_SIDE_PX {
            levels.reverse();
            return Ok((levels, plane));
        }
        plane = halve(&plane);
    }
}

/// JPEG of three full channels or of grey, or PNG where that is smaller.
pub(super) fn smaller(
    bytes: &[u8],
    width: u32,
    height: u32,
    format: ExtendedColorType,
    quality: u8,
) -> Result<Vec<u8>, ImageError> {
    let lossless = png(bytes, width, height, format)?;
    let mut jpeg = Vec::new();
    JpegEncoder::new_with_quality(&mut jpeg, quality).encode(bytes, width, height, format)?;
    Ok(if lossless.len() <= jpeg.len() { lossless } else { jpeg })
}

pub(super) fn png(
    bytes: &[u8],
    width: u32,
    height: u32,
    format: ExtendedColorType,
) -> Result<Vec<u8>, ImageError> {
    let mut out = Vec::new();
    PngEncoder::new_with_quality(&mut out, CompressionType::Default, FilterType::Adaptive)
        .write_image(bytes, width, height, format)?;
    Ok(out)
}
