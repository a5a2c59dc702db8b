//! Knobs of the simplification.

use crate::entropy::Codec;

/// What a half-edge collapse is held to cost.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Metric {
    /// The quadric error metric of Garland and Heckbert (1997): squared distances to the planes of the
    /// faces that a vertex stands for, and of its boundary and seam edges.
    #[default]
    Qem,
    /// Edge length × curvature, from the faces as they are (Melax, "A simple, fast, and effective
    /// polygon reduction algorithm", 1998); no face may turn by more than 90°.
    Melax,
}

/// Knobs of the simplification.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// Faces per region, 50 to 20,000. Smaller regions follow the view more closely but lock more
    /// outlines (worse meshes at equal size) and need more chunks and index bytes.
    pub region_faces: usize,
    /// Share of the removable vertices that one level removes, 0.1 to 0.9. More means fewer levels, so
    /// fewer ancestors per chunk, but coarser steps.
    pub level_share: f64,
    /// Regions that are merged into one at the top, 0.25 to 16: once no more faces are left than so many
    /// regions hold (40,000 at most), one region of all of them goes as far as the base mesh's error
    /// allows. More means fewer levels and slightly fewer bytes in all, but a larger first step, which no
    /// view can do without; it is simplified on one thread.
    pub top_regions: f64,
    /// Largest error of the base mesh as a share of the bounding box's diagonal.
    pub base_error: f64,
    /// Fewest splits of a chunk; what falls short is left to the next level.
    pub min_splits: usize,
    /// Parts of a chunk, 1 to 16: between them a client may stop. More follow the view and a limit on
    /// faces more closely, and cost index bytes.
    pub parts: usize,
    /// Fewest splits of a part.
    pub min_part_splits: usize,
    /// What a collapse is held to cost.
    pub metric: Metric,
    /// `None`: the cheapest collapse of a region first, from a heap. `Some(share)`: rounds of
    /// collapses that share no face, each of this share of the vertices, 0.01 to 0.5: coarser.
    pub round_share: Option<f64>,
    /// How the result is coded. [`Codec::Plain`] has no stopping points, whatever `parts` says.
    pub codec: Codec,
    /// How far apart the points of a level's grid of positions may be, as a share of the median of the errors of
    /// the level's regions, 0 to 4; 0 keeps one grid for all levels. More makes coarse levels smaller and
    /// the whole larger: what a coarse grid leaves out comes later.
    pub coarse_grid: f64,
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
            unlock_outlines: false,
        }
    }
}
