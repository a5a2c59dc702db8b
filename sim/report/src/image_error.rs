//! Error of a picture against its reference: PSNR, SSIM and FLIP.
//!
//! Each measure has a weakness: PSNR weighs a wrong pixel by its squared error wherever it is, SSIM is sensitive to
//! structure and hardly to colour, FLIP models a person who alternates between the two pictures.

use image::{DynamicImage, RgbaImage};
use lodestream_render::image_compare::{CompareError, compare};
use lodestream_scenario::picture::ImageError;

/// Pixels per degree of visual angle for FLIP: a monitor 0.7 m wide with 3840 pixels at a distance of 0.7 m, as in the
/// paper.
pub const PIXELS_PER_DEGREE: f32 = 67.0;

/// Compares a picture with its reference, ignoring opacity. Values are rounded: decibels to four decimals, the others
/// to six.
///
/// # Errors
/// [`CompareError`] if sizes differ or there is no pixel.
pub fn image_error(picture: &RgbaImage, reference: &RgbaImage) -> Result<ImageError, CompareError> {
    let ssim = compare(picture, reference, None)?.ssim;
    let decimals = |value: f64, count: i32| (value * 10_f64.powi(count)).round() / 10_f64.powi(count);
    Ok(ImageError {
        psnr_db: psnr_db(picture, reference).map(|db| decimals(db, 4)),
        ssim: decimals(ssim, 6),
        flip: decimals(flip(picture, reference), 6),
    })
}

/// 10 log₁₀(255² / mean squared difference) of pictures of one size; `None` for equal ones.
fn psnr_db(a: &RgbaImage, b: &RgbaImage) -> Option<f64> {
    let (mut squares, mut count) = (0_u64, 0_u64);
    for (p, q) in a.pixels().zip(b.pixels()) {
        for channel in 0..3 {
            squares += u64::from(p[channel].abs_diff(q[channel])).pow(2);
            count += 1;
        }
    }
    (squares > 0).then(|| 10.0 * (255.0 * 255.0 * count as f64 / squares as f64).log10())
}

/// Mean of the FLIP map of two pictures of one size, by the authors' code (crate `nv-flip`).
pub(crate) fn flip(picture: &RgbaImage, reference: &RgbaImage) -> f64 {
    let map = flip_map(picture, reference);
    map.iter().copied().map(f64::from).sum::<f64>() / map.len().max(1) as f64
}

/// Mean FLIP over the pixels that `covered` selects, in rows from the top.
pub(crate) fn flip_of(picture: &RgbaImage, reference: &RgbaImage, covered: &[bool]) -> f64 {
    let map = flip_map(picture, reference);
    let of_covered =
        || map.iter().zip(covered).filter(|(_, covered)| **covered).map(|(flip, _)| f64::from(*flip));
    of_covered().sum::<f64>() / of_covered().count().max(1) as f64
}

fn flip_map(picture: &RgbaImage, reference: &RgbaImage) -> Vec<f32> {
    let image = |rgba: &RgbaImage| {
        let rgb = DynamicImage::from(rgba.clone()).into_rgb8();
        nv_flip::FlipImageRgb8::with_data(rgb.width(), rgb.height(), &rgb)
    };
    nv_flip::flip(image(reference), image(picture), PIXELS_PER_DEGREE).to_vec()
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::Rgba;

    const SIZE_PX: [u32; 2] = [64, 48];

    /// Noise and gradients in integers, so that other programs can generate the same picture.
    fn picture() -> RgbaImage {
        RgbaImage::from_fn(SIZE_PX[0], SIZE_PX[1], |x, y| {
            let noise = [(x * x * 3 + y * 7) % 256, (x * 5 + y * y * 2 + 31) % 256, ((x ^ y) * 4 + 17) % 256];
            let slope = [x * 2 + 20, y * 3 + 10, x + y + 40];
            let [r, g, b] = [0, 1, 2].map(|i| ((noise[i] / 4 + slope[i]) % 256) as u8);
            Rgba([r, g, b, 255])
        })
    }

    fn noisy(picture: &RgbaImage) -> RgbaImage {
        RgbaImage::from_fn(SIZE_PX[0], SIZE_PX[1], |x, y| {
            let n = ((x * 7919 + y * 104_729 + x * y * 31) % 23) as i32 - 11;
            let [r, g, b, a] = picture.get_pixel(x, y).0;
            let add = |value: u8, n: i32| (i32::from(value) + n).clamp(0, 255) as u8;
            Rgba([add(r, n), add(g, -n), add(b, n.div_euclid(2)), a])
        })
    }

    fn patched(picture: &RgbaImage) -> RgbaImage {
        let mut patched = picture.clone();
        for (x, y) in (30..50).flat_map(|x| (10..22).map(move |y| (x, y))) {
            patched.put_pixel(x, y, Rgba([250, 40, 60, 255]));
        }
        patched
    }

    fn shifted(picture: &RgbaImage) -> RgbaImage {
        let [width, height] = SIZE_PX;
        RgbaImage::from_fn(width, height, |x, y| *picture.get_pixel((x + width - 2) % width, y))
    }

    #[test]
    fn values_are_those_of_independent_programs() {
        // Computed in Python: PSNR and (after the paper) FLIP with numpy 2; SSIM by scikit-image
        // (gaussian_weights=True, sigma=1.5, use_sample_covariance=False), whose mean omits five pixels at the border.
        let reference = picture();
        let inner: Vec<bool> = (0..SIZE_PX[0] * SIZE_PX[1])
            .map(|i| (i % SIZE_PX[0], i / SIZE_PX[0]))
            .map(|(x, y)| (5..SIZE_PX[0] - 5).contains(&x) && (5..SIZE_PX[1] - 5).contains(&y))
            .collect();
        for (name, picture, psnr_db, ssim, flip) in [
            ("noise", noisy(&reference), 32.785_712, 0.993_388_10, 0.060_654),
            ("patch", patched(&reference), 19.996_650, 0.926_559_67, 0.095_429),
            ("shift", shifted(&reference), 20.322_532, 0.677_877_20, 0.178_661),
        ] {
            let found = image_error(&picture, &reference).unwrap();
            let inner_ssim = compare(&picture, &reference, Some(&inner)).unwrap().ssim;
            assert!((found.psnr_db.unwrap() - psnr_db).abs() < 1e-4, "{name}: {found:?}");
            assert!((inner_ssim - ssim).abs() < 1e-7, "{name}: {inner_ssim}");
            // The authors' code computes in 32 bits.
            assert!((found.flip - flip).abs() < 2e-5, "{name}: {found:?}");
        }
    }

    #[test]
    fn equal_pictures_have_no_error_whatever_their_opacity() {
        let mut clear = picture();
        clear.pixels_mut().for_each(|pixel| pixel[3] = 7);
        let none = ImageError { psnr_db: None, ssim: 1.0, flip: 0.0 };
        assert_eq!(image_error(&picture(), &picture()), Ok(none));
        assert_eq!(image_error(&clear, &picture()), Ok(none));
        assert_eq!(serde_json::to_string(&none).unwrap(), r#"{"psnr_db":null,"ssim":1.0,"flip":0.0}"#);
    }

    #[test]
    fn black_and_white_have_the_largest_error() {
        let flat = |value| RgbaImage::from_pixel(32, 32, Rgba([value, value, value, 255]));
        let found = image_error(&flat(0), &flat(255)).unwrap();
        assert_eq!(found.psnr_db, Some(0.0));
        // C1 / (255² + C1): only luminance differs, and it is stabilised by a ten-thousandth.
        assert!((found.ssim - 0.0001 / 1.0001).abs() < 1e-6, "{found:?}");
        assert!(found.flip > 0.9 && found.flip <= 1.0, "{found:?}");
        // One step of 8 bits everywhere: 20 log 255.
        let step = image_error(&flat(100), &flat(101)).unwrap();
        assert_eq!(step.psnr_db, Some(48.1308));
        assert!(step.ssim > 0.999 && step.flip < 0.05, "{step:?}");
    }

    #[test]
    fn psnr_and_ssim_are_symmetric_and_all_three_grow_with_the_difference() {
        let (a, b) = (picture(), patched(&picture()));
        let (there, back) = (image_error(&a, &b).unwrap(), image_error(&b, &a).unwrap());
        assert_eq!((there.psnr_db, there.ssim), (back.psnr_db, back.ssim));
        // FLIP's steps are symmetric too, up to rounding.
        assert!((there.flip - back.flip).abs() < 1e-5, "{there:?} {back:?}");
        let worse = image_error(&shifted(&b), &a).unwrap();
        assert!(worse.psnr_db < there.psnr_db && worse.ssim < there.ssim && worse.flip > there.flip);
        assert!(image_error(&a, &RgbaImage::new(4, 4)).is_err());
    }
}
