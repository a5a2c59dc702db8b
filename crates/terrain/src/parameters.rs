//! The parameters of a terrain: 24 bytes that determine every height.

use std::fmt;
use std::str::FromStr;

use lodestream_geometry::{DecodeError, Named, UnknownName};

use super::error::TerrainError;

/// Bytes of encoded [`Parameters`].
pub const PARAMETERS_BYTES: usize = 24;
/// Largest [`Parameters::finest_level`]: patches of 4097 x 4097 points.
pub const MAX_FINEST_LEVEL: u8 = 12;
/// Largest magnitude of heights without features, so that the sum of four fits an `i32`.
pub const MAX_BASE_HEIGHT: u64 = (1 << 29) - 1;
/// Roughness at which the range of offsets is halved from level to level.
pub const HALVING: u16 = 1 << 14;

/// Distribution of the random offsets, named `uniform` or `gaussian`. Both have the same variance, a third of the
/// squared range.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Distribution {
    /// Uniform in ± the range.
    #[default]
    Uniform,
    /// The sum of four uniform parts (Irwin–Hall): nearly Gaussian, but at most ± twice the range.
    Gaussian,
}

impl Distribution {
    /// The largest offset, in units of the range.
    pub(super) fn reach(self) -> u64 {
        match self {
            Self::Uniform => 1,
            Self::Gaussian => 2,
        }
    }
}

impl Named for Distribution {
    const ALL: &'static [Self] = &[Self::Uniform, Self::Gaussian];

    fn name(self) -> &'static str {
        match self {
            Self::Uniform => "uniform",
            Self::Gaussian => "gaussian",
        }
    }
}

impl fmt::Display for Distribution {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for Distribution {
    type Err = UnknownName;

    fn from_str(name: &str) -> Result<Self, UnknownName> {
        Self::from_name(name)
    }
}

/// Smoothing after generation: removal of spikes, then thermal erosion. Off by default.
///
/// Cost: heights of a patch need a margin of [`Erosion::margin`] points of [`Erosion::level`] around it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Erosion {
    /// The eroded level, 0 to the finest level. Coarser levels are subsets of it, finer ones add detail.
    pub level: u8,
    /// Passes of thermal erosion; 0 is off. Each moves material by at most one point.
    pub passes: u8,
    /// Height difference between neighbouring points up to which nothing slides, in 65536ths of the amplitude.
    pub talus: u16,
    /// Largest distance of a point from the range of its eight neighbours, in 16ths of the range of offsets at the
    /// eroded level; 0 is off.
    pub spike_limit: u8,
}

impl Erosion {
    /// Whether any smoothing is on.
    #[must_use]
    pub fn is_on(&self) -> bool {
        self.passes > 0 || self.spike_limit > 0
    }

    /// Margin, in points of the eroded level, around a rectangle that its heights depend on.
    #[must_use]
    pub fn margin(&self) -> usize {
        usize::from(self.passes) + usize::from(self.spike_limit > 0)
    }
}

/// Everything that determines a terrain without features.
///
/// Lengths are grid units of the finest level, heights are height units; the scene defines their size in metres.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Parameters {
    /// Seed of the random offsets.
    pub seed: u64,
    /// n, 1 to [`MAX_FINEST_LEVEL`]: a patch has 2^n + 1 points along each side.
    pub finest_level: u8,
    /// e: the world has the patches −2^e to 2^e − 1 in both axes. n + e may be at most 31.
    pub extent_log2: u8,
    /// Distribution of the offsets.
    pub distribution: Distribution,
    /// Range of the offsets of patch corners (level 0), in height units.
    pub amplitude: u32,
    /// Factor on the range from level to level, in 32768ths: [`HALVING`] is smooth, 32768 keeps it.
    pub roughness: u16,
    /// Mean height, in height units.
    pub base: i32,
    /// Smoothing.
    pub erosion: Erosion,
}

impl Default for Parameters {
    /// Patches of 257 x 257 points in the largest world; ranges halve per level.
    fn default() -> Self {
        Self {
            seed: 0,
            finest_level: 8,
            extent_log2: 23,
            distribution: Distribution::Uniform,
            amplitude: 1 << 16,
            roughness: HALVING,
            base: 0,
            erosion: Erosion::default(),
        }
    }
}

impl Parameters {
    /// The range of the offsets of each level, 0 to the finest, in height units, rounded.
    #[must_use]
    pub fn ranges(&self) -> Vec<u32> {
        // 16 fractional bits: at most 2^32 × 2^16 here; growth ends where it would overflow.
        let mut range = u64::from(self.amplitude) << 16;
        let mut ranges = Vec::with_capacity(usize::from(self.finest_level) + 1);
        for _ in 0..=self.finest_level {
            ranges.push(u32::try_from((range + (1 << 15)) >> 16).unwrap_or(u32::MAX));
            range = ((range * u64::from(self.roughness)) >> 15).min(u64::from(u32::MAX) << 16);
        }
        ranges
    }

    /// The largest possible magnitude of heights without features.
    #[must_use]
    pub fn worst_height(&self) -> u64 {
        let ranges = self.ranges();
        // Averages stay within their inputs' range; a level adds an offset to centres, and another to the midpoints
        // that average those.
        let sum: u64 = ranges.iter().map(|&r| 2 * u64::from(r)).sum::<u64>() - u64::from(ranges[0]);
        u64::from(self.base.unsigned_abs()) + self.distribution.reach() * sum
    }

    /// Checks that the parameters are valid.
    ///
    /// # Errors
    /// If a parameter is out of range, or heights could leave ±[`MAX_BASE_HEIGHT`].
    pub fn check(&self) -> Result<(), TerrainError> {
        let bad = |name, value: i64, range| Err(TerrainError::BadParameter { name, value, range });
        if !(1..=MAX_FINEST_LEVEL).contains(&self.finest_level) {
            return bad("finest level", i64::from(self.finest_level), "1 to 12");
        }
        if u32::from(self.extent_log2) + u32::from(self.finest_level) > 31 {
            return bad("extent", i64::from(self.extent_log2), "0 to 31 less the finest level");
        }
        if self.erosion.level > self.finest_level {
            return bad("erosion level", i64::from(self.erosion.level), "0 to the finest level");
        }
        let worst = self.worst_height();
        if worst > MAX_BASE_HEIGHT {
            return Err(TerrainError::TooHigh { worst, limit: MAX_BASE_HEIGHT });
        }
        Ok(())
    }

    /// Encodes the parameters.
    ///
    /// ```text
    /// seed u64 | n (low 4 bits), erosion level | e (low 5 bits), distribution (bit 5) | amplitude u32 |
    /// roughness u16 | base i32 | passes u8 | talus u16 | spike limit u8        (little-endian)
    /// ```
    #[must_use]
    pub fn encode(&self) -> [u8; PARAMETERS_BYTES] {
        let mut out = [0; PARAMETERS_BYTES];
        out[..8].copy_from_slice(&self.seed.to_le_bytes());
        out[8] = (self.finest_level & 15) | self.erosion.level << 4;
        out[9] = (self.extent_log2 & 31) | u8::from(self.distribution == Distribution::Gaussian) << 5;
        out[10..14].copy_from_slice(&self.amplitude.to_le_bytes());
        out[14..16].copy_from_slice(&self.roughness.to_le_bytes());
        out[16..20].copy_from_slice(&self.base.to_le_bytes());
        out[20] = self.erosion.passes;
        out[21..23].copy_from_slice(&self.erosion.talus.to_le_bytes());
        out[23] = self.erosion.spike_limit;
        out
    }

    /// Decodes and checks the result of [`Self::encode`].
    ///
    /// # Errors
    /// If the bytes are not valid parameters.
    pub fn decode(bytes: &[u8; PARAMETERS_BYTES]) -> Result<Self, DecodeError> {
        let error = |why: String| DecodeError::new("terrain parameters", why);
        if bytes[9] >> 6 != 0 {
            return Err(error(format!("unknown flags {:#04x}", bytes[9] & 0xc0)));
        }
        let parameters = Self {
            seed: u64::from_le_bytes(std::array::from_fn(|i| bytes[i])),
            finest_level: bytes[8] & 15,
            extent_log2: bytes[9] & 31,
            distribution: if bytes[9] & 32 == 0 { Distribution::Uniform } else { Distribution::Gaussian },
            amplitude: u32::from_le_bytes([bytes[10], bytes[11], bytes[12], bytes[13]]),
            roughness: u16::from_le_bytes([bytes[14], bytes[15]]),
            base: i32::from_le_bytes([bytes[16], bytes[17], bytes[18], bytes[19]]),
            erosion: Erosion {
                level: bytes[8] >> 4,
                passes: bytes[20],
                talus: u16::from_le_bytes([bytes[21], bytes[22]]),
                spike_limit: bytes[23],
            },
        };
        parameters.check().map_err(|e| error(e.to_string()))?;
        Ok(parameters)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn distribution_names_round_trip() {
        for distribution in [Distribution::Uniform, Distribution::Gaussian] {
            assert_eq!(distribution.to_string().parse(), Ok(distribution));
        }
        let refusal = "normal".parse::<Distribution>().unwrap_err();
        assert_eq!(refusal.to_string(), "uniform or gaussian is possible; \"normal\" is not");
    }

    proptest! {
        #[test]
        fn bytes_that_decode_are_the_bytes_that_are_written(bytes in any::<[u8; PARAMETERS_BYTES]>(), n in 1u8..13, e in 0u8..64, small in any::<bool>()) {
            let mut bytes = bytes;
            bytes[8] = bytes[8] & 0x70 | n;
            bytes[9] = e;
            if small {
                bytes[13] = 0;
                bytes[15] &= 0x3f;
                bytes[19] = 0;
            }
            if let Ok(parameters) = Parameters::decode(&bytes) {
                prop_assert_eq!(parameters.encode(), bytes);
                prop_assert!(parameters.check().is_ok());
            }
        }
    }

    #[test]
    fn every_field_survives() {
        let parameters = Parameters {
            seed: 0x0123_4567_89ab_cdef,
            finest_level: 11,
            extent_log2: 20,
            distribution: Distribution::Gaussian,
            amplitude: 123_456,
            roughness: 17_000,
            base: -98_765,
            erosion: Erosion { level: 9, passes: 200, talus: 300, spike_limit: 7 },
        };
        assert_eq!(Parameters::decode(&parameters.encode()), Ok(parameters));
    }

    #[test]
    fn parameters_out_of_range_are_refused_with_a_reason() {
        let ok = Parameters::default();
        let refused = |p: Parameters| p.check().unwrap_err().to_string();
        assert!(refused(Parameters { finest_level: 0, ..ok }).contains("finest level is 0, must be 1 to 12"));
        assert!(refused(Parameters { finest_level: 13, ..ok }).contains("finest level is 13"));
        assert!(refused(Parameters { extent_log2: 24, ..ok }).contains("extent is 24"));
        let erosion = Erosion { level: 9, ..Erosion::default() };
        assert!(refused(Parameters { erosion, ..ok }).contains("erosion level is 9"));
        assert!(refused(Parameters { base: i32::MIN, ..ok }).contains("lower the amplitude"));
        assert!(refused(Parameters { amplitude: u32::MAX, roughness: u16::MAX, ..ok }).contains("can reach"));
        let mut bytes = ok.encode();
        bytes[9] |= 0x40;
        assert!(Parameters::decode(&bytes).unwrap_err().to_string().contains("unknown flags 0x40"));
    }

    #[test]
    fn ranges_fall_by_the_roughness() {
        let ranges = Parameters { amplitude: 1000, ..Parameters::default() }.ranges();
        assert_eq!(ranges, [1000, 500, 250, 125, 63, 31, 16, 8, 4]);
    }
}
