//! Settings of a preparation, with their ranges.

use std::fmt;
use std::ops::RangeInclusive;
use std::str::FromStr;

use crate::entropy::Codec;
use crate::name::{Named, UnknownName};

/// Cost of a half-edge collapse, named `qem`, `melax`, `clustering` or `clustering-seams`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Metric {
    /// Quadric error metric of Garland and Heckbert (1997): squared distances to the planes of the faces that a
    /// vertex represents, and of its boundary and seam edges.
    #[default]
    Qem,
    /// Edge length × curvature of the current faces (Melax, "A simple, fast, and effective polygon reduction
    /// algorithm", 1998); no face may turn by more than 90°.
    Melax,
    /// Vertex clustering (Rossignac and Borrel, "Multi-resolution 3D approximations for rendering complex scenes",
    /// 1993): the cost is the size of the smallest octree cell that contains both ends, so vertices in a common cell
    /// merge, finest cells first. The weights of Low and Tan ("Model simplification using vertex-clustering", 1997)
    /// select the remaining vertex. Ignores faces and seams; a baseline.
    Clustering,
    /// Clustering in which seam vertices collapse along their seam as long as any can.
    ClusteringSeams,
}

impl Metric {
    /// Whether the cost depends on vertex positions only.
    pub(crate) fn clusters(self) -> bool {
        matches!(self, Self::Clustering | Self::ClusteringSeams)
    }
}

impl Named for Metric {
    const ALL: &'static [Self] = &[Self::Qem, Self::Melax, Self::Clustering, Self::ClusteringSeams];

    fn name(self) -> &'static str {
        match self {
            Self::Qem => "qem",
            Self::Melax => "melax",
            Self::Clustering => "clustering",
            Self::ClusteringSeams => "clustering-seams",
        }
    }
}

impl fmt::Display for Metric {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for Metric {
    type Err = UnknownName;

    fn from_str(name: &str) -> Result<Self, UnknownName> {
        Self::from_name(name)
    }
}

/// Settings of a preparation. Each has a range; [`crate::prepare::prepare`] refuses values outside it
/// ([`Settings::check`]).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// Faces per region ([`Self::REGION_FACES`]). Smaller regions follow the view more closely but lock more outlines
    /// (worse meshes of equal size) and need more chunks and index bytes.
    pub region_faces: usize,
    /// Share of the removable vertices that one level removes ([`Self::LEVEL_SHARE`]). More means fewer levels, so
    /// fewer ancestors per chunk, but coarser steps.
    pub level_share: f64,
    /// Number of regions merged into one at the top ([`Self::TOP_REGIONS`]): when the remaining faces fit into this
    /// many regions (40,000 at most), a single region is simplified as far as the base mesh's error allows. More
    /// means fewer levels and slightly fewer bytes in total, but a larger first step, which every view needs; it is
    /// simplified on one thread.
    pub top_regions: f64,
    /// Largest error of the base mesh as a share of the bounding box's diagonal ([`Self::BASE_ERROR`]).
    pub base_error: f64,
    /// In meshes with parts, the side of a square that is visible at the base mesh's error, as a share of that
    /// ([`Self::VISIBLE_SIDE`]). Components of such a size do not vanish, the 256 largest; less means a base mesh of more
    /// bytes that looks more like the input.
    pub visible_side: f64,
    /// Fewest splits per chunk ([`Self::MIN_SPLITS`]); regions with fewer are left to the next level.
    pub min_splits: usize,
    /// Parts of a chunk ([`Self::PARTS`]), separated by truncation points. More parts follow the view and a face
    /// budget more closely, and cost index bytes.
    pub parts: usize,
    /// Fewest splits per part ([`Self::MIN_SPLITS`]).
    pub min_part_splits: usize,
    /// Cost of a collapse.
    pub metric: Metric,
    /// `None`: the cheapest collapse of a region first, from a heap. `Some(share)`: rounds of collapses that share no
    /// face, each with this share of the vertices ([`Self::ROUND_SHARE`]); lower quality.
    pub round_share: Option<f64>,
    /// Codec. [`Codec::Zstd`] has no truncation points, whatever `parts` is, and [`Codec::AxisAligned`] has one grid,
    /// whatever `coarse_grid` is.
    pub codec: Codec,
    /// Spacing of a level's position grid, as a share of the median error of the level's regions
    /// ([`Self::COARSE_GRID`]); 0 uses one grid for all levels. Larger values make coarse levels smaller and the
    /// total larger, since omitted bits are coded later.
    pub coarse_grid: f64,
    /// Most faces that are simplified at once ([`Self::BLOCK_FACES`]). Larger meshes are cut into spatial blocks,
    /// whose finest levels are simplified one block after the other. Bounds memory (some 280 bytes per face). Block
    /// outlines stay locked in these levels, and the errors of the level after them are overestimated by about a
    /// quarter.
    pub block_faces: usize,
    /// Lets each region of the finest level collapse one outline vertex, which tears the mesh. Only for testing that
    /// checks detect it.
    #[doc(hidden)]
    pub unlock_outlines: bool,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            region_faces: 1000,
            level_share: 2.0 / 3.0,
            top_regions: 1.5,
            base_error: 0.042,
            visible_side: 1.0,
            min_splits: 32,
            parts: 4,
            min_part_splits: 32,
            metric: Metric::Qem,
            round_share: None,
            codec: Codec::Range,
            coarse_grid: 0.7,
            block_faces: 4_000_000,
            unlock_outlines: false,
        }
    }
}

impl Settings {
    /// Range of [`Self::region_faces`]. The upper end: a region may have twice the requested faces, and unconnected
    /// faces have three vertices each; one chunk must still have no more splits than its decoder accepts.
    pub const REGION_FACES: RangeInclusive<usize> = 50..=20_000;
    /// Range of [`Self::level_share`].
    pub const LEVEL_SHARE: RangeInclusive<f64> = 0.1..=0.9;
    /// Range of [`Self::top_regions`].
    pub const TOP_REGIONS: RangeInclusive<f64> = 0.25..=16.0;
    /// Range of [`Self::base_error`].
    pub const BASE_ERROR: RangeInclusive<f64> = 0.0..=1.0;
    /// Range of [`Self::visible_side`].
    pub const VISIBLE_SIDE: RangeInclusive<f64> = 0.01..=1000.0;
    /// Range of [`Self::min_splits`] and [`Self::min_part_splits`].
    pub const MIN_SPLITS: RangeInclusive<usize> = 1..=20_000;
    /// Range of [`Self::parts`].
    pub const PARTS: RangeInclusive<usize> = 1..=16;
    /// Range of [`Self::round_share`].
    pub const ROUND_SHARE: RangeInclusive<f64> = 0.01..=0.5;
    /// Range of [`Self::coarse_grid`].
    pub const COARSE_GRID: RangeInclusive<f64> = 0.0..=4.0;
    /// Range of [`Self::block_faces`].
    pub const BLOCK_FACES: RangeInclusive<usize> = 100..=100_000_000;

    /// Checks that every setting is in its range.
    ///
    /// # Errors
    /// Names the first setting that is not, with its range.
    pub fn check(&self) -> Result<(), SettingsError> {
        check_range("region faces", self.region_faces, Self::REGION_FACES)?;
        check_range("level share", self.level_share, Self::LEVEL_SHARE)?;
        check_range("top regions", self.top_regions, Self::TOP_REGIONS)?;
        check_range("base error", self.base_error, Self::BASE_ERROR)?;
        check_range("visible side", self.visible_side, Self::VISIBLE_SIDE)?;
        check_range("fewest splits of a chunk", self.min_splits, Self::MIN_SPLITS)?;
        check_range("parts of a chunk", self.parts, Self::PARTS)?;
        check_range("fewest splits of a part", self.min_part_splits, Self::MIN_SPLITS)?;
        if let Some(share) = self.round_share {
            check_range("round share", share, Self::ROUND_SHARE)?;
        }
        check_range("coarse grid", self.coarse_grid, Self::COARSE_GRID)?;
        check_range("faces of a block", self.block_faces, Self::BLOCK_FACES)
    }
}

/// Checks that a setting's value is in its range. NaN is in none.
fn check_range<T: PartialOrd + fmt::Display>(
    setting: &'static str,
    value: T,
    range: RangeInclusive<T>,
) -> Result<(), SettingsError> {
    if range.contains(&value) {
        return Ok(());
    }
    let (least, most) = range.into_inner();
    Err(SettingsError { setting, value: value.to_string(), least: least.to_string(), most: most.to_string() })
}

/// A setting out of its range.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{setting} {value} is out of range: {least} to {most}")]
pub struct SettingsError {
    /// Name of the setting.
    pub setting: &'static str,
    /// Its value.
    pub value: String,
    /// The minimum.
    pub least: String,
    /// The maximum.
    pub most: String,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_setting_is_refused_outside_its_range_and_accepted_at_its_ends() {
        type Set = fn(&mut Settings, f64);
        let settings: [(&str, Set, f64, f64); 11] = [
            ("region faces", |s, x| s.region_faces = x as usize, 50.0, 20_000.0),
            ("level share", |s, x| s.level_share = x, 0.1, 0.9),
            ("top regions", |s, x| s.top_regions = x, 0.25, 16.0),
            ("base error", |s, x| s.base_error = x, 0.0, 1.0),
            ("visible side", |s, x| s.visible_side = x, 0.01, 1000.0),
            ("fewest splits of a chunk", |s, x| s.min_splits = x as usize, 1.0, 20_000.0),
            ("parts of a chunk", |s, x| s.parts = x as usize, 1.0, 16.0),
            ("fewest splits of a part", |s, x| s.min_part_splits = x as usize, 1.0, 20_000.0),
            ("round share", |s, x| s.round_share = Some(x), 0.01, 0.5),
            ("coarse grid", |s, x| s.coarse_grid = x, 0.0, 4.0),
            ("faces of a block", |s, x| s.block_faces = x as usize, 100.0, 100_000_000.0),
        ];
        let checked = |set: Set, x: f64| {
            let mut settings = Settings::default();
            set(&mut settings, x);
            settings.check().map_err(|e| e.setting)
        };
        assert_eq!(Settings::default().check(), Ok(()));
        for (name, set, least, most) in settings {
            assert_eq!([least, most].map(|x| checked(set, x)), [Ok(()); 2], "{name}");
            assert_eq!(checked(set, most + 1.0), Err(name));
            // Unsigned settings have nothing below 0.
            if least != 0.0 || name == "base error" {
                assert_eq!(checked(set, least - 1.0), Err(name));
            }
        }
        assert_eq!(checked(|s, x| s.level_share = x, f64::NAN), Err("level share"));
    }

    #[test]
    fn metric_names_round_trip() {
        for &metric in Metric::ALL {
            assert_eq!(metric.to_string().parse(), Ok(metric));
        }
        let refusal = "best".parse::<Metric>().unwrap_err();
        assert_eq!(
            refusal.to_string(),
            "qem, melax, clustering or clustering-seams is possible; \"best\" is not"
        );
    }

    #[test]
    fn the_message_names_setting_and_range() {
        let settings = Settings { top_regions: f64::INFINITY, ..Settings::default() };
        assert_eq!(settings.check().unwrap_err().to_string(), "top regions inf is out of range: 0.25 to 16");
    }
}
