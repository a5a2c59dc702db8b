//! Errors of chroma, of which lossy WebP keeps half the resolution.

use image::{ExtendedColorType, ImageError};

use super::encode::Rectangle;
use super::quality::TextureSettings;
use super::subsampling::{chroma, lost, mean_square};
use super::webp;

/// Mean squared error of the chroma, of 255², up to which WebP is taken without comparison. Photographs have 0.3 to 5,
/// coloured lines of a texel, as of bricks far away, 20 to 90, and look washed out.
const SMALL_ERROR: f64 = 8.0;
/// How many times as large WebP's error must be for JPEG with full chroma to be taken: noise has as large errors in both,
/// and takes up to three times the bytes as JPEG; lines have a quarter in JPEG.
const WORTH: f64 = 2.0;
/// Lost chroma up to which WebP's error is not measured: what it adds is below [`SMALL_ERROR`] then.
const LITTLE_LOST: f64 = 2.0;

/// The lossy file of an opaque picture: WebP, or JPEG where that saves chroma.
pub(super) fn lossy(
    rgb: &[u8],
    whole: Rectangle<'_>,
    settings: TextureSettings,
) -> Result<Vec<u8>, ImageError> {
    let (width, height) = (whole.width, whole.height);
    if width.max(height) > webp::MAX_SIDE_PX {
        return whole.jpeg(settings.quality.jpeg());
    }
    let lost = lost(rgb, width as usize);
    let file = webp::opaque(rgb, (width, height), lost, settings)?;
    if whole.format == ExtendedColorType::L8 || lost <= LITTLE_LOST {
        return Ok(file);
    }
    let off = error(&file, rgb)?;
    if off > SMALL_ERROR {
        let full = whole.jpeg(settings.quality.jpeg())?;
        if WORTH * error(&full, rgb)? <= off {
            return Ok(full);
        }
    }
    Ok(file)
}

/// Mean squared error of a file's chroma.
fn error(file: &[u8], rgb: &[u8]) -> Result<f64, ImageError> {
    let coded = image::load_from_memory(file)?.into_rgb8();
    let pairs = coded.as_raw().as_chunks::<3>().0.iter().zip(rgb.as_chunks::<3>().0);
    let square = |(a, b): (&[u8; 3], &[u8; 3])| {
        let ([u, v], [s, t]) = (chroma(*a), chroma(*b));
        u128::from((u - s).unsigned_abs().pow(2) + (v - t).unsigned_abs().pow(2))
    };
    let sum: u128 = pairs.map(square).sum();
    Ok(mean_square(sum, rgb.len()))
}
