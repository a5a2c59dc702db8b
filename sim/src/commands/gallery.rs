//! `lodestream-sim gallery`: arguments; writes a page.

use std::path::PathBuf;

use clap::Args;
use lodestream_report::pictures::frame_time::MAX_FRAMES;
use lodestream_report::pictures::gallery::gallery;
use lodestream_scene::description::Camera;

use super::occlusion_errors::camera;
use crate::arguments::DrawnCase;

/// The plan must have one case, which runs with its first seed.
#[derive(Debug, Args)]
pub(crate) struct Gallery {
    #[command(flatten)]
    case: DrawnCase,
    /// Timed frames of each picture, after two untimed ones.
    #[arg(long, default_value_t = 9, value_parser = clap::value_parser!(u32).range(1..=i64::from(MAX_FRAMES)))]
    frames: u32,
    /// A second camera, as X,Y,Z,X,Y,Z: position and target.
    #[arg(long, value_name = "CAMERA", value_parser = camera, allow_hyphen_values = true)]
    view: Option<Camera>,
    /// Folder of the page and its pictures; created if missing.
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
}

impl Gallery {
    pub(crate) fn run(&self) -> anyhow::Result<()> {
        self.case.run(|plan, scene, gpu| gallery(plan, scene, gpu, self.frames, self.view, &self.output))
    }
}
