//! Options of an assessment.

use lodestream_bake::preparation_settings::{
    BlockFaces, CoarseGrid, CodecChoice, LevelShare, PositionBits, RegionFaces, Round, TopRegions,
};
use lodestream_geometry::Metric;

/// Options of an assessment.
#[derive(Clone, Copy, Debug)]
pub struct Options {
    /// Bits per axis of positions.
    pub position_bits: PositionBits,
    /// Faces per region.
    pub region_faces: RegionFaces,
    /// Share of the removable vertices that one level removes.
    pub level_share: LevelShare,
    /// Regions merged into one at the top.
    pub top_regions: TopRegions,
    /// [`lodestream_geometry::Settings::coarse_grid`].
    pub coarse_grid: CoarseGrid,
    /// Most faces simplified at once.
    pub block_faces: BlockFaces,
    /// Cost function of collapses.
    pub metric: Metric,
    /// Order of collapses.
    pub round: Round,
    /// Codec of base mesh and chunks; bytes are those stored and sent.
    pub codec: CodecChoice,
    /// Omits texture coordinates, normals and colours.
    pub positions_only: bool,
    /// Number of random ancestor-closed cuts whose stated error is compared with the measured distance.
    pub random_sets: usize,
    /// Points sampled on each surface per distance.
    pub samples: usize,
    /// Seed of all random numbers.
    pub seed: u64,
}
