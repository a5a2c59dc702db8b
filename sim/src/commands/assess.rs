//! `lodestream-sim assess`: its arguments, and what was found.

use std::num::NonZeroU32;
use std::path::PathBuf;

use clap::Args;
use lodestream_assess::assess::{self, Options};
use lodestream_geometry::{Codec, Metric};
use lodestream_server::prepare::recipe::{self, Round};

use crate::print::print;

#[derive(Debug, Args)]
pub(crate) struct Assess {
    /// The model.
    model: PathBuf,
    /// Bits per axis of positions.
    #[arg(long, default_value_t = 12)]
    position_bits: u8,
    /// Faces per region.
    #[arg(long, default_value_t = 1000)]
    region_faces: usize,
    /// Share of the removable vertices that one level removes.
    #[arg(long, default_value_t = lodestream_geometry::Settings::default().level_share)]
    level_share: f64,
    /// Regions that are merged into one at the top, 0.25 to 16.
    #[arg(
        long,
        default_value_t = lodestream_geometry::Settings::default().top_regions,
        value_parser = top_regions
    )]
    top_regions: f64,
    /// Distance of the points of a level's grid of positions over the level's error; 0 for one grid.
    #[arg(long, default_value_t = lodestream_geometry::Settings::default().coarse_grid, value_parser = coarse_grid)]
    coarse_grid: f64,
    /// What a collapse is held to cost: qem or melax.
    #[arg(long, default_value = "qem", value_parser = recipe::parse_metric)]
    metric: Metric,
    /// Order of collapses: heap, or rounds of this share of the vertices.
    #[arg(long, default_value = "heap", value_parser = recipe::parse_round)]
    round_size: Round,
    /// How the geometry is coded: range or zstd.
    #[arg(long, default_value = "range", value_parser = recipe::parse_codec)]
    codec: Codec,
    /// Leaves out texture coordinates, normals and colours.
    #[arg(long)]
    positions_only: bool,
    /// Random closed sets whose stated error is compared with the measured one.
    #[arg(long, default_value_t = 20)]
    random_sets: usize,
    /// Points on each surface.
    #[arg(long, default_value = "200000")]
    samples: NonZeroU32,
    /// Seed of everything random.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Prints one JSON object instead of text.
    #[arg(long)]
    json: bool,
}

fn top_regions(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(regions) if (0.25..=16.0).contains(&regions) => Ok(regions),
        _ => Err("a number of regions from 0.25 to 16 is needed".to_owned()),
    }
}

fn coarse_grid(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(share) if (0.0..=4.0).contains(&share) => Ok(share),
        _ => Err("a share from 0 to 4 is needed".to_owned()),
    }
}

impl Assess {
    pub(crate) fn run(&self) -> anyhow::Result<()> {
        let options = Options {
            position_bits: self.position_bits,
            region_faces: self.region_faces,
            level_share: self.level_share,
            top_regions: self.top_regions,
            coarse_grid: self.coarse_grid,
            metric: self.metric,
            round: self.round_size,
            codec: self.codec,
            positions_only: self.positions_only,
            random_sets: self.random_sets,
            samples: self.samples.get() as usize,
            seed: self.seed,
        };
        print(&assess::assess(&self.model, &options)?, self.json)
    }
}
