//! Comparison of two pictures: structural similarity and plain differences.

use image::RgbaImage;
use thiserror::Error;

/// Radius of the Gaussian window: 11 × 11 with σ = 1.5, as in the paper.
const RADIUS: i64 = 5;
const SIGMA: f64 = 1.5;
/// Stabilisers (K₁ L)² and (K₂ L)² with L = 255.
const C1: f64 = (0.01 * 255.0) * (0.01 * 255.0);
const C2: f64 = (0.03 * 255.0) * (0.03 * 255.0);

/// Why two pictures cannot be compared.
#[derive(Debug, Error, PartialEq, Eq)]
#[non_exhaustive]
pub enum CompareError {
    /// Different sizes.
    #[error("pictures differ in size: {0:?} and {1:?}")]
    Size((u32, u32), (u32, u32)),
    /// The mask has another number of pixels.
    #[error("mask has {got} pixels, the pictures {expected}")]
    Mask {
        /// Pixels of the pictures.
        expected: usize,
        /// Pixels of the mask.
        got: usize,
    },
    /// No pixel is covered.
    #[error("no pixel is covered by the mask")]
    Empty,
}

/// Result of a comparison over the covered pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Comparison {
    /// Mean structural similarity of luma, 1 = equal.
    pub ssim: f64,
    /// The lowest similarity of any covered pixel's window: finds a small missing patch that the
    /// mean hides.
    pub min_ssim: f64,
    /// Mean absolute difference of the colour channels, 0..=255.
    pub mean_difference: f64,
    /// Largest absolute difference of a colour channel, 0..=255.
    pub max_difference: u8,
    /// Covered pixels as a share of all.
    pub covered: f64,
}

/// Compares two pictures of equal size over the pixels that `mask` covers (rows from the top; all
/// of them without a mask). A useful mask is the union of what either picture covers, so that a
/// hole counts.
///
/// Similarity is SSIM (Wang, Bovik, Sheikh, Simoncelli, "Image quality assessment: from error
/// visibility to structural similarity", 2004) of BT.601 luma; windows at the border are cut off
/// and their weights normalised.
///
/// # Errors
/// [`CompareError`] if sizes disagree or nothing is covered.
pub fn compare(a: &RgbaImage, b: &RgbaImage, mask: Option<&[bool]>) -> Result<Comparison, CompareError> {
    if a.dimensions() != b.dimensions() {
        return Err(CompareError::Size(a.dimensions(), b.dimensions()));
    }
    let (width, height) = (a.width() as usize, a.height() as usize);
    let expected = width * height;
    if let Some(mask) = mask
        && mask.len() != expected
    {
        return Err(CompareError::Mask { expected, got: mask.len() });
    }
    let covered = |i: usize| mask.is_none_or(|m| m[i]);

    let (la, lb) = (luma(a), luma(b));
    let blur = |f: &dyn Fn(usize) -> f64| gaussian(&(0..expected).map(f).collect::<Vec<_>>(), width, height);
    let (ma, mb) = (blur(&|i| la[i]), blur(&|i| lb[i]));
    let (saa, sbb, sab) = (blur(&|i| la[i] * la[i]), blur(&|i| lb[i] * lb[i]), blur(&|i| la[i] * lb[i]));

    let (mut ssim, mut min_ssim, mut count) = (0.0, 1.0_f64, 0usize);
    let (mut difference, mut max_difference) = (0.0, 0u8);
    for (i, (pa, pb)) in a.pixels().zip(b.pixels()).enumerate().filter(|(i, _)| covered(*i)) {
        let (va, vb) = (saa[i] - ma[i] * ma[i], sbb[i] - mb[i] * mb[i]);
        let cov = sab[i] - ma[i] * mb[i];
        let s = ((2.0 * ma[i] * mb[i] + C1) * (2.0 * cov + C2))
            / ((ma[i] * ma[i] + mb[i] * mb[i] + C1) * (va + vb + C2));
        ssim += s;
        min_ssim = min_ssim.min(s);
        count += 1;
        for channel in 0..3 {
            let d = pa[channel].abs_diff(pb[channel]);
            difference += f64::from(d);
            max_difference = max_difference.max(d);
        }
    }
    if count == 0 {
        return Err(CompareError::Empty);
    }
    let n = count as f64;
    Ok(Comparison {
        ssim: ssim / n,
        min_ssim,
        mean_difference: difference / (3.0 * n),
        max_difference,
        covered: n / expected as f64,
    })
}

fn luma(image: &RgbaImage) -> Vec<f64> {
    image
        .pixels()
        .map(|p| 0.299 * f64::from(p[0]) + 0.587 * f64::from(p[1]) + 0.114 * f64::from(p[2]))
        .collect()
}

/// Separable Gaussian mean of every pixel's window.
fn gaussian(values: &[f64], width: usize, height: usize) -> Vec<f64> {
    let weight = |d: i64| (-((d * d) as f64) / (2.0 * SIGMA * SIGMA)).exp();
    let pass = |source: &[f64], step: usize, position: &dyn Fn(usize) -> usize, length: usize| {
        let mean = |i: usize| {
            let at = position(i) as i64;
            let (mut sum, mut total) = (0.0, 0.0);
            for d in -RADIUS..=RADIUS {
                if (0..length as i64).contains(&(at + d)) {
                    let w = weight(d);
                    sum += w * source[(i as i64 + d * step as i64) as usize];
                    total += w;
                }
            }
            sum / total
        };
        (0..source.len()).map(mean).collect::<Vec<_>>()
    };
    let rows = pass(values, 1, &|i| i % width, width);
    pass(&rows, width, &|i| i / width, height)
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::Rgba;

    /// A picture with detail at several scales.
    fn picture(shift: u32) -> RgbaImage {
        RgbaImage::from_fn(96, 64, |x, y| {
            let (x, y) = (f64::from(x + shift), f64::from(y));
            let v = 128.0 + 60.0 * (x * 0.31).sin() * (y * 0.23).cos() + 40.0 * (x * 1.1 + y * 0.7).sin();
            let v = v.clamp(0.0, 255.0) as u8;
            Rgba([v, v / 2 + 40, 255 - v, 255])
        })
    }

    #[test]
    fn equal_pictures_score_one() {
        let c = compare(&picture(0), &picture(0), None).unwrap();
        assert!((c.ssim - 1.0).abs() < 1e-12 && (c.min_ssim - 1.0).abs() < 1e-9);
        assert_eq!((c.max_difference, c.mean_difference, c.covered), (0, 0.0, 1.0));
    }

    #[test]
    fn a_shift_scores_lower_and_a_larger_one_lower_still() {
        let score = |shift| compare(&picture(0), &picture(shift), None).unwrap().ssim;
        assert!(score(1) < 0.97, "{}", score(1));
        assert!(score(2) < score(1));
    }

    #[test]
    fn a_missing_patch_is_found() {
        let mut b = picture(0);
        for y in 20..30 {
            for x in 40..50 {
                b.put_pixel(x, y, Rgba([200, 210, 220, 255]));
            }
        }
        let c = compare(&picture(0), &b, None).unwrap();
        assert!(c.ssim < 0.99 && c.min_ssim < 0.5, "{c:?}");
        // Differences outside the mask do not count.
        let away: Vec<bool> = (0..96 * 64).map(|i| i % 96 < 30).collect();
        let c = compare(&picture(0), &b, Some(&away)).unwrap();
        assert!((c.ssim - 1.0).abs() < 1e-9 && c.max_difference == 0);
        assert!((c.covered - 30.0 / 96.0).abs() < 1e-9);
    }

    #[test]
    fn a_uniform_offset_lowers_luminance_only_a_little() {
        let b = RgbaImage::from_fn(96, 64, |x, y| {
            Rgba(picture(0).get_pixel(x, y).0.map(|v| v.saturating_add(4)))
        });
        let c = compare(&picture(0), &b, None).unwrap();
        assert!(c.ssim > 0.98 && c.ssim < 1.0 && c.max_difference == 4, "{c:?}");
    }

    #[test]
    fn mismatches_are_errors() {
        let (a, b) = (RgbaImage::new(4, 4), RgbaImage::new(5, 4));
        assert_eq!(compare(&a, &b, None), Err(CompareError::Size((4, 4), (5, 4))));
        assert_eq!(compare(&a, &a, Some(&[true])), Err(CompareError::Mask { expected: 16, got: 1 }));
        assert_eq!(compare(&a, &a, Some(&[false; 16])), Err(CompareError::Empty));
    }
}
