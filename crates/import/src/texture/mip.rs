//! Halving by a box filter, exactly, for any size.
//!
//! The box covers what an output pixel covers, also where a side is odd (Guthe and Heckbert,
//! "Non-power-of-two mipmapping", 2005): weights are integers, so sums are exact.

use image::{DynamicImage, RgbaImage};

use lodestream_scene::asset::{TILE_BORDER, TILE_SIDE, tile_size};

use crate::srgb;

/// An image with `N` 16-bit channels, row by row.
pub(super) struct Plane<const N: usize> {
    pub(super) width: u32,
    pub(super) height: u32,
    pub(super) samples: Vec<[u16; N]>,
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

impl<const N: usize> Plane<N> {
    /// Folds each output pixel's input pixels with their weights.
    fn halve_with(&self, fold: impl Fn(&mut dyn Iterator<Item = (u64, [u16; N])>) -> [u16; N]) -> Self {
        let (width, height) = ((self.width / 2).max(1), (self.height / 2).max(1));
        let (columns, rows) = (taps(self.width, width), taps(self.height, height));
        let stride = self.width as usize;
        let mut samples = Vec::with_capacity(width as usize * height as usize);
        for row in &rows {
            for column in &columns {
                let mut inputs = row.weights.iter().enumerate().flat_map(|(y, wy)| {
                    let start = (row.first + y) * stride + column.first;
                    column.weights.iter().enumerate().map(move |(x, wx)| (wx * wy, self.samples[start + x]))
                });
                samples.push(fold(&mut inputs));
            }
        }
        Self { width, height, samples }
    }

    /// A tile with its border, which continues at the opposite edge.
    pub(super) fn tile(&self, place: [u32; 2]) -> Self {
        let [width, height] = tile_size([self.width, self.height], place[0], place[1]);
        let [left, top] = place.map(|at| at * TILE_SIDE);
        let wrapped = |at: u32, side: u32| ((at + side * TILE_BORDER) - TILE_BORDER) % side;
        let rows = (top..top + height).map(|y| wrapped(y, self.height) as usize * self.width as usize);
        let samples = rows.flat_map(|row| {
            (left..left + width).map(move |x| self.samples[row + wrapped(x, self.width) as usize])
        });
        Self { width, height, samples: samples.collect() }
    }

    /// [`Self::halve`] of even sides, where all weights are equal: the same sums, divided once.
    fn halve_even(&self) -> Self {
        let stride = self.width as usize;
        let mut samples = Vec::with_capacity(self.samples.len() / 4);
        for rows in self.samples.chunks_exact(2 * stride) {
            let (upper, lower) = rows.split_at(stride);
            for ([a, b], [c, d]) in upper.as_chunks::<2>().0.iter().zip(lower.as_chunks::<2>().0) {
                samples.push(std::array::from_fn(|i| {
                    let sum = u32::from(a[i]) + u32::from(b[i]) + u32::from(c[i]) + u32::from(d[i]);
                    ((sum + 2) / 4) as u16
                }));
            }
        }
        Self { width: self.width / 2, height: self.height / 2, samples }
    }

    /// The next coarser level: the mean of each channel.
    pub(super) fn halve(&self) -> Self {
        if self.width.is_multiple_of(2) && self.height.is_multiple_of(2) {
            return self.halve_even();
        }
        self.halve_with(|inputs| {
            let (mut sums, mut total) = ([0u64; N], 0u64);
            for (weight, sample) in inputs {
                total += weight;
                for (sum, value) in sums.iter_mut().zip(sample) {
                    *sum += weight * u64::from(value);
                }
            }
            sums.map(|sum| ((sum + total / 2) / total) as u16)
        })
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

impl Plane<4> {
    /// Linear light with opacity, of an sRGB image.
    pub(super) fn from_srgb(image: &RgbaImage) -> Self {
        let samples = image
            .pixels()
            .map(|p| {
                let [r, g, b, a] = p.0;
                [srgb::to_linear(r), srgb::to_linear(g), srgb::to_linear(b), u16::from(a) * 257]
            })
            .collect();
        Self { width: image.width(), height: image.height(), samples }
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

    /// The next coarser level: colours weighted by opacity, so that the colour of invisible pixels
    /// does not bleed into visible ones.
    pub(super) fn halve_premultiplied(&self) -> Self {
        if self.samples.iter().all(|s| s[3] == u16::MAX) {
            return self.halve();
        }
        self.halve_with(|inputs| {
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
        })
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

    #[test]
    fn even_sides_halve_as_others_do() {
        let samples = (0..12 * 6).map(|i: u16| [i.wrapping_mul(40_503), u16::MAX - i % 3]).collect();
        let plane = Plane { width: 12, height: 6, samples };
        let mean = |inputs: &mut dyn Iterator<Item = (u64, [u16; 2])>| {
            let (mut sums, mut total) = ([0; 2], 0);
            for (weight, sample) in inputs {
                total += weight;
                (0..2).for_each(|c| sums[c] += weight * u64::from(sample[c]));
            }
            sums.map(|sum| ((sum + total / 2) / total) as u16)
        };
        assert_eq!(plane.halve().samples, plane.halve_with(mean).samples);
    }

    #[test]
    fn the_mean_is_kept() {
        let samples: Vec<[u16; 1]> = (0..15).map(|i| [i * 1000]).collect();
        let half = Plane { width: 5, height: 3, samples }.halve();
        assert_eq!((half.width, half.height), (2, 1));
        assert_eq!((half.samples[0][0] + half.samples[1][0]) / 2, 7000);
    }
}
