//! Files of normals and surfaces: grey planes in WebP, or PNG.

use image::{ExtendedColorType, ImageError};

use super::encode::Rectangle;
use super::quality::TextureSettings;
use super::webp;

/// The file of an image of three bytes per pixel: PNG of all, or WebP of some channels (1 red, 2 green, 4 blue), from
/// which the others follow.
pub(super) fn encode(
    rgb: &[u8],
    (width, height): (u32, u32),
    channels: u8,
    settings: TextureSettings,
) -> Result<Vec<u8>, ImageError> {
    let whole = Rectangle { bytes: rgb, width, height, format: ExtendedColorType::Rgb8 };
    let stacked = (width, height * channels.count_ones());
    if settings.quality.is_lossless() || channels == 0 || stacked.0.max(stacked.1) > webp::MAX_SIDE_PX {
        return whole.png();
    }
    let pixels = rgb.as_chunks::<3>().0;
    let planes = (0..3).filter(|c| channels >> c & 1 != 0);
    let grey: Vec<u8> = planes.flat_map(|c: usize| pixels.iter().map(move |pixel| pixel[c])).collect();
    whole.png_or(webp::planes(&grey, stacked, settings)?)
}
