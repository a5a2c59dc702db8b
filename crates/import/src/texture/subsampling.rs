//! Halving of chroma, as lossy WebP does.

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

/// Chroma (ITU-T T.871) in 1/1000 of a step, so that sums are exact.
pub(super) fn chroma([r, g, b]: [u8; 3]) -> [i64; 2] {
    let [r, g, b] = [r, g, b].map(i64::from);
    [-169 * r - 331 * g + 500 * b, 500 * r - 419 * g - 81 * b]
}

/// The mean of squares of [`chroma`] that were added up over so many bytes.
pub(super) fn mean_square(sum: u128, bytes: usize) -> f64 {
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
