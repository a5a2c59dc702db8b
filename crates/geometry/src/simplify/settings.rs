//! Settings of a preparation, and what they may be set to.

use std::fmt;
use std::ops::RangeInclusive;
use std::str::FromStr;

use crate::entropy::Codec;
use crate::name::UnknownName;

/// What a half-edge collapse is held to cost; `qem`, `melax`, `clustering` or `clustering-seams` in words.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Metric {
    /// The quadric error metric of Garland and Heckbert (1997): squared distances to the planes of the
    /// faces that a vertex stands for, and of its boundary and seam edges.
    #[default]
    Qem,
    /// Edge length × curvature, from the faces as they are (Melax, "A simple, fast, and effective
    /// polygon reduction algorithm", 1998); no face may turn by more than 90°.
    Melax,
    /// The size of the smallest cell of an octree that holds both ends, so that what shares a cell becomes one vertex,
    /// the finest cells first: vertex clustering (Rossignac and Borrel, "Multi-resolution 3D approximations for rendering
    /// complex scenes", 1993) with the weights of Low and Tan ("Model simplification using vertex-clustering", 1997)
    /// saying which vertex stays. Looks at no face and no seam; a baseline.
    Clustering,
    /// The same, but a vertex of a seam goes along its seam as long as any can.
    ClusteringSeams,
}

impl Metric {
    /// All that there are.
    pub const ALL: [Self; 4] = [Self::Qem, Self::Melax, Self::Clustering, Self::ClusteringSeams];

    /// Whether the cost looks at nothing but where vertices are.
    pub(crate) fn clusters(self) -> bool {
        matches!(self, Self::Clustering | Self::ClusteringSeams)
    }
}

impl fmt::Display for Metric {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Qem => "qem",
            Self::Melax => "melax",
            Self::Clustering => "clustering",
            Self::ClusteringSeams => "clustering-seams",
        })
    }
}

impl FromStr for Metric {
    type Err = UnknownName;

    fn from_str(name: &str) -> Result<Self, UnknownName> {
        let known = Self::ALL.into_iter().find(|metric| metric.to_string() == name);
        known.ok_or_else(|| UnknownName::new("qem, melax, clustering or clustering-seams", name))
    }
}

/// Settings of a preparation. Each has its range beside it, outside of which [`crate::prepare::prepare`] refuses it
/// ([`Settings::check`]).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// Faces per region ([`Self::REGION_FACES`]). Smaller regions follow the view more closely but lock more
    /// outlines (worse meshes at equal size) and need more chunks and index bytes.
    pub region_faces: usize,
    /// Share of the removable vertices that one level removes ([`Self::LEVEL_SHARE`]). More means fewer levels, so
    /// fewer ancestors per chunk, but coarser steps.
    pub level_share: f64,
    /// Regions that are merged into one at the top ([`Self::TOP_REGIONS`]): once no more faces are left than so many
    /// regions hold (40,000 at most), one region of all of them goes as far as the base mesh's error
    /// allows. More means fewer levels and slightly fewer bytes in all, but a larger first step, which no
    /// view can do without; it is simplified on one thread.
    pub top_regions: f64,
    /// Largest error of the base mesh as a share of the bounding box's diagonal ([`Self::BASE_ERROR`]).
    pub base_error: f64,
    /// Fewest splits of a chunk ([`Self::MIN_SPLITS`]); what falls short is left to the next level.
    pub min_splits: usize,
    /// Parts of a chunk ([`Self::PARTS`]): between them a client may stop. More follow the view and a limit on
    /// faces more closely, and cost index bytes.
    pub parts: usize,
    /// Fewest splits of a part ([`Self::MIN_SPLITS`]).
    pub min_part_splits: usize,
    /// What a collapse is held to cost.
    pub metric: Metric,
    /// `None`: the cheapest collapse of a region first, from a heap. `Some(share)`: rounds of
    /// collapses that share no face, each of this share of the vertices
    /// ([`Self::ROUND_SHARE`]): coarser.
    pub round_share: Option<f64>,
    /// How the result is coded. [`Codec::Zstd`] has no stopping points, whatever `parts` says, and [`Codec::AxisAligned`] one
    /// grid, whatever `coarse_grid` says.
    pub codec: Codec,
    /// How far apart the points of a level's grid of positions may be, as a share of the median of the errors of
    /// the level's regions ([`Self::COARSE_GRID`]); 0 keeps one grid for all levels. More makes coarse levels smaller and
    /// the whole larger: what a coarse grid leaves out comes later.
    pub coarse_grid: f64,
    /// Most faces that are simplified at once ([`Self::BLOCK_FACES`]): a mesh of more is cut into spatial blocks, whose
    /// finest levels are made one block after the other. It bounds memory (some 280 bytes a face): outlines of blocks
    /// stay for these levels, and errors are stated about a quarter above what they are on the level behind them.
    pub block_faces: usize,
    /// Lets each region of the finest level collapse one vertex of its outline, which tears the mesh.
    /// Only for showing that the checks notice.
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
    /// Range of [`Self::region_faces`]. Its end: a level's regions hold up to twice the faces asked for, and faces
    /// that share nothing have three vertices each; one chunk then still splits fewer than its decoder accepts.
    pub const REGION_FACES: RangeInclusive<usize> = 50..=20_000;
    /// Range of [`Self::level_share`].
    pub const LEVEL_SHARE: RangeInclusive<f64> = 0.1..=0.9;
    /// Range of [`Self::top_regions`].
    pub const TOP_REGIONS: RangeInclusive<f64> = 0.25..=16.0;
    /// Range of [`Self::base_error`].
    pub const BASE_ERROR: RangeInclusive<f64> = 0.0..=1.0;
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

    /// Whether every setting is in its range.
    ///
    /// # Errors
    /// Names the first that is not, with its range.
    pub fn check(&self) -> Result<(), SettingsError> {
        let whole = |setting, value: usize, range: RangeInclusive<usize>| {
            if range.contains(&value) {
                return Ok(());
            }
            let (least, most) = range.into_inner();
            Err(SettingsError {
                setting,
                value: value.to_string(),
                least: least.to_string(),
                most: most.to_string(),
            })
        };
        let real = |setting, value: f64, range: RangeInclusive<f64>| {
            // Not a number is in no range.
            if range.contains(&value) {
                return Ok(());
            }
            let (least, most) = range.into_inner();
            Err(SettingsError {
                setting,
                value: value.to_string(),
                least: least.to_string(),
                most: most.to_string(),
            })
        };
        whole("region faces", self.region_faces, Self::REGION_FACES)?;
        real("level share", self.level_share, Self::LEVEL_SHARE)?;
        real("top regions", self.top_regions, Self::TOP_REGIONS)?;
        real("base error", self.base_error, Self::BASE_ERROR)?;
        whole("fewest splits of a chunk", self.min_splits, Self::MIN_SPLITS)?;
        whole("parts of a chunk", self.parts, Self::PARTS)?;
        whole("fewest splits of a part", self.min_part_splits, Self::MIN_SPLITS)?;
        if let Some(share) = self.round_share {
            real("round share", share, Self::ROUND_SHARE)?;
        }
        real("coarse grid", self.coarse_grid, Self::COARSE_GRID)?;
        whole("faces of a block", self.block_faces, Self::BLOCK_FACES)
    }
}

/// A setting that is out of its range.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{setting} {value} is out of range: {least} to {most}")]
pub struct SettingsError {
    /// What is set.
    pub setting: &'static str,
    /// What it is set to.
    pub value: String,
    /// The least that it may be.
    pub least: String,
    /// The most.
    pub most: String,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_setting_is_refused_outside_its_range_and_accepted_at_its_ends() {
        type Set = fn(&mut Settings, f64);
        let settings: [(&str, Set, f64, f64); 10] = [
            ("region faces", |s, x| s.region_faces = x as usize, 50.0, 20_000.0),
            ("level share", |s, x| s.level_share = x, 0.1, 0.9),
            ("top regions", |s, x| s.top_regions = x, 0.25, 16.0),
            ("base error", |s, x| s.base_error = x, 0.0, 1.0),
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
            // Whole numbers have nothing below none.
            if least != 0.0 || name == "base error" {
                assert_eq!(checked(set, least - 1.0), Err(name));
            }
        }
        assert_eq!(checked(|s, x| s.level_share = x, f64::NAN), Err("level share"));
    }

    #[test]
    fn a_metric_is_read_by_the_name_that_it_shows() {
        for metric in Metric::ALL {
            assert_eq!(metric.to_string().parse(), Ok(metric));
        }
        let refusal = "best".parse::<Metric>().unwrap_err();
        assert_eq!(
            refusal.to_string(),
            "qem, melax, clustering or clustering-seams is possible; \"best\" is not"
        );
    }

    #[test]
    fn the_message_says_what_and_which_range() {
        let settings = Settings { top_regions: f64::INFINITY, ..Settings::default() };
        assert_eq!(settings.check().unwrap_err().to_string(), "top regions inf is out of range: 0.25 to 16");
    }
}
