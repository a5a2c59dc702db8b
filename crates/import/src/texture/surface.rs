//! Surface textures: occlusion, roughness and metal from one image or several.

use image::ExtendedColorType;
use lodestream_geometry::pool::Pool;
use lodestream_scene::asset::TextureKind;

use super::channel::{Channels, larger};
use super::encode::{Rectangle, levels};
use super::error::TextureError;
use super::levels::Texture;
use super::mip::Plane;
use super::source::Transparency;
use crate::model::SurfaceMap;

/// Quality of JPEGs of surfaces, whose three channels are nearly independent. Of FlightHelmet's five maps
/// roughness is off by 2.2 of 255 in the mean and 11 at the 99th percentile, metal by 1.6 and 13, in 383 kB; at 90 by
/// 1.9 and 9, 1.4 and 11, in 489 kB; as PNG they take 1,434 kB.
pub(super) const JPEG_QUALITY: u8 = 85;

pub(super) fn load(map: &SurfaceMap, pool: &dyn Pool) -> Result<Texture, TextureError> {
    let mut images = Channels::default();
    let mut planes = Vec::new();
    for channel in map.channels() {
        planes.push(channel.map(|channel| images.plane(channel)).transpose()?);
    }
    drop(images);
    let path = map.channels().into_iter().flatten().next().map(|c| c.image.path.clone()).unwrap_or_default();
    let (width_px, height_px) = larger(planes.iter().flatten().map(|plane| (plane.width, plane.height)));
    let size = (width_px, height_px);
    let mut samples = vec![[u16::MAX; 3]; width_px as usize * height_px as usize];
    for (c, plane) in planes.into_iter().enumerate() {
        let Some(plane) = plane.map(|plane| plane.resized(size)) else { continue };
        for (sample, [value]) in samples.iter_mut().zip(&plane.samples) {
            sample[c] = *value;
        }
    }
    let plane = Plane { width: width_px, height: height_px, samples };
    let encode = |plane: &Plane<3>| {
        let bytes: Vec<u8> = plane.samples.iter().flat_map(|s| s.map(byte)).collect();
        let Plane { width, height, .. } = *plane;
        let whole = Rectangle { bytes: &bytes, width, height, format: ExtendedColorType::Rgb8 };
        whole.png_or(whole.jpeg(JPEG_QUALITY)?)
    };
    let (levels, coarsest) = levels((&path, TextureKind::Surface), plane, Plane::halve, encode, pool)?;
    let mean = Some(coarsest.mean().map(byte));
    let transparency = Transparency::None;
    Ok(Texture { kind: TextureKind::Surface, width_px, height_px, transparency, mean, levels })
}

fn byte(value: u16) -> u8 {
    ((u32::from(value) + 128) / 257) as u8
}
