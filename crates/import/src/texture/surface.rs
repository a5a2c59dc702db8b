//! Surface textures: occlusion, roughness and metal from one image or several.

use lodestream_geometry::pool::Pool;
use lodestream_scene::asset::TextureKind;

use super::channel::{Channels, larger};
use super::encode::levels;
use super::error::TextureError;
use super::levels::Texture;
use super::mip::Plane;
use super::planes;
use super::quality::TextureQuality;
use super::source::Transparency;
use crate::model::SurfaceMap;

pub(super) fn load(
    map: &SurfaceMap,
    (quality, pool): (TextureQuality, &dyn Pool),
) -> Result<Texture, TextureError> {
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
    // A mean of equal bytes is that byte, so what varies does so in the finest level.
    let first = plane.samples.first().map_or([0; 3], |sample| sample.map(byte));
    let varies = |c: usize| plane.samples.iter().any(|sample| byte(sample[c]) != first[c]);
    let channels = (0..3).filter(|&c| varies(c)).fold(0, |channels, c| channels | 1 << c);
    let encode = |plane: &Plane<3>| {
        let bytes: Vec<u8> = plane.samples.iter().flat_map(|s| s.map(byte)).collect();
        let Plane { width, height, .. } = *plane;
        planes::encode(&bytes, (width, height), channels, quality)
    };
    let (levels, coarsest) = levels((&path, TextureKind::Surface), plane, Plane::halve, encode, pool)?;
    let mean = Some(coarsest.mean().map(byte));
    let transparency = Transparency::None;
    Ok(Texture {
        kind: TextureKind::Surface,
        width_px,
        height_px,
        planes: channels,
        transparency,
        mean,
        levels,
    })
}

fn byte(value: u16) -> u8 {
    ((u32::from(value) + 128) / 257) as u8
}
