//! Statistics: the roughness of the terrain at each scale.

use super::parameters;
use lodestream_terrain::{Distribution, Parameters, Terrain};
use std::f64::consts::TAU;

const LEVEL: u8 = 10;
const SIDE: usize = 1 << LEVEL;

/// A complex number.
type Complex = (f64, f64);

/// The discrete Fourier transform in place, of a length that is a power of two (Cooley and Tukey 1965).
fn transform(values: &mut [Complex], roots: &[Complex]) {
    let n = values.len();
    for i in 0..n {
        let j = i.reverse_bits() >> (usize::BITS - n.trailing_zeros());
        if i < j {
            values.swap(i, j);
        }
    }
    let mut half = 1;
    while half < n {
        let stride = n / 2 / half;
        for block in values.chunks_exact_mut(2 * half) {
            let (low, high) = block.split_at_mut(half);
            for (i, (a, b)) in low.iter_mut().zip(high).enumerate() {
                let (cos, sin) = roots[i * stride];
                let turned = (b.0 * cos - b.1 * sin, b.0 * sin + b.1 * cos);
                *b = (a.0 - turned.0, a.1 - turned.1);
                *a = (a.0 + turned.0, a.1 + turned.1);
            }
        }
        half *= 2;
    }
}

fn transpose(values: &mut [Complex]) {
    for y in 0..SIDE {
        for x in 0..y {
            values.swap(y * SIDE + x, x * SIDE + y);
        }
    }
}

/// Power by integer wave number (cycles per patch), averaged over directions and 20 seeds. The mean and the last row
/// and column of the patch are removed; it is used as it is or with a Hann window.
fn power(distribution: Distribution, hann: bool) -> Vec<f64> {
    let roots: Vec<Complex> =
        (0..SIDE / 2).map(|i| TAU * i as f64 / SIDE as f64).map(|a| (a.cos(), -a.sin())).collect();
    let heights = |seed: u64| {
        let parameters = Parameters { distribution, amplitude: 1 << 26, ..parameters(seed, LEVEL) };
        let patch = Terrain::new(parameters).unwrap().patch(seed as i64 * 3, -7, LEVEL).unwrap();
        let rows = patch.chunks(SIDE + 1).take(SIDE);
        let values: Vec<f64> = rows.flat_map(|row| &row[..SIDE]).map(|&h| f64::from(h)).collect();
        let mean = values.iter().sum::<f64>() / values.len() as f64;
        let w = |i: usize| if hann { 0.5 - 0.5 * (TAU * i as f64 / SIDE as f64).cos() } else { 1.0 };
        values
            .into_iter()
            .enumerate()
            .map(move |(i, h)| (h - mean) * w(i % SIDE) * w(i / SIDE))
            .collect::<Vec<_>>()
    };
    let mut sums = vec![(0.0, 0_u32); SIDE / 2];
    for pair in 0..10 {
        // Two real patches in one transform: their cross terms cancel between a frequency and its negative.
        let mut values: Vec<Complex> = heights(2 * pair).into_iter().zip(heights(2 * pair + 1)).collect();
        for _ in 0..2 {
            values.chunks_exact_mut(SIDE).for_each(|row| transform(row, &roots));
            transpose(&mut values);
        }
        for (i, value) in values.iter().enumerate() {
            let wave = |i: usize| (i as f64 + SIDE as f64 / 2.0) % SIDE as f64 - SIDE as f64 / 2.0;
            let radius = wave(i % SIDE).hypot(wave(i / SIDE)).round() as usize;
            if let Some(sum) = sums.get_mut(radius) {
                *sum = (sum.0 + value.0 * value.0 + value.1 * value.1, sum.1 + 1);
            }
        }
    }
    sums.into_iter().map(|(sum, count)| sum / f64::from(count)).collect()
}

/// Slope of a least-squares line through log power by log wave number, in octaves from `first` on; each octave has the
/// same weight.
fn exponent(power: &[f64], first: usize, last: usize) -> f64 {
    let octave = |low: usize| {
        let middle = (low as f64 * std::f64::consts::SQRT_2).ln();
        (middle, (power[low..2 * low].iter().sum::<f64>() / low as f64).ln())
    };
    let points: Vec<(f64, f64)> =
        std::iter::successors(Some(first), |k| Some(2 * k)).take_while(|&k| k <= last).map(octave).collect();
    let n = points.len() as f64;
    let (mx, my) = points.iter().fold((0.0, 0.0), |(x, y), p| (x + p.0 / n, y + p.1 / n));
    let (sxy, sxx) =
        points.iter().fold((0.0, 0.0), |(xy, xx), p| (xy + (p.0 - mx) * (p.1 - my), xx + (p.0 - mx).powi(2)));
    -sxy / sxx
}

#[test]
fn power_falls_with_the_third_power_of_the_frequency() {
    let plain = exponent(&power(Distribution::Uniform, false), 2, 256);
    assert!((2.6..=3.4).contains(&plain), "exponent {plain:.2}");
    // A patch does not repeat, so its opposite borders act as a discontinuity, whose power falls most slowly. With a
    // Hann window, which removes it, the power falls with the fourth power, as it should for ranges that halve per
    // level.
    let smooth = exponent(&power(Distribution::Uniform, true), 4, 128);
    assert!((3.6..=4.4).contains(&smooth), "exponent {smooth:.2} with a Hann window");
}
