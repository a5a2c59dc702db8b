//! Colour textures, with or without opacity.

use std::path::{Path, PathBuf};

use image::{ExtendedColorType, ImageError, Rgba, RgbaImage};
use lodestream_geometry::pool::Pool;
use lodestream_scene::asset::TextureKind;

use super::channel::Channels;
use super::chroma;
use super::coverage::Coverage;
use super::decode::decode;
use super::encode::{Rectangle, levels};
use super::error::TextureError;
use super::levels::Texture;
use super::mip::Plane;
use super::quality::TextureQuality;
use super::source::{Opacity, Transparency};
use super::webp;
use crate::model::{Channel, ImageSource};

pub(super) fn load(
    image: Option<&ImageSource>,
    opacity: Option<&Channel>,
    used: Opacity,
    (quality, pool): (TextureQuality, &dyn Pool),
) -> Result<Texture, TextureError> {
    let (path, mut rgba) = composed(image, opacity)?;
    let transparency = if used == Opacity::Ignored {
        // Coarser levels weight colours by opacity, so transparent texels would lose theirs.
        rgba.pixels_mut().for_each(|p| p.0[3] = u8::MAX);
        Transparency::None
    } else {
        transparency(&rgba)
    };
    let threshold = match used {
        Opacity::Tested(threshold) => Some(threshold),
        Opacity::Guessed if transparency == Transparency::Holes => Some(128),
        _ => None,
    };
    let coverage = threshold.map(|threshold| Coverage::of(&rgba, threshold));
    encode(&path, rgba, transparency, coverage.as_ref(), (quality, pool))
}

/// Combines colours and opacity at the larger size of the two.
fn composed(
    image: Option<&ImageSource>,
    opacity: Option<&Channel>,
) -> Result<(PathBuf, RgbaImage), TextureError> {
    let path = image.or(opacity.map(|o| &o.image)).map(|image| image.path.clone()).unwrap_or_default();
    let Some(channel) = opacity else {
        let image = image.map(decode).transpose()?;
        return Ok((path, image.map_or_else(|| RgbaImage::new(1, 1), |image| image.to_rgba8())));
    };
    let mut channels = Channels::default();
    let mask = channels.plane(channel)?;
    let Some(image) = image else {
        let white = |x, y| Rgba([u8::MAX, u8::MAX, u8::MAX, mask.byte(x, y)]);
        return Ok((path, RgbaImage::from_fn(mask.width, mask.height, white)));
    };
    let colors = channels.image(image)?.to_rgba8();
    let size = super::channel::larger([colors.dimensions(), (mask.width, mask.height)]);
    let mask = mask.resized(size);
    // Resized in linear light.
    let mut colors = if colors.dimensions() == size {
        colors
    } else {
        let bytes = Plane::<4>::from_srgb(&colors).resized(size).to_srgb();
        RgbaImage::from_raw(size.0, size.1, bytes).unwrap_or_default()
    };
    for (x, y, pixel) in colors.enumerate_pixels_mut() {
        pixel.0[3] = mask.byte(x, y);
    }
    Ok((path, colors))
}

fn transparency(rgba: &RgbaImage) -> Transparency {
    if rgba.pixels().all(|p| p.0[3] == u8::MAX) {
        return Transparency::None;
    }
    let between = rgba.pixels().filter(|p| (32..224).contains(&p.0[3])).count();
    if between * 10 <= rgba.pixels().len() { Transparency::Holes } else { Transparency::Graded }
}

fn encode(
    path: &Path,
    rgba: RgbaImage,
    transparency: Transparency,
    coverage: Option<&Coverage>,
    (quality, pool): (TextureQuality, &dyn Pool),
) -> Result<Texture, TextureError> {
    let (width_px, height_px) = rgba.dimensions();
    let grey = rgba.pixels().all(|p| p.0[0] == p.0[1] && p.0[1] == p.0[2]);
    let alpha = transparency != Transparency::None;
    let plane = Plane::<4>::from_srgb(&rgba);
    drop(rgba);
    let encode = |plane: &Plane<4>| encode_level(plane, (alpha, grey), coverage, quality);
    let (levels, coarsest) =
        levels((path, TextureKind::Color), plane, Plane::halve_premultiplied, encode, pool)?;
    let mean = Some(coarsest.mean_srgb());
    Ok(Texture { kind: TextureKind::Color, width_px, height_px, planes: 0, transparency, mean, levels })
}

fn encode_level(
    plane: &Plane<4>,
    (alpha, grey): (bool, bool),
    coverage: Option<&Coverage>,
    quality: TextureQuality,
) -> Result<Vec<u8>, ImageError> {
    let mut rgba = plane.to_srgb();
    let (width, height) = (plane.width, plane.height);
    let rectangle = |bytes, format| Rectangle { bytes, width, height, format };
    if alpha {
        if let Some(coverage) = coverage {
            coverage.restore(&mut rgba);
        }
        let whole = rectangle(&rgba, ExtendedColorType::Rgba8);
        let lossy = !quality.is_lossless() && width.max(height) <= webp::MAX_SIDE_PX;
        return if lossy {
            whole.png_or(webp::with_alpha(&rgba, (width, height), quality)?)
        } else {
            whole.png()
        };
    }
    let pixels = rgba.as_chunks::<4>().0;
    let rgb: Vec<u8> = pixels.iter().flat_map(|p| [p[0], p[1], p[2]]).collect();
    let one: Vec<u8> = if grey { pixels.iter().map(|p| p[0]).collect() } else { Vec::new() };
    drop(rgba);
    let whole =
        if grey { rectangle(&one, ExtendedColorType::L8) } else { rectangle(&rgb, ExtendedColorType::Rgb8) };
    if quality.is_lossless() { whole.png() } else { whole.png_or(chroma::lossy(&rgb, whole, quality)?) }
}
