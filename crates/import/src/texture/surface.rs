//! Surface textures: occlusion, roughness and metal from one image or several.

use lodestream_geometry::pool::Pool;
use lodestream_scene::asset::TextureKind;

use super::channel::{Channels, larger, values};
use super::encode::levels;
use super::error::TextureError;
use super::levels::Texture;
use super::mip::{Plain, Plane};
use super::planes;
use super::quality::TextureSettings;
use super::rows::Rows;
use super::source::Transparency;
use super::strips::{PlaneStrips, STRIP_ROWS, Strips};
use crate::model::{Channel, Component, ImageSource, SurfaceMap};

pub(super) fn load(
    map: &SurfaceMap,
    (settings, pool): (TextureSettings, &dyn Pool),
) -> Result<Texture, TextureError> {
    let path = map.channels().into_iter().flatten().next().map(|c| c.image.path.clone()).unwrap_or_default();
    let mut strips = Surface::open(map)?;
    let channels = varying(&mut strips)?;
    strips.rewind()?;
    let [width_px, height_px] = strips.size();
    let encode = |_, plane: &Plane<3>| {
        let bytes: Vec<u8> = plane.samples.iter().flat_map(|s| s.map(byte)).collect();
        let Plane { width, height, .. } = *plane;
        planes::encode(&bytes, (width, height), channels, settings)
    };
    let (levels, coarsest) = levels::<3, Plain>((&path, TextureKind::Surface), &mut strips, encode, pool)?;
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

/// The channels that vary, a bit each. A mean of equal bytes is that byte, so what varies does so in the finest level.
fn varying(strips: &mut Surface) -> Result<u8, TextureError> {
    let (mut first, mut channels) = (None, 0);
    while channels != 0b111 {
        let strip = strips.next()?;
        let Some(sample) = strip.first() else { break };
        let first = *first.get_or_insert(sample.map(byte));
        let varies = |c: usize| strip.iter().any(|sample| byte(sample[c]) != first[c]);
        channels = (0..3).filter(|&c| varies(c)).fold(channels, |channels, c| channels | 1 << c);
    }
    Ok(channels)
}

/// Values of occlusion, roughness and metal; one where there is no map.
enum Surface {
    /// Of images of one size: each image once, and for each channel its image's number.
    Rows { images: Vec<Rows>, channels: [Option<(usize, Channel)>; 3] },
    /// Of images that were resized.
    Resized(PlaneStrips<3>),
}

impl Surface {
    fn open(map: &SurfaceMap) -> Result<Self, TextureError> {
        let mut sources: Vec<&ImageSource> = Vec::new();
        let mut number = |channel: &Channel, of| {
            let known = sources.iter().position(|image| **image == channel.image);
            known.unwrap_or_else(|| {
                sources.push(of);
                sources.len() - 1
            })
        };
        let channels = map.channels().map(|c| c.map(|c| (number(c, &c.image), c.clone())));
        let by_rows = map.channels().into_iter().flatten().all(|c| c.component != Component::Mask);
        if by_rows {
            let images: Vec<Rows> = sources.into_iter().map(Rows::open).collect::<Result<_, _>>()?;
            if images.iter().all(|image| image.size() == images[0].size()) && !images.is_empty() {
                return Ok(Self::Rows { images, channels });
            }
        }
        Ok(Self::Resized(resized(map)?.into()))
    }

    /// Goes back to the first row.
    fn rewind(&mut self) -> Result<(), TextureError> {
        match self {
            Self::Rows { images, .. } => images.iter_mut().try_for_each(Rows::rewind),
            Self::Resized(strips) => {
                strips.rewind();
                Ok(())
            }
        }
    }
}

impl Strips<3> for Surface {
    fn size(&self) -> [u32; 2] {
        match self {
            Self::Rows { images, .. } => images.first().map_or([1, 1], Rows::size),
            Self::Resized(strips) => strips.size(),
        }
    }

    fn next(&mut self) -> Result<Vec<[u16; 3]>, TextureError> {
        let (images, channels) = match self {
            Self::Rows { images, channels } => (images, channels),
            Self::Resized(strips) => return strips.next(),
        };
        let strips: Vec<_> =
            images.iter_mut().map(|image| image.next(STRIP_ROWS)).collect::<Result<_, _>>()?;
        let count = strips.first().map_or(0, |strip| strip.width() as usize * strip.height() as usize);
        let mut samples = vec![[u16::MAX; 3]; count];
        for (c, channel) in channels.iter().enumerate() {
            let Some((image, channel)) = channel else { continue };
            for (sample, value) in samples.iter_mut().zip(values(&strips[*image], channel)) {
                sample[c] = value;
            }
        }
        Ok(samples)
    }
}

/// The channels at the size of the largest.
fn resized(map: &SurfaceMap) -> Result<Plane<3>, TextureError> {
    let mut images = Channels::default();
    let mut planes = Vec::new();
    for channel in map.channels() {
        planes.push(channel.map(|channel| images.plane(channel)).transpose()?);
    }
    drop(images);
    let (width, height) = larger(planes.iter().flatten().map(|plane| (plane.width, plane.height)));
    let mut samples = vec![[u16::MAX; 3]; width as usize * height as usize];
    for (c, plane) in planes.into_iter().enumerate() {
        let Some(plane) = plane.map(|plane| plane.resized((width, height))) else { continue };
        for (sample, [value]) in samples.iter_mut().zip(&plane.samples) {
            sample[c] = *value;
        }
    }
    Ok(Plane { width, height, samples })
}

fn byte(value: u16) -> u8 {
    ((u32::from(value) + 128) / 257) as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn maps_of_one_size_are_the_same_by_rows_and_at_once() {
        let dir = tempfile::TempDir::new().unwrap();
        let save = |name: &str, by: u32| {
            let path = dir.path().join(name);
            image::RgbImage::from_fn(9, 300, |x, y| image::Rgb([(x * by) as u8, (y * by) as u8, 7]))
                .save(&path)
                .unwrap();
            ImageSource::from(path)
        };
        let (a, b) = (save("a.png", 3), save("b.png", 5));
        let map = SurfaceMap {
            occlusion: Some(Channel::plain(a.clone(), Component::Green)),
            roughness: Some(Channel {
                inverted: true,
                strength: 50_000,
                ..Channel::plain(b, Component::Luminance)
            }),
            metallic: Some(Channel::plain(a, Component::Red)),
        };
        let mut strips = Surface::open(&map).unwrap();
        assert!(matches!(&strips, Surface::Rows { images, .. } if images.len() == 2));
        for _ in 0..2 {
            let rows: Vec<_> = std::iter::repeat_with(|| strips.next().unwrap()).take(3).flatten().collect();
            assert_eq!(rows, resized(&map).unwrap().samples);
            strips.rewind().unwrap();
        }
    }
}
