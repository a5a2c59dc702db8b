//! Halving by a box filter, exactly, for any size, as rows arrive.
//!
//! The box covers what an output pixel covers, also where a side is odd (Guthe and Heckbert,
//! "Non-power-of-two mipmapping", 2005): weights are integers, so sums are exact.

use std::ops::Range;

use image::{DynamicImage, RgbaImage};

use crate::srgb;

/// An image with `N` 16-bit channels, row by row.
pub(super) struct Plane<const N: usize> {
    pub(super) width: u32,
    pub(super) height: u32,
    pub(super) samples: Vec<[u16; N]>,
}

/// How samples become one.
pub(super) trait Average<const N: usize> {
    /// The mean of samples with weights.
    fn weighted(inputs: impl Iterator<Item = (u64, [u16; N])>) -> [u16; N];

    /// [`Self::weighted`] of four with equal weights: the same sums, divided once.
    fn of_four(four: [[u16; N]; 4]) -> [u16; N];
}

/// The mean of each channel.
pub(super) struct Plain;

/// The mean of colours weighted by opacity, the last channel, so that the colour of invisible pixels does not bleed into
/// visible ones.
pub(super) struct ByOpacity;

impl<const N: usize> Average<N> for Plain {
    fn weighted(inputs: impl Iterator<Item = (u64, [u16; N])>) -> [u16; N] {
        let (mut sums, mut total) = ([0u64; N], 0u64);
        for (weight, sample) in inputs {
            total += weight;
            for (sum, value) in sums.iter_mut().zip(sample) {
                *sum += weight * u64::from(value);
            }
        }
        sums.map(|sum| ((sum + total / 2) / total) as u16)
    }

    fn of_four(four: [[u16; N]; 4]) -> [u16; N] {
        std::array::from_fn(|c| {
            let sum: u32 = four.iter().map(|sample| u32::from(sample[c])).sum();
            ((sum + 2) / 4) as u16
        })
    }
}

impl Average<4> for ByOpacity {
    fn weighted(inputs: impl Iterator<Item = (u64, [u16; 4])>) -> [u16; 4] {
        let (mut weighted, mut plain, mut opacity, mut total) = ([0u128; 3], [0u128; 3], 0u128, 0u128);
        for (weight, [r, g, b, a]) in inputs {
            let (weight, alpha) = (u128::from(weight), u128::from(a));
            total += weight;
            opacity += weight * alpha;
            for (i, value) in [r, g, b].into_iter().enumerate() {
                weighted[i] += weight * alpha * u128::from(value);
                plain[i] += weight * u128::from(value);
            }
        }
        let (sums, by) = if opacity > 0 { (weighted, opacity) } else { (plain, total) };
        let [r, g, b] = sums.map(|sum| ((sum + by / 2) / by) as u16);
        [r, g, b, ((opacity + total / 2) / total) as u16]
    }

    fn of_four(four: [[u16; 4]; 4]) -> [u16; 4] {
        let opacity: u64 = four.iter().map(|sample| u64::from(sample[3])).sum();
        if opacity == 0 || opacity == 4 * u64::from(u16::MAX) {
            return Plain::of_four(four);
        }
        std::array::from_fn(|c| {
            if c == 3 {
                return ((opacity + 2) / 4) as u16;
            }
            let sum: u64 = four.iter().map(|sample| u64::from(sample[3]) * u64::from(sample[c])).sum();
            ((sum + opacity / 2) / opacity) as u16
        })
    }
}

/// For each output pixel of one axis: the first input pixel and the weights from there.
struct Taps {
    first: usize,
    weights: Vec<u64>,
}

fn taps(input: u32, output: u32) -> Vec<Taps> {
    let (n, m) = (u64::from(input), u64::from(output));
    // In units of 1/m of an input pixel, output pixel i covers i·n .. (i+1)·n.
    (0..m)
        .map(|i| {
            let (start, end) = (i * n, (i + 1) * n);
            let first = start / m;
            let last = end.div_ceil(m);
            let weights = (first..last).map(|k| end.min((k + 1) * m) - start.max(k * m)).collect();
            Taps { first: first as usize, weights }
        })
        .collect()
}

/// Width and height of the next coarser level.
pub(super) fn half([width, height]: [u32; 2]) -> [u32; 2] {
    [(width / 2).max(1), (height / 2).max(1)]
}

/// The next coarser level, row by row.
pub(super) struct Halving<const N: usize> {
    width: usize,
    /// Of the rows and columns; none where both sides are even.
    taps: Option<[Vec<Taps>; 2]>,
    /// Input rows that the next output row may need, and the number of the first.
    held: Vec<[u16; N]>,
    first: usize,
    /// Output rows made so far, and all.
    rows: Range<usize>,
}

impl<const N: usize> Halving<N> {
    /// Of an image of this width and height.
    pub(super) fn new(size: [u32; 2]) -> Self {
        let [width, height] = half(size);
        let even = size.iter().all(|side| side.is_multiple_of(2));
        let taps = (!even).then(|| [taps(size[0], width), taps(size[1], height)]);
        Self { width: size[0] as usize, taps, held: Vec::new(), first: 0, rows: 0..height as usize }
    }

    /// The output rows that become complete with the next input rows.
    pub(super) fn push<A: Average<N>>(&mut self, rows: &[[u16; N]]) -> Vec<[u16; N]> {
        self.held.extend_from_slice(rows);
        let width = self.width;
        let held = self.first + self.held.len() / width;
        let mut out = Vec::with_capacity(self.held.len() / 4);
        while !self.rows.is_empty() {
            let row = self.rows.start;
            let (first, end) = match &self.taps {
                None => (2 * row, 2 * row + 2),
                Some([_, rows]) => (rows[row].first, rows[row].first + rows[row].weights.len()),
            };
            if held < end {
                break;
            }
            let inputs = &self.held[(first - self.first) * width..(end - self.first) * width];
            match &self.taps {
                None => {
                    let (upper, lower) = inputs.split_at(width);
                    let pairs = upper.as_chunks::<2>().0.iter().zip(lower.as_chunks::<2>().0);
                    out.extend(pairs.map(|([a, b], [c, d])| A::of_four([*a, *b, *c, *d])));
                }
                Some([columns, rows]) => out.extend(columns.iter().map(|column| {
                    A::weighted(rows[row].weights.iter().enumerate().flat_map(|(y, wy)| {
                        let from = y * width + column.first;
                        let inputs = column.weights.iter().zip(&inputs[from..]);
                        inputs.map(move |(wx, sample)| (wx * wy, *sample))
                    }))
                })),
            }
            self.rows.start += 1;
        }
        let needed = match &self.taps {
            None => 2 * self.rows.start,
            Some([_, rows]) => rows.get(self.rows.start).map_or(held, |row| row.first),
        };
        self.held.drain(..(needed - self.first) * width);
        self.first = needed;
        out
    }
}

impl<const N: usize> Plane<N> {
    /// The mean of each channel.
    pub(super) fn mean(&self) -> [u16; N] {
        let count = self.samples.len().max(1) as u64;
        std::array::from_fn(|c| {
            let sum: u64 = self.samples.iter().map(|sample| u64::from(sample[c])).sum();
            ((sum + count / 2) / count) as u16
        })
    }
}

/// Linear light with opacity, of sRGB pixels.
pub(super) fn linear(pixels: &RgbaImage) -> Vec<[u16; 4]> {
    let sample = |[r, g, b, a]: [u8; 4]| {
        [srgb::to_linear(r), srgb::to_linear(g), srgb::to_linear(b), u16::from(a) * 257]
    };
    pixels.pixels().map(|p| sample(p.0)).collect()
}

impl Plane<4> {
    /// Linear light with opacity, of an sRGB image.
    pub(super) fn from_srgb(image: &RgbaImage) -> Self {
        Self { width: image.width(), height: image.height(), samples: linear(image) }
    }

    /// sRGB bytes with opacity.
    pub(super) fn to_srgb(&self) -> Vec<u8> {
        let pixel = |s: &[u16; 4]| {
            let alpha = (u32::from(s[3]) + 128) / 257;
            [srgb::from_linear(s[0]), srgb::from_linear(s[1]), srgb::from_linear(s[2]), alpha as u8]
        };
        self.samples.iter().flat_map(pixel).collect()
    }

    /// The mean colour as sRGB bytes, weighted by opacity as coarser levels are.
    pub(super) fn mean_srgb(&self) -> [u8; 3] {
        let (mut weighted, mut plain, mut opacity) = ([0u64; 3], [0u64; 3], 0u64);
        for [r, g, b, a] in &self.samples {
            opacity += u64::from(*a);
            for (i, value) in [r, g, b].into_iter().enumerate() {
                weighted[i] += u64::from(*a) * u64::from(*value);
                plain[i] += u64::from(*value);
            }
        }
        let (sums, by) = if opacity > 0 { (weighted, opacity) } else { (plain, self.samples.len() as u64) };
        sums.map(|sum| srgb::from_linear(((sum + by / 2) / by) as u16))
    }
}

impl Plane<1> {
    /// Heights; 16 bits if `deep`, else values of 8 bits.
    pub(super) fn from_heights(image: &DynamicImage, deep: bool) -> Self {
        let samples = if deep {
            image.to_luma16().into_raw().into_iter().map(|h| [h]).collect()
        } else {
            image.to_luma8().into_raw().into_iter().map(|h| [u16::from(h)]).collect()
        };
        Self { width: image.width(), height: image.height(), samples }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_input_pixel_counts_alike() {
        for (input, output) in [(8, 4), (7, 3), (5, 2), (3, 1), (1, 1), (16_384, 8_192), (101, 50)] {
            let mut weight = vec![0u64; input as usize];
            for tap in taps(input, output) {
                assert_eq!(tap.weights.iter().sum::<u64>(), u64::from(input));
                for (k, w) in tap.weights.iter().enumerate() {
                    weight[tap.first + k] += w;
                }
            }
            assert!(weight.iter().all(|&w| w == u64::from(output)), "{input} to {output}");
        }
    }

    #[test]
    fn the_mean_colour_is_that_of_the_light_and_of_what_can_be_seen() {
        let half = Plane::<4> {
            width: 2,
            height: 1,
            samples: vec![[0, 65_535, 20_000, 65_535], [65_535, 65_535, 20_000, 65_535]],
        };
        let [r, g, b] = half.mean_srgb();
        assert_eq!((r, g, b), (188, 255, srgb::from_linear(20_000)), "half the light is 188 of 255");
        let hidden =
            Plane::<4> { width: 2, height: 1, samples: vec![[65_535, 0, 0, 0], [0, 65_535, 0, 1000]] };
        assert_eq!(hidden.mean_srgb(), [0, 255, 0]);
        let nothing = Plane::<4> { width: 1, height: 1, samples: vec![[65_535, 0, 0, 0]] };
        assert_eq!(nothing.mean_srgb(), [255, 0, 0]);
    }

    /// The next coarser level of a plane, from strips of so many rows.
    fn halved<const N: usize, A: Average<N>>(plane: &Plane<N>, strip: usize) -> Vec<[u16; N]> {
        let mut halving = Halving::new([plane.width, plane.height]);
        let strips = plane.samples.chunks(strip * plane.width as usize);
        strips.flat_map(|rows| halving.push::<A>(rows)).collect()
    }

    /// The same by [`Average::weighted`] and all at once.
    fn weighted<const N: usize, A: Average<N>>(plane: &Plane<N>) -> Vec<[u16; N]> {
        let [width, height] = half([plane.width, plane.height]);
        let (columns, rows) = (taps(plane.width, width), taps(plane.height, height));
        let at = |x: usize, y: usize| plane.samples[y * plane.width as usize + x];
        let mut out = Vec::new();
        for row in &rows {
            out.extend(columns.iter().map(|column| {
                A::weighted(row.weights.iter().enumerate().flat_map(|(y, wy)| {
                    let inputs = column.weights.iter().enumerate();
                    inputs.map(move |(x, wx)| (wx * wy, at(column.first + x, row.first + y)))
                }))
            }));
        }
        out
    }

    #[test]
    fn strips_halve_as_whole_images_do() {
        for [width, height] in [[12, 6], [13, 6], [12, 7], [5, 9], [1, 8], [9, 1], [1, 1]] {
            let sample = |i: u16| [i.wrapping_mul(40_503), u16::MAX - i % 3, i, (i % 3) * 32_767];
            let plane = Plane { width, height, samples: (0..(width * height) as u16).map(sample).collect() };
            for strip in 1..8 {
                let of = format!("{width} × {height} in strips of {strip}");
                assert_eq!(halved::<4, Plain>(&plane, strip), weighted::<4, Plain>(&plane), "{of}");
                assert_eq!(halved::<4, ByOpacity>(&plane, strip), weighted::<4, ByOpacity>(&plane), "{of}");
            }
        }
    }

    #[test]
    fn the_mean_is_kept() {
        let samples: Vec<[u16; 1]> = (0..15).map(|i| [i * 1000]).collect();
        let half = halved::<1, Plain>(&Plane { width: 5, height: 3, samples }, 1);
        assert_eq!(half.len(), 2);
        assert_eq!((half[0][0] + half[1][0]) / 2, 7000);
    }
}
