//! Grey planes: how WebP files hold normals and surfaces.
//!
//! Lossy WebP halves the resolution of chroma, which turns normals and mixes a surface's channels, but keeps that of
//! luma. So each channel is a grey picture, and a file's picture is these one below the other, red first.

use super::{TextureInfo, TextureKind};

/// The planes of normals: x and y. z follows, as vectors have length 1 and point out of the surface.
pub const NORMAL_PLANES: u8 = 0b011;

/// Which channels a texture's WebP files hold.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Planes {
    kind: TextureKind,
    channels: u8,
    /// Values of the channels without a plane.
    others: [u8; 3],
}

impl TextureInfo {
    /// The planes that this texture's WebP files hold; `None` if they hold colours.
    #[must_use]
    pub fn planes(&self) -> Option<Planes> {
        let others = self.mean.unwrap_or([u8::MAX; 3]);
        matches!(self.kind, TextureKind::Normal | TextureKind::Surface).then_some(Planes {
            kind: self.kind,
            channels: self.planes,
            others,
        })
    }

    /// Whether the stated planes are such as a texture of this kind has.
    pub(super) fn has_valid_planes(&self) -> bool {
        match self.kind {
            TextureKind::Color | TextureKind::Height => self.planes == 0,
            TextureKind::Normal => self.planes == NORMAL_PLANES,
            TextureKind::Surface => self.planes < 8 && (self.planes == 7 || self.mean.is_some()),
        }
    }
}

impl Planes {
    /// Width and height of the picture that holds an image of this size.
    #[must_use]
    pub fn stacked(self, [width, height]: [u32; 2]) -> [u32; 2] {
        [width, height.saturating_mul(self.channels.count_ones())]
    }

    /// The texels of an image, four bytes each, from the pixels of the picture, whose first bytes are the grey values.
    #[must_use]
    pub fn texels<const N: usize>(self, pixels: &[[u8; N]]) -> Vec<u8> {
        let plane = pixels.len() / self.channels.count_ones().max(1) as usize;
        let [r, g, b] = self.others;
        let mut texels = vec![[r, g, b, u8::MAX]; plane];
        let channels = (0..3).filter(|channel| self.channels >> channel & 1 != 0);
        for (channel, plane) in channels.zip(pixels.chunks_exact(plane.max(1))) {
            for (texel, grey) in texels.iter_mut().zip(plane.iter().filter_map(|pixel| pixel.first())) {
                texel[channel] = *grey;
            }
        }
        if self.kind == TextureKind::Normal {
            for [x, y, z, _] in &mut texels {
                *z = third(*x, *y);
            }
        }
        texels.into_flattened()
    }
}

/// z of a normal as it is stored, from x and y; 0 if errors have made them longer than 1.
fn third(x: u8, y: u8) -> u8 {
    // In 255ths.
    let square = |c: u8| (2 * i32::from(c) - 255).unsigned_abs().pow(2);
    let z = (255_u32 * 255).saturating_sub(square(x) + square(y)).isqrt();
    // (255 + z) / 2, rounded; the root's fraction cannot change that.
    u8::try_from((256 + z) / 2).unwrap_or(u8::MAX)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::asset::TextureLevel;

    fn planes(kind: TextureKind, planes: u8) -> Planes {
        let levels: Vec<TextureLevel> = Vec::new();
        let mean = (kind == TextureKind::Surface).then_some([11, 22, 33]);
        TextureInfo { kind, width: 2, height: 2, planes, mean, uv_per_unit: 0.0, levels }.planes().unwrap()
    }

    #[test]
    fn planes_return_to_their_channels() {
        // Of three bytes only the first is read.
        let picture: Vec<[u8; 3]> = (1..=8).map(|value| [value, 200, 100]).collect();
        let both = planes(TextureKind::Surface, 0b101);
        assert_eq!(both.stacked([2, 2]), [2, 4]);
        assert_eq!(
            both.texels(&picture),
            [1, 22, 5, 255, 2, 22, 6, 255, 3, 22, 7, 255, 4, 22, 8, 255],
            "green is the same everywhere"
        );
        let one = planes(TextureKind::Surface, 0b010);
        assert_eq!(
            (one.stacked([2, 2]), one.texels(&[[7], [8]])),
            ([2, 2], [11, 7, 33, 255, 11, 8, 33, 255].into())
        );
        let none = planes(TextureKind::Surface, 0);
        assert_eq!((none.stacked([2, 2])[1], none.texels::<4>(&[])), (0, Vec::new()));
    }

    #[test]
    fn normals_get_their_third_component() {
        let of = |x, y| planes(TextureKind::Normal, NORMAL_PLANES).texels(&[[x], [y]])[2];
        assert_eq!(of(128, 128), 255);
        // 0.6 and 0.8.
        assert_eq!((of(204, 128), of(128, 51)), (229, 229));
        assert_eq!((of(255, 128), of(0, 0)), (128, 128), "too long is level");
        let unit = |c: u8| f64::from(c) / 127.5 - 1.0;
        for (x, y) in (0..=255).flat_map(|x| (0..=255).map(move |y| (x, y))) {
            let (square, z) = (unit(x).powi(2) + unit(y).powi(2), unit(of(x, y)));
            assert!(z >= 0.0 && (square > 1.0 || (z - (1.0 - square).sqrt()).abs() < 0.004), "{x} {y}");
        }
    }
}
