//! Numeric settings with their ranges.

use std::fmt;
use std::str::FromStr;

use lodestream_geometry::Settings;
use lodestream_geometry::quantise::{
    DEFAULT_NORMAL_TOLERANCE, DEFAULT_POSITION_BITS, DEFAULT_UV_BITS, MAX_POSITION_BITS, MAX_UV_BITS,
    MIN_POSITION_BITS,
};

use lodestream_import::setting;
use lodestream_import::setting::InvalidValue;

setting! {
    /// Bits per axis of positions. Each more costs about 3 bits a vertex.
    PositionBits(u8), MIN_POSITION_BITS..=MAX_POSITION_BITS, "bits"
}
setting! {
    /// Bits per axis of texture coordinates.
    UvBits(u8), 1..=MAX_UV_BITS, "bits"
}
setting! {
    /// Largest angle between a source normal and the normal of its faces for which the former is dropped: 0 keeps all, 180
    /// none.
    NormalTolerance(f64), 0.0..=180.0, "degrees"
}
setting! {
    /// Depth of relief, in units of texture coordinates.
    ReliefDepth(f32), 0.0..=1.0, "units of texture coordinates"
}
setting! {
    /// Share of the vertices that one round of collapses takes.
    RoundShare(f64), Settings::ROUND_SHARE, "of the vertices"
}
setting! {
    /// Faces per region: fewer follow the view more closely, with more chunks.
    RegionFaces(usize), Settings::REGION_FACES, "faces"
}
setting! {
    /// Share of the removable vertices that one level removes: more means fewer levels, in coarser steps.
    LevelShare(f64), Settings::LEVEL_SHARE, "of the removable vertices"
}
setting! {
    /// Regions merged into one at the top: more means fewer levels and a larger first step.
    TopRegions(f64), Settings::TOP_REGIONS, "regions"
}
setting! {
    /// Distance of the points of a level's grid of positions over the level's error; 0 keeps one grid.
    CoarseGrid(f64), Settings::COARSE_GRID, "of the level's error"
}
setting! {
    /// Most faces simplified at once: larger meshes are simplified in blocks.
    BlockFaces(usize), Settings::BLOCK_FACES, "faces"
}

setting! {
    /// Most faces of a batch.
    BatchFaces(usize), 1_000..=10_000_000, "faces"
}

impl Eq for PositionBits {}
impl Eq for UvBits {}
impl Eq for RegionFaces {}
impl Eq for BatchFaces {}

impl Default for PositionBits {
    fn default() -> Self {
        Self(DEFAULT_POSITION_BITS)
    }
}

impl Default for UvBits {
    fn default() -> Self {
        Self(DEFAULT_UV_BITS)
    }
}

impl Default for NormalTolerance {
    fn default() -> Self {
        Self(DEFAULT_NORMAL_TOLERANCE)
    }
}

impl Default for RegionFaces {
    fn default() -> Self {
        Self(Settings::default().region_faces)
    }
}

impl Default for LevelShare {
    fn default() -> Self {
        Self(Settings::default().level_share)
    }
}

impl Default for TopRegions {
    fn default() -> Self {
        Self(Settings::default().top_regions)
    }
}

impl Default for BlockFaces {
    fn default() -> Self {
        Self(Settings::default().block_faces)
    }
}

impl Default for BatchFaces {
    /// A larger batch has a smaller first frame and fewer bytes in all (docs/design/batches.md); a smaller one is
    /// prepared sooner after a change of its members.
    fn default() -> Self {
        Self(393_216)
    }
}

impl Default for CoarseGrid {
    fn default() -> Self {
        Self(Settings::default().coarse_grid)
    }
}

/// Largest distance between a source position and its grid point, in the asset's units; determines the number of bits.
#[derive(Clone, Copy, Debug, PartialEq, PartialOrd)]
pub struct Tolerance(f64);

impl Tolerance {
    /// The length.
    #[must_use]
    pub const fn get(self) -> f64 {
        self.0
    }
}

impl TryFrom<f64> for Tolerance {
    type Error = InvalidValue;

    fn try_from(length: f64) -> Result<Self, InvalidValue> {
        if length.is_finite() && length > 0.0 {
            return Ok(Self(length));
        }
        Err(InvalidValue::new("a positive length is possible", length.to_string()))
    }
}

impl FromStr for Tolerance {
    type Err = InvalidValue;

    fn from_str(text: &str) -> Result<Self, InvalidValue> {
        let none = |_| InvalidValue::new("a positive length is possible", format!("{text:?}"));
        text.parse().map_err(none).and_then(|length: f64| Self::try_from(length))
    }
}

impl fmt::Display for Tolerance {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

/// Order of collapses within a region.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Round {
    /// The cheapest first.
    #[default]
    Heap,
    /// Rounds of collapses that share no face, each of this share of the vertices.
    Share(RoundShare),
}

impl Round {
    /// The setting of simplification: `None` for the heap.
    #[must_use]
    pub fn share(self) -> Option<f64> {
        match self {
            Self::Heap => None,
            Self::Share(share) => Some(share.get()),
        }
    }

    fn refusal(given: impl Into<String>) -> InvalidValue {
        let (low, high) = (RoundShare::RANGE.start(), RoundShare::RANGE.end());
        InvalidValue::new(
            format!("heap, or a share of the vertices from {low} to {high}, is possible"),
            given,
        )
    }
}

impl TryFrom<f64> for Round {
    type Error = InvalidValue;

    fn try_from(share: f64) -> Result<Self, InvalidValue> {
        RoundShare::try_from(share).map(Self::Share).map_err(|_| Self::refusal(share.to_string()))
    }
}

impl FromStr for Round {
    type Err = InvalidValue;

    fn from_str(text: &str) -> Result<Self, InvalidValue> {
        if text == "heap" {
            return Ok(Self::Heap);
        }
        text.parse().map(Self::Share).map_err(|_: InvalidValue| Self::refusal(format!("{text:?}")))
    }
}

impl fmt::Display for Round {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Heap => f.write_str("heap"),
            Self::Share(share) => share.fmt(f),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The limits themselves are valid, as text and as numbers; values beyond them are refused.
    macro_rules! ends {
        ($name:ident: $low:literal, $high:literal, not $below:literal, $above:literal) => {
            for (text, number) in [(stringify!($low), $low), (stringify!($high), $high)] {
                assert_eq!(text.parse::<$name>().unwrap().get(), number);
                assert_eq!($name::try_from(number).unwrap().to_string().parse(), $name::try_from(number));
            }
            for text in [stringify!($below), stringify!($above), "", "x", "nan", "-1"] {
                let refusal = text.parse::<$name>().unwrap_err().to_string();
                assert!(refusal.ends_with("is not"), "{refusal}");
            }
            assert!($name::try_from($above).is_err());
        };
    }

    #[test]
    fn the_ends_of_each_range_are_possible_and_nothing_beyond() {
        ends!(PositionBits: 4, 24, not 3, 25);
        ends!(UvBits: 1, 16, not 0, 17);
        ends!(NormalTolerance: 0.0, 180.0, not -0.1, 180.1);
        ends!(ReliefDepth: 0.0, 1.0, not -0.1, 1.1);
        ends!(RoundShare: 0.01, 0.5, not 0.0, 0.51);
        ends!(RegionFaces: 50, 20000, not 49, 20001);
        ends!(LevelShare: 0.1, 0.9, not 0.0, 0.91);
        ends!(TopRegions: 0.25, 16.0, not 0.2, 16.1);
        ends!(CoarseGrid: 0.0, 4.0, not -0.1, 4.1);
        ends!(BatchFaces: 1000, 10000000, not 999, 10000001);
    }

    #[test]
    fn defaults_are_possible() {
        assert_eq!(PositionBits::try_from(PositionBits::default().get()), Ok(PositionBits::default()));
        assert_eq!(UvBits::try_from(UvBits::default().get()), Ok(UvBits::default()));
        let degrees = NormalTolerance::default();
        assert_eq!(NormalTolerance::try_from(degrees.get()), Ok(degrees));
        assert_eq!(RegionFaces::try_from(RegionFaces::default().get()), Ok(RegionFaces::default()));
        assert_eq!(LevelShare::try_from(LevelShare::default().get()), Ok(LevelShare::default()));
        assert_eq!(TopRegions::try_from(TopRegions::default().get()), Ok(TopRegions::default()));
        assert_eq!(CoarseGrid::try_from(CoarseGrid::default().get()), Ok(CoarseGrid::default()));
    }

    #[test]
    fn a_tolerance_is_a_positive_length() {
        assert_eq!("1e-3".parse::<Tolerance>().unwrap().get(), 0.001);
        for bad in ["0", "-1", "inf", "nan", "wide"] {
            let refusal = bad.parse::<Tolerance>().unwrap_err().to_string();
            assert!(refusal.starts_with("a positive length is possible"), "{refusal}");
        }
    }

    #[test]
    fn a_round_is_the_heap_or_a_share() {
        assert_eq!("heap".parse(), Ok(Round::Heap));
        assert_eq!("0.2".parse::<Round>().unwrap().share(), Some(0.2));
        assert_eq!(Round::try_from(0.2).unwrap().to_string(), "0.2");
        for bad in ["0", "0.6", "nan", "some"] {
            let refusal = bad.parse::<Round>().unwrap_err().to_string();
            assert!(refusal.contains("heap, or a share") && refusal.contains(bad), "{refusal}");
        }
    }

    #[test]
    fn a_refusal_says_what_is_possible_and_what_was_given() {
        assert_eq!(
            PositionBits::try_from(25).unwrap_err().to_string(),
            "4 to 24 bits are possible; 25 is not"
        );
        let words = "many".parse::<RegionFaces>().unwrap_err().to_string();
        assert_eq!(words, "50 to 20000 faces are possible; \"many\" is not");
    }
}
