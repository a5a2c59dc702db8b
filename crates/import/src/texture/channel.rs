//! Single channels of images, resized to one size, so that maps in several files become one texture.

use std::collections::BTreeMap;

use image::DynamicImage;

use super::decode::decode_whole;
use super::error::TextureError;
use super::mip::Plane;
use crate::model::{Channel, Component, ImageSource};

/// Cache of decoded images: an image of several channels is decoded once.
#[derive(Default)]
pub(super) struct Channels {
    decoded: BTreeMap<ImageSource, DynamicImage>,
}

impl Channels {
    pub(super) fn image(&mut self, source: &ImageSource) -> Result<&DynamicImage, TextureError> {
        if !self.decoded.contains_key(source) {
            self.decoded.insert(source.clone(), decode_whole(source)?);
        }
        Ok(&self.decoded[source])
    }

    /// The values of a channel, in 16 bits.
    pub(super) fn plane(&mut self, channel: &Channel) -> Result<Plane<1>, TextureError> {
        let image = self.image(&channel.image)?;
        let samples = values(image, channel).into_iter().map(|value| [value]).collect();
        Ok(Plane { width: image.width(), height: image.height(), samples })
    }
}

/// The values of an image's channel, in 16 bits.
pub(super) fn values(image: &DynamicImage, channel: &Channel) -> Vec<u16> {
    let strength = u64::from(channel.strength);
    let one = u64::from(u16::MAX);
    let value = |byte: u8| {
        let value = u64::from(if channel.inverted { 255 - byte } else { byte }) * 257;
        // 1 + strength · (value − 1), rounded.
        (one - (strength * (one - value) + one / 2) / one) as u16
    };
    component(image, channel.component).into_iter().map(value).collect()
}

fn component(image: &DynamicImage, component: Component) -> Vec<u8> {
    let channel = |i: usize| image.to_rgba8().pixels().map(|p| p.0[i]).collect::<Vec<u8>>();
    match component {
        Component::Red => channel(0),
        Component::Green => channel(1),
        Component::Blue => channel(2),
        Component::Alpha => channel(3),
        Component::Luminance => image.to_luma8().into_raw(),
        Component::Mask => {
            let alpha = channel(3);
            if alpha.iter().any(|&a| a != u8::MAX) { alpha } else { image.to_luma8().into_raw() }
        }
    }
}

/// The size with the most pixels, the first of several.
pub(super) fn larger(sizes: impl IntoIterator<Item = (u32, u32)>) -> (u32, u32) {
    let pixels = |&(width, height): &(u32, u32)| u64::from(width) * u64::from(height);
    sizes.into_iter().fold((1, 1), |most, size| if pixels(&size) > pixels(&most) { size } else { most })
}

/// For each output pixel of one axis: the two input pixels about its centre, and the weight of the second, out of twice
/// the outputs. What lies beyond the edge is the edge.
fn between(input: u32, output: u32) -> Vec<(usize, usize, u64)> {
    let (n, m) = (i64::from(input), i64::from(output));
    (0..m)
        .map(|i| {
            let at = ((2 * i + 1) * n - m).clamp(0, 2 * m * (n - 1));
            let first = at / (2 * m);
            (first as usize, (first + 1).min(n - 1) as usize, (at % (2 * m)) as u64)
        })
        .collect()
}

impl<const N: usize> Plane<N> {
    /// Resizes bilinearly; exact up to the rounding of the result.
    pub(super) fn resized(self, (width, height): (u32, u32)) -> Self {
        if (self.width, self.height) == (width, height) {
            return self;
        }
        let (columns, rows) = (between(self.width, width), between(self.height, height));
        let (across, down) = (2 * u64::from(width), 2 * u64::from(height));
        let stride = self.width as usize;
        let mut samples = Vec::with_capacity(columns.len() * rows.len());
        for &(top, bottom, below) in &rows {
            for &(left, right, beside) in &columns {
                let at = |y: usize, x: usize, c: usize| u64::from(self.samples[y * stride + x][c]);
                samples.push(std::array::from_fn(|c| {
                    let upper = at(top, left, c) * (across - beside) + at(top, right, c) * beside;
                    let lower = at(bottom, left, c) * (across - beside) + at(bottom, right, c) * beside;
                    let total = across * down;
                    ((upper * (down - below) + lower * below + total / 2) / total) as u16
                }));
            }
        }
        Self { width, height, samples }
    }
}

impl Plane<1> {
    /// A value rounded to eight bits.
    pub(super) fn byte(&self, x: u32, y: u32) -> u8 {
        let [value] = self.samples[y as usize * self.width as usize + x as usize];
        ((u32::from(value) + 128) / 257) as u8
    }
}
