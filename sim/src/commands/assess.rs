//! `lodestream-sim assess`: arguments and output.

use std::path::PathBuf;

use clap::Args;
use lodestream_assess::assess::{self, Options};
use lodestream_bake::preparation_settings::{
    BlockFaces, CoarseGrid, CodecChoice, LevelShare, PositionBits, RegionFaces, Round, TopRegions,
};
use lodestream_geometry::Metric;

use crate::arguments::Sampling;
use crate::print::print;

#[derive(Debug, Args)]
pub(crate) struct Assess {
    /// The model.
    model: PathBuf,
    /// Bits per axis of positions, 4 to 24.
    #[arg(long, default_value = "12")]
    position_bits: PositionBits,
    /// Faces per region, 50 to 20,000.
    #[arg(long, default_value_t = RegionFaces::default())]
    region_faces: RegionFaces,
    /// Share of the removable vertices that one level removes, 0.1 to 0.9.
    #[arg(long, default_value_t = LevelShare::default())]
    level_share: LevelShare,
    /// Regions merged into one at the top, 0.25 to 16.
    #[arg(long, default_value_t = TopRegions::default())]
    top_regions: TopRegions,
    /// Spacing of a level's grid of positions relative to the level's error, 0 to 4; 0 for one grid.
    #[arg(long, default_value_t = CoarseGrid::default())]
    coarse_grid: CoarseGrid,
    /// Most faces simplified at once, 100 to 100,000,000; larger meshes are simplified block by block.
    #[arg(long, default_value_t = BlockFaces::default())]
    block_faces: BlockFaces,
    /// Cost of a collapse: qem, melax, clustering or clustering-seams.
    #[arg(long, default_value_t = Metric::default())]
    metric: Metric,
    /// Order of collapses: heap, or rounds of this share of the vertices, 0.01 to 0.5.
    #[arg(long, default_value = "heap")]
    round_size: Round,
    /// Codec of the geometry: auto, range, axis-aligned or zstd.
    #[arg(long, default_value_t = CodecChoice::default())]
    codec: CodecChoice,
    /// Omit texture coordinates, normals and colours.
    #[arg(long)]
    positions_only: bool,
    /// Number of random ancestor-closed cuts whose stated error is compared with the measured one.
    #[arg(long, default_value_t = 20)]
    random_sets: usize,
    #[command(flatten)]
    sampling: Sampling,
    /// Print one JSON object instead of text.
    #[arg(long)]
    json: bool,
}

impl Assess {
    pub(crate) fn run(&self) -> anyhow::Result<()> {
        let options = Options {
            position_bits: self.position_bits,
            region_faces: self.region_faces,
            level_share: self.level_share,
            top_regions: self.top_regions,
            coarse_grid: self.coarse_grid,
            block_faces: self.block_faces,
            metric: self.metric,
            round: self.round_size,
            codec: self.codec,
            positions_only: self.positions_only,
            random_sets: self.random_sets,
            samples: self.sampling.samples.get() as usize,
            seed: self.sampling.seed,
        };
        print(&assess::assess(&self.model, &options)?, self.json)
    }
}
