//! `lodestream-sim ink-cost`: arguments; prints a line per view and part of ink.

use std::path::PathBuf;

use anyhow::Context as _;
use clap::Args;
use lodestream_report::pictures::frame_time::MAX_FRAMES;
use lodestream_report::pictures::ink::ink_cost;
use lodestream_scene::description::Camera;

use super::occlusion_errors::camera;
use crate::arguments::DrawnCase;

/// The plan must have one case, which runs with its first seed.
#[derive(Debug, Args)]
pub(crate) struct InkCostOf {
    #[command(flatten)]
    case: DrawnCase,
    /// A camera besides the scene's own, as X,Y,Z,X,Y,Z: position and target; may be given more than once.
    #[arg(long, value_name = "CAMERA", value_parser = camera, allow_hyphen_values = true)]
    view: Vec<Camera>,
    /// Timed frames of each.
    #[arg(long, default_value_t = 9, value_parser = clap::value_parser!(u32).range(1..=i64::from(MAX_FRAMES)))]
    frames: u32,
    /// Write the pictures into this folder.
    #[arg(long, value_name = "FOLDER")]
    pictures: Option<PathBuf>,
}

impl InkCostOf {
    pub(crate) fn run(&self) -> anyhow::Result<()> {
        self.case.run(|plan, scene, gpu| {
            ink_cost(plan, scene, gpu, &self.view, self.frames, |name, picture| {
                let Some(folder) = &self.pictures else { return Ok(()) };
                let file = folder.join(format!("{name}.png"));
                let fail = || format!("{}: cannot be written", file.display());
                std::fs::create_dir_all(folder).with_context(fail)?;
                picture.save(&file).with_context(fail)
            })
        })
    }
}
