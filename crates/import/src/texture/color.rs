//! Colour textures, with or without opacity.

use std::path::PathBuf;

use image::{ExtendedColorType, ImageError, Rgba, RgbaImage};
use lodestream_geometry::pool::Pool;
use lodestream_scene::asset::TextureKind;

use super::channel::Channels;
use super::chroma;
use super::coverage::{Coverage, Opacities};
use super::encode::{Rectangle, levels};
use super::error::TextureError;
use super::levels::Texture;
use super::mip::{ByOpacity, Plane, linear};
use super::quality::TextureSettings;
use super::rows::Rows;
use super::source::{Opacity, Transparency};
use super::strips::{STRIP_ROWS, Strips};
use super::webp;
use crate::model::{Channel, ImageSource};

pub(super) fn load(
    image: Option<&ImageSource>,
    opacity: Option<&Channel>,
    used: Opacity,
    (settings, pool): (TextureSettings, &dyn Pool),
) -> Result<Texture, TextureError> {
    let mut rows = match (image, opacity) {
        (Some(image), None) => Rows::open(image)?,
        _ => {
            let (path, rgba) = composed(image, opacity)?;
            Rows::of(path, rgba.into())
        }
    };
    let (mut transparency, mut coverage) = (Transparency::None, None);
    if used != Opacity::Ignored && rows.has_alpha() {
        let opacities = Opacities::read(&mut rows)?;
        rows.rewind()?;
        transparency = opacities.transparency();
        coverage = opacities.coverage(used);
    }
    let alpha = transparency != Transparency::None;
    let path = rows.path().clone();
    let [width_px, height_px] = rows.size();
    let mut strips = Colors { rows, is_opaque: !alpha };
    let encode = |level: usize, plane: &Plane<4>| {
        encode_image(plane, alpha, coverage.as_ref().map(|c| (c, level)), settings)
    };
    let (levels, coarsest) = levels::<4, ByOpacity>((&path, TextureKind::Color), &mut strips, encode, pool)?;
    let mean = Some(coarsest.mean_srgb());
    Ok(Texture { kind: TextureKind::Color, width_px, height_px, planes: 0, transparency, mean, levels })
}

/// Colours in linear light.
struct Colors {
    rows: Rows,
    /// Whether opacity is ignored. Coarser levels weight colours by opacity, so transparent texels would lose theirs.
    is_opaque: bool,
}

impl Strips<4> for Colors {
    fn size(&self) -> [u32; 2] {
        self.rows.size()
    }

    fn next(&mut self) -> Result<Vec<[u16; 4]>, TextureError> {
        let mut rgba = self.rows.next(STRIP_ROWS)?.into_rgba8();
        if self.is_opaque {
            rgba.pixels_mut().for_each(|p| p.0[3] = u8::MAX);
        }
        Ok(linear(&rgba))
    }
}

/// Combines colours and opacity at the larger size of the two.
fn composed(
    image: Option<&ImageSource>,
    opacity: Option<&Channel>,
) -> Result<(PathBuf, RgbaImage), TextureError> {
    let path = image.or(opacity.map(|o| &o.image)).map(|image| image.path.clone()).unwrap_or_default();
    let Some(channel) = opacity else {
        return Ok((path, RgbaImage::new(1, 1)));
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

fn encode_image(
    plane: &Plane<4>,
    alpha: bool,
    coverage: Option<(&Coverage, usize)>,
    settings: TextureSettings,
) -> Result<Vec<u8>, ImageError> {
    let mut rgba = plane.to_srgb();
    let (width, height) = (plane.width, plane.height);
    let rectangle = |bytes, format| Rectangle { bytes, width, height, format };
    if alpha {
        if let Some((coverage, level)) = coverage {
            coverage.restore(level, &mut rgba);
        }
        let whole = rectangle(&rgba, ExtendedColorType::Rgba8);
        let lossy = !settings.quality.is_lossless() && width.max(height) <= webp::MAX_SIDE_PX;
        return if lossy {
            whole.png_or(webp::with_alpha(&rgba, (width, height), settings)?)
        } else {
            whole.png()
        };
    }
    let pixels = rgba.as_chunks::<4>().0;
    let rgb: Vec<u8> = pixels.iter().flat_map(|p| [p[0], p[1], p[2]]).collect();
    let grey = pixels.iter().all(|p| p[0] == p[1] && p[1] == p[2]);
    let one: Vec<u8> = if grey { pixels.iter().map(|p| p[0]).collect() } else { Vec::new() };
    drop(rgba);
    let whole =
        if grey { rectangle(&one, ExtendedColorType::L8) } else { rectangle(&rgb, ExtendedColorType::Rgb8) };
    if settings.quality.is_lossless() {
        whole.png()
    } else {
        whole.png_or(chroma::lossy(&rgb, whole, settings)?)
    }
}
