//! Random offsets: a hash of (seed, level, finest x, finest y), so that a point's offset depends on nothing else and
//! is identical on all machines.

use super::parameters::{Distribution, Parameters};

/// 2^64 divided by the golden ratio, odd.
const GOLDEN: u64 = 0x9e37_79b9_7f4a_7c15;

/// The finaliser of SplitMix64 (Steele, Lea and Flood 2014; constants by Stafford, "mix 13").
#[inline(always)]
fn mix(mut z: u64) -> u64 {
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// Offsets of one level's new points.
#[derive(Clone, Copy, Debug)]
pub(super) struct LevelNoise {
    key: u64,
    range: u32,
    distribution: Distribution,
    /// Distance of neighbouring points of the level in finest grid units, as a shift.
    shift: u32,
}

impl LevelNoise {
    /// The offsets of `level` (0 to the finest), with range `range`.
    pub(super) fn new(parameters: &Parameters, level: u8, range: u32) -> Self {
        Self {
            key: mix(parameters.seed.wrapping_add(mix(u64::from(level) + 1))),
            range,
            distribution: parameters.distribution,
            shift: u32::from(parameters.finest_level - level),
        }
    }

    /// The offsets of one row, from column `x` of the level on. Each row is a stream of SplitMix64: a step in x
    /// increments its counter, a step in y changes the key, so the noise is not symmetric in x and y.
    #[inline(always)]
    pub(super) fn row(&self, x: i64, y: i64) -> RowNoise {
        let key = mix(self.key.wrapping_add((y << self.shift).cast_unsigned().wrapping_mul(GOLDEN)));
        RowNoise {
            at: key.wrapping_add((x << self.shift).cast_unsigned().wrapping_mul(GOLDEN)),
            step: GOLDEN << self.shift,
        }
    }

    /// Whether offsets are sums of four parts; otherwise uniform.
    pub(super) fn is_gaussian(&self) -> bool {
        self.distribution == Distribution::Gaussian
    }

    /// Converts a hash to an offset. `GAUSSIAN` must equal [`Self::is_gaussian`].
    #[inline(always)]
    pub(super) fn offset<const GAUSSIAN: bool>(&self, hash: u64) -> i32 {
        if GAUSSIAN {
            // The sum of four 16-bit parts has variance 2^32 / 3, so 2^16 of it are one range.
            let parts = (hash & 0xffff) + (hash >> 16 & 0xffff) + (hash >> 32 & 0xffff) + (hash >> 48);
            let centred = parts.cast_signed() - 2 * 0xffff;
            #[expect(
                clippy::cast_possible_truncation,
                reason = "at most two ranges, and a range is below 2^29"
            )]
            let offset = ((centred * i64::from(self.range) + (1 << 15)) >> 16) as i32;
            offset
        } else {
            // Lemire, "Fast random integer generation in an interval", 2019; the bias is below range / 2^32.
            let count = 2 * u64::from(self.range) + 1;
            (((hash >> 32) * count) >> 32) as i32 - self.range.cast_signed()
        }
    }

    /// The offset of one point, in points of the level.
    pub(super) fn at(&self, x: i64, y: i64) -> i32 {
        let hash = self.row(x, y).hash(0);
        if self.is_gaussian() { self.offset::<true>(hash) } else { self.offset::<false>(hash) }
    }
}

/// The hashes of one row.
#[derive(Clone, Copy, Debug)]
pub(super) struct RowNoise {
    at: u64,
    step: u64,
}

impl RowNoise {
    /// The hash of the point `columns` to the right of the row's first one.
    #[inline(always)]
    pub(super) fn hash(&self, columns: usize) -> u64 {
        mix(self.at.wrapping_add(self.step.wrapping_mul(columns as u64)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn noise(distribution: Distribution) -> LevelNoise {
        let parameters = Parameters { distribution, ..Parameters::default() };
        LevelNoise::new(&parameters, 8, 1000)
    }

    #[test]
    fn offsets_have_the_mean_and_variance_of_their_range() {
        for (distribution, reach) in [(Distribution::Uniform, 1000), (Distribution::Gaussian, 2000)] {
            let noise = noise(distribution);
            let (mut sum, mut squares, mut most) = (0.0, 0.0, 0);
            for i in 0..100_000 {
                let offset = noise.at(i % 331 - 100, i / 331 - 100);
                sum += f64::from(offset);
                squares += f64::from(offset).powi(2);
                most = most.max(offset.abs());
            }
            let (mean, variance) = (sum / 1e5, squares / 1e5);
            assert!(mean.abs() < 8.0, "{distribution:?}: mean {mean}");
            assert!((variance / (1e6 / 3.0) - 1.0).abs() < 0.02, "{distribution:?}: variance {variance}");
            assert!(most <= reach && most > reach * 4 / 5, "{distribution:?}: at most {most}");
        }
    }

    #[test]
    fn neighbours_mirrors_and_levels_are_unrelated() {
        let noise = noise(Distribution::Uniform);
        let coarse = LevelNoise::new(&Parameters::default(), 7, 1000);
        let correlation = |other: &dyn Fn(i64, i64) -> i32| {
            let sum: f64 = (0..40_000)
                .map(|i| (i % 200 - 100, i / 200 - 50))
                .map(|(x, y)| f64::from(noise.at(x, y)) * f64::from(other(x, y)))
                .sum();
            sum / 40_000.0 / (1e6 / 3.0)
        };
        assert!(correlation(&|x, y| noise.at(x, y)) > 0.98);
        type Other<'a> = (&'a str, &'a dyn Fn(i64, i64) -> i32);
        let others: [Other<'_>; 6] = [
            ("swapped", &|x, y| noise.at(y, x + 1000)),
            ("right", &|x, y| noise.at(x + 1, y)),
            ("below", &|x, y| noise.at(x, y + 1)),
            ("mirrored", &|x, y| noise.at(-x - 1, y)),
            ("negated", &|x, y| noise.at(-x - 1, -y - 1)),
            ("of another level", &|x, y| coarse.at(x, y)),
        ];
        for (what, other) in others {
            let r = correlation(other);
            assert!(r.abs() < 0.025, "{what}: {r}");
        }
    }
}
