//! What to assess, and how.

use lodestream_bake::preparation_settings::{
    BlockFaces, CoarseGrid, CodecChoice, LevelShare, PositionBits, RegionFaces, Round, TopRegions,
};
use lodestream_geometry::Metric;

/// What to assess, and how.
#[derive(Clone, Copy, Debug)]
pub struct Options {
    /// Bits per axis of positions.
    pub position_bits: PositionBits,
    /// Faces per region.
    pub region_faces: RegionFaces,
    /// Share of the removable vertices that one level removes.
    pub level_share: LevelShare,
    /// Regions that are merged into one at the top.
    pub top_regions: TopRegions,
    /// [`lodestream_geometry::Settings::coarse_grid`].
    pub coarse_grid: CoarseGrid,
    /// Most faces that are simplified at once.
    pub block_faces: BlockFaces,
    /// What a collapse is held to cost.
    pub metric: Metric,
    /// Order of collapses.
    pub round: Round,
    /// How base mesh and chunks are coded; bytes are those stored and sent.
    pub codec: CodecChoice,
    /// Leaves out texture coordinates, normals and colours.
    pub positions_only: bool,
    /// Random ancestor-closed cuts whose stated error is compared with the measured distance.
    pub random_sets: usize,
    /// Points on each surface for every distance.
    pub samples: usize,
    /// Seed of everything random.
    pub seed: u64,
}
