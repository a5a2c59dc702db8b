//! Height textures, encoded losslessly.

use image::{DynamicImage, ExtendedColorType};
use lodestream_geometry::pool::Pool;
use lodestream_scene::asset::TextureKind;

use super::decode::decode_whole;
use super::encode::{Rectangle, levels};
use super::error::TextureError;
use super::levels::Texture;
use super::mip::{Plain, Plane};
use super::source::Transparency;
use super::strips::PlaneStrips;
use crate::model::ImageSource;

pub(super) fn load(source: &ImageSource, pool: &dyn Pool) -> Result<Texture, TextureError> {
    let image = decode_whole(source)?;
    if looks_like_normals(&image) {
        return Err(TextureError::NormalMap { path: source.path.clone() });
    }
    let deep = matches!(
        image,
        DynamicImage::ImageLuma16(_)
            | DynamicImage::ImageLumaA16(_)
            | DynamicImage::ImageRgb16(_)
            | DynamicImage::ImageRgba16(_)
    );
    let (width_px, height_px) = (image.width(), image.height());
    let plane = Plane::<1>::from_heights(&image, deep);
    drop(image);
    let encode = |_, plane: &Plane<1>| {
        let (bytes, format) = if deep {
            // Sixteen-bit samples are taken in native order and written in PNG's.
            (plane.samples.iter().flat_map(|s| s[0].to_ne_bytes()).collect(), ExtendedColorType::L16)
        } else {
            (plane.samples.iter().map(|s| s[0] as u8).collect::<Vec<u8>>(), ExtendedColorType::L8)
        };
        let Plane { width, height, .. } = *plane;
        Rectangle { bytes: &bytes, width, height, format }.png()
    };
    let mut strips = PlaneStrips::from(plane);
    let (levels, _) = levels::<1, Plain>((&source.path, TextureKind::Height), &mut strips, encode, pool)?;
    let transparency = Transparency::None;
    Ok(Texture {
        kind: TextureKind::Height,
        width_px,
        height_px,
        planes: 0,
        transparency,
        mean: None,
        levels,
    })
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
