//! Sample offsets of SSAO, uploaded with a frame's uniform block.

/// Sample offsets in the unit hemisphere around +z, with weights that sum to the number of samples. Directions are
/// cosine-weighted, so that the mean is the occlusion integral, on a golden-angle spiral. Lengths are even from a
/// tenth of the radius on or, if `centred`, quadratic (Chapman, "SSAO tutorial", 2013) with weights proportional to
/// their spacing.
pub(crate) fn kernel(samples: usize, centred: bool) -> impl ExactSizeIterator<Item = [f64; 4]> {
    // π (3 − √5).
    const GOLDEN_ANGLE: f64 = 2.399_963_229_728_653;
    (0..samples).map(move |i| {
        let u = (i as f64 + 0.5) / samples as f64;
        let (radial, height) = (u.sqrt(), (1.0 - u).sqrt());
        let (sin, cos) = (GOLDEN_ANGLE * i as f64).sin_cos();
        // Decorrelates lengths from directions: 7 is coprime to powers of two.
        let t = ((i * 7) % samples) as f64 / samples as f64;
        let along = t + 0.5 / samples as f64;
        let (share, counts) = if centred { (along * along, 2.0 * along) } else { (along, 1.0) };
        let length = 0.1 + 0.9 * share;
        [radial * cos * length, radial * sin * length, height * length, counts]
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::passes::occlusion::MAX_SAMPLES;

    #[test]
    fn kernel_is_a_cosine_weighted_hemisphere() {
        for (samples, centred) in
            [8, 16, 32, MAX_SAMPLES as usize].into_iter().flat_map(|n| [(n, false), (n, true)])
        {
            let k: Vec<_> = kernel(samples, centred).map(|[x, y, z, counts]| ([x, y, z], counts)).collect();
            let mean = |axis: usize| {
                k.iter().map(|(v, _)| v[axis] / v.iter().map(|x| x * x).sum::<f64>().sqrt()).sum::<f64>()
                    / samples as f64
            };
            // The mean of cos θ under a cosine-weighted distribution is 2/3.
            assert!((mean(2) - 2.0 / 3.0).abs() < 0.02, "{samples}: {}", mean(2));
            assert!(mean(0).abs() < 0.1 && mean(1).abs() < 0.1, "{samples}: {} {}", mean(0), mean(1));
            assert!(k.iter().all(|(v, _)| v[2] > 0.0 && v.iter().map(|x| x * x).sum::<f64>() <= 1.0));
            let counts = k.iter().map(|(_, counts)| counts).sum::<f64>();
            assert!((counts - samples as f64).abs() < 1e-9, "{samples}: {counts}");
            // Both represent lengths that are even along the radius.
            let reach =
                k.iter().map(|(v, counts)| v.iter().map(|x| x * x).sum::<f64>().sqrt() * counts).sum::<f64>()
                    / samples as f64;
            assert!((reach - 0.55).abs() < 0.01, "{samples}: {reach}");
        }
    }
}
