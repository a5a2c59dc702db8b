//! Bloom: `bloom.wgsl`.

use glam::DVec3;

/// A picture, rows from the top.
#[derive(Clone, Debug, PartialEq)]
pub struct Light {
    /// Width and height, at least 1.
    pub size_px: [u32; 2],
    /// Linear radiance.
    pub texels: Vec<DVec3>,
}

impl Light {
    /// Bilinear lookup, 0 to 1 along the sides, clamped at the border.
    fn at(&self, place: [f64; 2]) -> DVec3 {
        let axis = |i: usize| {
            let along = place[i] * f64::from(self.size_px[i]) - 0.5;
            let low = along.floor();
            let clamp = |x: f64| x.clamp(0.0, f64::from(self.size_px[i] - 1)) as usize;
            (clamp(low), clamp(low + 1.0), along - low)
        };
        let ((left, right, x), (top, bottom, y)) = (axis(0), axis(1));
        let texel = |column: usize, row: usize| self.texels[row * self.size_px[0] as usize + column];
        texel(left, top).lerp(texel(right, top), x).lerp(texel(left, bottom).lerp(texel(right, bottom), x), y)
    }

    fn tap(&self, place: [f64; 2], offset: [f64; 2]) -> DVec3 {
        self.at([0, 1].map(|i| place[i] + offset[i] / f64::from(self.size_px[i])))
    }

    fn sum(&self, place: [f64; 2], offsets: [[f64; 2]; 4]) -> DVec3 {
        offsets.into_iter().map(|offset| self.tap(place, offset)).sum()
    }

    fn filtered(&self, size_px: [u32; 2], filter: impl Fn(&Self, [f64; 2]) -> DVec3) -> Self {
        let all = (0..size_px[1]).flat_map(|y| (0..size_px[0]).map(move |x| [x, y]));
        let place = |pixel: [u32; 2]| [0, 1].map(|i| (f64::from(pixel[i]) + 0.5) / f64::from(size_px[i]));
        Self { size_px, texels: all.map(|pixel| filter(self, place(pixel))).collect() }
    }

    /// Downsampling by 13 lookups (Jimenez 2014).
    #[must_use]
    pub fn halved(&self, size_px: [u32; 2]) -> Self {
        self.filtered(size_px, |from, at| {
            let inner = from.sum(at, corners(1.0));
            0.125 * inner
                + 0.0625 * from.sum(at, sides(2.0))
                + 0.03125 * from.sum(at, corners(2.0))
                + 0.125 * from.tap(at, [0.0; 2])
        })
    }

    /// Upsampling with a 3×3 tent filter, blended with another picture.
    #[must_use]
    pub fn mixed_into(&self, other: &Self, share: f64) -> Self {
        let wide = self.filtered(other.size_px, |from, at| {
            (4.0 * from.tap(at, [0.0; 2]) + 2.0 * from.sum(at, sides(1.0)) + from.sum(at, corners(1.0)))
                / 16.0
        });
        let texels = other.texels.iter().zip(&wide.texels).map(|(a, b)| a.lerp(*b, share)).collect();
        Self { size_px: other.size_px, texels }
    }

    /// The picture with bloom of a strength, over a number of levels.
    #[must_use]
    pub fn bloomed(&self, levels: u32, share: f64) -> Self {
        let mut halves = vec![self.clone()];
        for level in 1..=levels {
            let size = self.size_px.map(|side| (side >> level).max(1));
            halves.push(halves[halves.len() - 1].halved(size));
        }
        let mut wide = halves[levels as usize].clone();
        for level in (1..levels as usize).rev() {
            let larger = (levels as usize - level) as f64;
            wide = wide.mixed_into(&halves[level], larger / (larger + 1.0));
        }
        if levels == 0 { self.clone() } else { wide.mixed_into(self, share) }
    }
}

fn corners(far: f64) -> [[f64; 2]; 4] {
    [[-far, -far], [far, -far], [-far, far], [far, far]]
}

fn sides(far: f64) -> [[f64; 2]; 4] {
    [[0.0, -far], [-far, 0.0], [far, 0.0], [0.0, far]]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_colour_stays_what_it_is_at_any_size() {
        for size_px in [[1, 1], [2, 3], [37, 21], [64, 64]] {
            let one = DVec3::new(0.25, 1.0, 7.0);
            let light = Light { size_px, texels: vec![one; (size_px[0] * size_px[1]) as usize] };
            for levels in 0..=6 {
                let bloomed = light.bloomed(levels, 0.04);
                assert!(
                    bloomed.texels.iter().all(|texel| texel.distance(one) < 1e-12),
                    "{size_px:?} {levels}"
                );
            }
        }
    }

    #[test]
    fn a_bright_pixel_spreads_evenly_and_keeps_its_light() {
        // The four pixels in the middle, so that halving is symmetric.
        let size_px = [256, 256];
        let mut texels = vec![DVec3::ZERO; 256 * 256];
        for (x, y) in [(127, 127), (128, 127), (127, 128), (128, 128)] {
            texels[y * 256 + x] = DVec3::splat(250.0);
        }
        let bloomed = Light { size_px, texels }.bloomed(4, 0.04);
        let sum: f64 = bloomed.texels.iter().map(|texel| texel.x).sum();
        assert!((sum / 1000.0 - 1.0).abs() < 0.03, "{sum}");
        let at = |x: usize, y: usize| bloomed.texels[y * 256 + x].x;
        assert!((240.0..241.0).contains(&at(128, 128)), "{}", at(128, 128));
        let around: Vec<f64> = (1..60).map(|d| at(128 + d, 128)).collect();
        assert!(around.is_sorted_by(|a, b| a >= b) && around[20] > 0.0, "{around:?}");
        for d in [3, 9, 20] {
            let four = [at(128 + d, 128), at(127 - d, 128), at(128, 128 + d), at(128, 127 - d)];
            assert!(four.iter().all(|x| (x / four[0] - 1.0).abs() < 1e-9), "{four:?}");
        }
    }
}
