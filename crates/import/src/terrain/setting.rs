//! Settings of a terrain: each is one type with one range, for command lines and scene files.
//!
//! | setting | type | possible |
//! |---|---|---|
//! | finest level, cells of a patch | [`FinestLevel`] | 1 to 12; 2 to 4096, powers of two |
//! | roughness | [`Roughness`] | 0 to below 2 |
//! | distribution | [`Distribution`](lodestream_terrain::Distribution) | `uniform`, `gaussian` |
//! | passes of erosion | [`ErosionPasses`] | 0 to 32 |
//! | talus, as a share of the amplitude or as a slope | [`Talus`], [`TalusSlope`] | 0 to below 1; 0 to below 90° |
//! | limit of spikes | [`SpikeLimit`] | 0 (off) to below 16 |
//!
//! Constraints between several of them are checked by [`Parameters::check`](lodestream_terrain::Parameters::check).

use lodestream_scene::terrain::MAX_EROSION_PASSES;
use lodestream_terrain::MAX_FINEST_LEVEL;

use crate::setting;
use crate::setting::InvalidValue;

setting! {
    /// The finest level n: a patch has 2^n cells along each side.
    FinestLevel(u8), 1..=MAX_FINEST_LEVEL, "levels"
}
setting! {
    /// Factor on the range of offsets from level to level: 0.5 is smooth, 1 keeps it.
    Roughness(f64), below 0.0..2.0, "times the range of the level above"
}
setting! {
    /// Passes of thermal erosion, up to the number that a scene's terrain may have; 0 disables it.
    ErosionPasses(u8), 0..=MAX_EROSION_PASSES, "passes"
}
setting! {
    /// Talus: height difference of neighbours at the eroded level below which nothing slides, as a share of the amplitude.
    Talus(f64), below 0.0..1.0, "times the amplitude"
}
setting! {
    /// Talus as a slope: up to it nothing slides.
    TalusSlope(f64), below 0.0..90.0, "degrees"
}
setting! {
    /// Most that a point may rise above its neighbours, in ranges of the eroded level's offsets; 0 keeps spikes.
    SpikeLimit(f64), below 0.0..16.0, "ranges of offsets"
}

impl FinestLevel {
    /// The level whose patches have this many cells along each side.
    ///
    /// # Errors
    /// Counts that are not powers of two or out of range.
    pub fn of_patch_cells(cells: u32) -> Result<Self, InvalidValue> {
        let level =
            cells.checked_ilog2().filter(|_| cells.is_power_of_two()).and_then(|n| u8::try_from(n).ok());
        level.and_then(|level| Self::try_from(level).ok()).ok_or_else(|| {
            let (least, most) = (1_u32 << Self::RANGE.start(), 1_u32 << Self::RANGE.end());
            InvalidValue::new(format!("a power of two from {least} to {most} is possible"), cells.to_string())
        })
    }
}

impl Roughness {
    /// The nearest value that a terrain can have, in 32768ths ([`Parameters::roughness`](lodestream_terrain::Parameters::roughness)).
    #[must_use]
    pub fn in_parameters(self) -> u16 {
        nearest(self.get() * 32_768.0)
    }
}

impl Talus {
    /// The share of a height difference in an amplitude of the same unit, clamped to the largest possible value.
    #[must_use]
    pub fn of_rise(rise: f64, amplitude: u32) -> Self {
        Self((rise / f64::from(amplitude.max(1))).clamp(0.0, 1.0_f64.next_down()))
    }

    /// The nearest value that a terrain can have, in 65536ths ([`Erosion::talus`](lodestream_terrain::Erosion::talus)).
    #[must_use]
    pub fn in_parameters(self) -> u16 {
        nearest(self.get() * 65_536.0)
    }
}

impl TalusSlope {
    /// Rise of the slope over a length, in the length's unit.
    #[must_use]
    pub fn rise(self, length: f64) -> f64 {
        self.get().to_radians().tan() * length
    }
}

impl SpikeLimit {
    /// The nearest value that a terrain can have, in 16ths
    /// ([`Erosion::spike_limit`](lodestream_terrain::Erosion::spike_limit)): 0 for 0 alone.
    #[must_use]
    pub fn in_parameters(self) -> u8 {
        let sixteenths = (self.get() * 16.0).round() as u8;
        if self.get() > 0.0 { sixteenths.max(1) } else { 0 }
    }
}

/// The nearest 16-bit number.
fn nearest(x: f64) -> u16 {
    x.round() as u16
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_ends_of_each_range_are_possible_and_nothing_beyond() {
        assert_eq!(["1", "12"].map(|n| n.parse::<FinestLevel>().unwrap().get()), [1, 12]);
        assert!(["0", "13", "-1", "x"].iter().all(|n| n.parse::<FinestLevel>().is_err()));
        assert_eq!(["0", "32"].map(|n| n.parse::<ErosionPasses>().unwrap().get()), [0, 32]);
        assert!("33".parse::<ErosionPasses>().is_err());
        assert_eq!(["0", "1.99999"].map(|x| x.parse::<Roughness>().unwrap().in_parameters()), [0, u16::MAX]);
        assert_eq!("0.5".parse::<Roughness>().unwrap().in_parameters(), lodestream_terrain::HALVING);
        assert_eq!(["0", "0.999999"].map(|x| x.parse::<Talus>().unwrap().in_parameters()), [0, u16::MAX]);
        assert_eq!(
            ["0", "0.001", "1", "15.99"].map(|x| x.parse::<SpikeLimit>().unwrap().in_parameters()),
            [0, 1, 16, 255]
        );
        for (refusal, possible) in [
            ("2".parse::<Roughness>().unwrap_err(), "0 to below 2 times the range of the level above"),
            ("nan".parse::<Talus>().unwrap_err(), "0 to below 1 times the amplitude"),
            ("90".parse::<TalusSlope>().unwrap_err(), "0 to below 90 degrees"),
            ("16".parse::<SpikeLimit>().unwrap_err(), "0 to below 16 ranges of offsets"),
        ] {
            let refusal = refusal.to_string();
            assert!(refusal.starts_with(possible) && refusal.ends_with("is not"), "{refusal}");
        }
    }

    #[test]
    fn patches_have_a_power_of_two_of_cells() {
        assert_eq!([2, 256, 4096].map(|n| FinestLevel::of_patch_cells(n).unwrap().get()), [1, 8, 12]);
        for cells in [0, 1, 3, 4095, 8192, u32::MAX] {
            let refusal = FinestLevel::of_patch_cells(cells).unwrap_err().to_string();
            assert_eq!(refusal, format!("a power of two from 2 to 4096 is possible; {cells} is not"));
        }
    }

    #[test]
    fn a_slope_is_a_share_of_the_amplitude_and_never_more_than_there_is() {
        let of = |degrees: f64, amplitude| {
            Talus::of_rise(TalusSlope::try_from(degrees).unwrap().rise(1.0), amplitude).in_parameters()
        };
        assert_eq!(of(45.0, 4), 1 << 14);
        assert_eq!((of(0.0, 4), of(89.0, 4), of(45.0, 0)), (0, u16::MAX, u16::MAX));
    }
}
