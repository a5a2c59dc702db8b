//! `lodestream-sim relief-worth`: arguments; prints two tables.

use std::path::PathBuf;

use anyhow::Context as _;
use clap::Args;
use lodestream_render::Gpu;
use lodestream_report::pictures::frame_time::MAX_FRAMES;
use lodestream_report::pictures::relief_worth::{ANGLES, DISTANCES_M, Question, relief_worth};

use crate::arguments::CacheFolder;
use crate::print::print;

#[derive(Debug, Args)]
pub(crate) struct ReliefWorth {
    /// Texels along a side of the height maps; twice as many give the mesh four times as many faces.
    #[arg(long, default_value_t = 128, value_parser = clap::value_parser!(u16).range(8..=1024))]
    texels: u16,
    /// Timed frames of each method in each view, after two untimed ones.
    #[arg(long, default_value_t = 5, value_parser = clap::value_parser!(u32).range(1..=i64::from(MAX_FRAMES)))]
    frames: u32,
    #[command(flatten)]
    cache: CacheFolder,
    /// Only send; draw nothing.
    #[arg(long, conflicts_with = "pictures")]
    sent_only: bool,
    /// Write the pictures into this folder.
    #[arg(long, value_name = "FOLDER")]
    pictures: Option<PathBuf>,
    /// Print JSON instead of tables.
    #[arg(long)]
    json: bool,
}

/// Width and height of the pictures.
const SIZE_PX: [u32; 2] = [640, 360];

impl ReliefWorth {
    pub(crate) fn run(&self) -> anyhow::Result<()> {
        let question = Question {
            texels: self.texels.into(),
            size_px: SIZE_PX,
            distances_m: &DISTANCES_M,
            angles: &ANGLES,
            frames: self.frames,
        };
        let gpu = || Gpu::headless().context("frames are to be drawn");
        let gpu = (!self.sent_only).then(gpu).transpose()?;
        let worth = relief_worth(&question, gpu, &self.cache.path()?, |name, picture| {
            let Some(folder) = &self.pictures else { return Ok(()) };
            let file = folder.join(format!("{name}.png"));
            let fail = || format!("{}: cannot be written", file.display());
            std::fs::create_dir_all(folder).with_context(fail)?;
            picture.save(&file).with_context(fail)
        })?;
        print(&worth, self.json)
    }
}
