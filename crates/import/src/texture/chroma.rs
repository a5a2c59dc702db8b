//! Errors of chroma, of which lossy WebP keeps half the resolution.

use image::{ExtendedColorType, ImageError};

use super::encode::Rectangle;
use super::quality::TextureQuality;
use super::webp;

/// Mean squared error of the chroma, of 255², up to which WebP is taken without comparison. Photographs have 0.3 to 5,
/// coloured lines of a texel, as of bricks far away, 20 to 90, and look washed out.
const SMALL_ERROR: f64 = 8.0;
/// How many times as large WebP's error must be for JPEG with full chroma to be taken: noise has as large errors in both,
/// and takes up to three times the bytes as JPEG; lines have a quarter in JPEG.
const WORTH: f64 = 2.0;
/// Lost chroma up to which WebP's error is not measured: what it adds is below [`SMALL_ERROR`] then.
const LITTLE_LOST: f64 = 2.0;

/// The lossy file of an opaque picture: WebP, or JPEG where that saves chroma.
pub(super) fn lossy(
    rgb: &[u8],
    whole: Rectangle<'_>,
    quality: TextureQuality,
) -> Result<Vec<u8>, ImageError> {
    let (width, height) = (whole.width, whole.height);
    if width.max(height) > webp::MAX_SIDE_PX {
        return whole.jpeg(quality.jpeg());
    }
    let lost = lost(rgb, width as usize);
    let file = webp::opaque(rgb, (width, height), lost, quality)?;
    if whole.format == ExtendedColorType::L8 || lost <= LITTLE_LOST {
        return Ok(file);
    }
    let off = error(&file, rgb)?;
    if off > SMALL_ERROR {
        let full = whole.jpeg(quality.jpeg())?;
        if WORTH * error(&full, rgb)? <= off {
            return Ok(full);
        }
    }
    Ok(file)
}

/// Mean squared error of a file's chroma (ITU-T T.871).
fn error(file: &[u8], rgb: &[u8]) -> Result<f64, ImageError> {
    let coded = image::load_from_memory(file)?.into_rgb8();
    let pairs = coded.as_raw().as_chunks::<3>().0.iter().zip(rgb.as_chunks::<3>().0);
    let square = |(a, b): (&[u8; 3], &[u8; 3])| {
        let ([u, v], [s, t]) = (chroma(*a), chroma(*b));
        u128::from((u - s).unsigned_abs().pow(2) + (v - t).unsigned_abs().pow(2))
    };
    let sum: u128 = pairs.map(square).sum();
    Ok(mean_square(sum, rgb.len()))
}

/// Mean squared error of a picture's chroma where two by two texels share their mean.
pub(super) fn lost(rgb: &[u8], width: usize) -> f64 {
    let rows = rgb.chunks_exact(3 * width);
    if width < 2 || rows.len() < 2 {
        return f64::INFINITY;
    }
    let rows: Vec<&[u8]> = rows.collect();
    let mut sum = 0;
    for [upper, lower] in rows.as_chunks::<2>().0 {
        let pairs = upper.as_chunks::<6>().0.iter().zip(lower.as_chunks::<6>().0);
        for (upper, lower) in pairs {
            let texels =
                |pair: &[u8; 6]| [[pair[0], pair[1], pair[2]], [pair[3], pair[4], pair[5]]].map(chroma);
            let ([a, b], [c, d]) = (texels(upper), texels(lower));
            let four = [a, b, c, d];
            for c in 0..2 {
                let total: i64 = four.iter().map(|texel| texel[c]).sum();
                let squares: i64 = four.iter().map(|texel| texel[c] * texel[c]).sum();
                // The squares of the distances from the mean.
                sum += u128::from((squares - total * total / 4).unsigned_abs());
            }
        }
    }
    mean_square(sum, rgb.len())
}

/// Chroma in 1/1000 of a step, so that sums are exact.
fn chroma([r, g, b]: [u8; 3]) -> [i64; 2] {
    let [r, g, b] = [r, g, b].map(i64::from);
    [-169 * r - 331 * g + 500 * b, 500 * r - 419 * g - 81 * b]
}

/// The mean of squares of [`chroma`] that were added up over so many bytes.
fn mean_square(sum: u128, bytes: usize) -> f64 {
    sum as f64 / 2e6 / (bytes.max(3) as f64 / 3.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lost_chroma_is_what_differs_within_squares() {
        let picture = |texel: fn(usize, usize) -> [u8; 3]| -> Vec<u8> {
            (0..7 * 6).flat_map(|i| texel(i % 7, i / 7)).collect()
        };
        let of = |texel| lost(&picture(texel), 7);
        assert_eq!(of(|x, y| [(x + 7 * y) as u8; 3]), 0.0, "grey");
        assert_eq!(of(|x, y| [(x / 2 * 60) as u8, (y / 2 * 90) as u8, 9]), 0.0, "squares");
        // Columns of red and black: half of red's chroma off in all but the last column.
        let off = (0.169_f64.powi(2) + 0.5_f64.powi(2)) * 50.0_f64.powi(2) / 2.0 * 6.0 / 7.0;
        let columns = of(|x, _| [100 * (x % 2) as u8, 0, 0]);
        assert!((columns - off).abs() < 0.01, "{columns} {off}");
        assert_eq!(lost(&[1, 2, 3], 1), f64::INFINITY);
    }
}
