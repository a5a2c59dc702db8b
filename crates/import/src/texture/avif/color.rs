//! Samples of AV1 frames to colours (ITU-T H.273, section 8.3).

use image::{DynamicImage, ImageBuffer, Luma, LumaA, Rgb, Rgba};
use re_rav1d::pixel::YUVRange;
use re_rav1d::{Picture, PixelLayout, PlanarImageComponent};

/// How samples stand for colours.
#[derive(Clone, Copy)]
pub(super) struct Coding {
    /// Matrix coefficients (ITU-T H.273, table 4).
    pub(super) matrix: u16,
    pub(super) is_full_range: bool,
}

/// Matrix coefficients that say nothing, for which BT.601 is usual.
const UNSPECIFIED: u16 = 2;

/// A frame of colours, perhaps with one of opacity of the same size; codings as the file states them.
pub(super) struct Image<'a> {
    pub(super) color: (&'a Picture, Option<Coding>),
    pub(super) alpha: Option<(&'a Picture, Option<Coding>)>,
}

/// Shares of red and blue in luma, or that planes are green, blue and red.
enum Matrix {
    Identity,
    Shares(f32, f32),
}

impl Image<'_> {
    /// The image, of 8 bits of each channel, or 16 if the frame has more.
    pub(super) fn decode(&self) -> Result<DynamicImage, String> {
        let (picture, coding) = self.color;
        let coding = coding.unwrap_or_else(|| coding_of(picture));
        let matrix = match coding.matrix {
            0 if picture.pixel_layout() == PixelLayout::I444 => Matrix::Identity,
            1 => Matrix::Shares(0.2126, 0.0722),
            UNSPECIFIED | 5 | 6 => Matrix::Shares(0.299, 0.114),
            4 => Matrix::Shares(0.3, 0.11),
            7 => Matrix::Shares(0.212, 0.087),
            9 => Matrix::Shares(0.2627, 0.0593),
            other => return Err(format!("its colours have matrix coefficients {other}; convert it")),
        };
        let is_full = coding.is_full_range;
        let is_identity = matches!(matrix, Matrix::Identity);
        let luma = Samples::new(picture, PlanarImageComponent::Y, is_full, false)?;
        let alpha = match self.alpha {
            Some((picture, coding)) => {
                let coding = coding.unwrap_or_else(|| coding_of(picture));
                Some(Samples::new(picture, PlanarImageComponent::Y, coding.is_full_range, false)?)
            }
            None => None,
        };
        let (width, height) = (picture.width(), picture.height());
        let is_deep = luma.is_deep || alpha.as_ref().is_some_and(|alpha| alpha.is_deep);
        let opacity = |x, y| alpha.as_ref().map(|alpha| alpha.at(x, y));
        if picture.pixel_layout() == PixelLayout::I400 {
            return Ok(grey(width, height, is_deep, |x, y| (luma.at(x, y), opacity(x, y))));
        }
        let chroma = [PlanarImageComponent::U, PlanarImageComponent::V]
            .map(|plane| Samples::new(picture, plane, is_full, !is_identity));
        let [first, second] = chroma;
        let (first, second) = (first?, second?);
        let color = |x, y| {
            let [y_, b, r] = [luma.at(x, y), first.between(x, y), second.between(x, y)];
            match matrix {
                Matrix::Identity => [r, y_, b],
                Matrix::Shares(kr, kb) => {
                    let (r, b) = (y_ + 2.0 * (1.0 - kr) * r, y_ + 2.0 * (1.0 - kb) * b);
                    [r, (y_ - kr * r - kb * b) / (1.0 - kr - kb), b]
                }
            }
        };
        Ok(colours(width, height, is_deep, |x, y| (color(x, y), opacity(x, y))))
    }
}

fn coding_of(picture: &Picture) -> Coding {
    Coding { matrix: UNSPECIFIED, is_full_range: picture.color_range() == YUVRange::Full }
}

/// A plane of samples.
pub(super) struct Samples {
    pub(super) plane: Vec<u8>,
    pub(super) stride: usize,
    /// Whether samples take two bytes.
    pub(super) is_deep: bool,
    /// Whether columns and rows are halved.
    pub(super) halved: [bool; 2],
    /// Last column and row.
    pub(super) last: [u32; 2],
    /// A sample's value is `scale * (sample - zero)`.
    pub(super) zero: f32,
    pub(super) scale: f32,
}

impl Samples {
    fn new(
        picture: &Picture,
        component: PlanarImageComponent,
        is_full_range: bool,
        is_difference: bool,
    ) -> Result<Self, String> {
        let bits = picture.bit_depth();
        if !(8..=16).contains(&bits) {
            return Err(format!("its samples have {bits} bits"));
        }
        let is_chroma = component != PlanarImageComponent::Y;
        let halved = match picture.pixel_layout() {
            PixelLayout::I420 if is_chroma => [true, true],
            PixelLayout::I422 if is_chroma => [true, false],
            _ => [false, false],
        };
        let side = |k: usize, full: u32| if halved[k] { full.div_ceil(2) } else { full };
        let size = [side(0, picture.width()), side(1, picture.height())];
        let unit = (1_u32 << (bits - 8)) as f32;
        let (zero, range) = match (is_full_range, is_difference) {
            (true, false) => (0.0, 256.0 * unit - 1.0),
            (true, true) => (128.0 * unit, 256.0 * unit - 1.0),
            (false, false) => (16.0 * unit, 219.0 * unit),
            (false, true) => (128.0 * unit, 224.0 * unit),
        };
        let (plane, stride) = (picture.plane(component).to_vec(), picture.stride(component) as usize);
        let bytes = if bits > 8 { 2 } else { 1 };
        let end = stride * (size[1] as usize - 1) + size[0] as usize * bytes;
        if plane.len() < end {
            return Err("its frame is cut short".to_owned());
        }
        Ok(Self {
            plane,
            stride,
            is_deep: bits > 8,
            halved,
            last: size.map(|side| side - 1),
            zero,
            scale: 1.0 / range,
        })
    }

    fn at(&self, x: u32, y: u32) -> f32 {
        let row = y as usize * self.stride;
        let sample = if self.is_deep {
            let at = row + 2 * x as usize;
            f32::from(u16::from_ne_bytes([self.plane[at], self.plane[at + 1]]))
        } else {
            f32::from(self.plane[row + x as usize])
        };
        (sample - self.zero) * self.scale
    }

    /// The value at a pixel, linear between the middles of samples.
    pub(super) fn between(&self, x: u32, y: u32) -> f32 {
        let along = |k: usize, at: u32| {
            if !self.halved[k] {
                return (at, at, 0.0);
            }
            // A quarter of a sample before or after the middle of the nearest.
            let nearest = at / 2;
            let other = if at.is_multiple_of(2) {
                nearest.saturating_sub(1)
            } else {
                (nearest + 1).min(self.last[k])
            };
            (nearest, other, 0.25)
        };
        let ((x0, x1, u), (y0, y1, v)) = (along(0, x), along(1, y));
        let row = |y: u32| (1.0 - u) * self.at(x0, y) + u * self.at(x1, y);
        if v == 0.0 { row(y0) } else { (1.0 - v) * row(y0) + v * row(y1) }
    }
}

fn byte(value: f32) -> u8 {
    (value.clamp(0.0, 1.0) * 255.0 + 0.5) as u8
}

fn word(value: f32) -> u16 {
    (value.clamp(0.0, 1.0) * 65_535.0 + 0.5) as u16
}

fn grey(width: u32, height: u32, is_deep: bool, at: impl Fn(u32, u32) -> (f32, Option<f32>)) -> DynamicImage {
    let has_alpha = at(0, 0).1.is_some();
    let both = |x, y| {
        let (grey, alpha) = at(x, y);
        [grey, alpha.unwrap_or(1.0)]
    };
    match (is_deep, has_alpha) {
        (false, false) => ImageBuffer::from_fn(width, height, |x, y| Luma([byte(at(x, y).0)])).into(),
        (false, true) => ImageBuffer::from_fn(width, height, |x, y| LumaA(both(x, y).map(byte))).into(),
        (true, false) => ImageBuffer::from_fn(width, height, |x, y| Luma([word(at(x, y).0)])).into(),
        (true, true) => ImageBuffer::from_fn(width, height, |x, y| LumaA(both(x, y).map(word))).into(),
    }
}

fn colours(
    width: u32,
    height: u32,
    is_deep: bool,
    at: impl Fn(u32, u32) -> ([f32; 3], Option<f32>),
) -> DynamicImage {
    let has_alpha = at(0, 0).1.is_some();
    let all = |x, y| {
        let ([r, g, b], alpha) = at(x, y);
        [r, g, b, alpha.unwrap_or(1.0)]
    };
    match (is_deep, has_alpha) {
        (false, false) => ImageBuffer::from_fn(width, height, |x, y| Rgb(at(x, y).0.map(byte))).into(),
        (false, true) => ImageBuffer::from_fn(width, height, |x, y| Rgba(all(x, y).map(byte))).into(),
        (true, false) => ImageBuffer::from_fn(width, height, |x, y| Rgb(at(x, y).0.map(word))).into(),
        (true, true) => ImageBuffer::from_fn(width, height, |x, y| Rgba(all(x, y).map(word))).into(),
    }
}
