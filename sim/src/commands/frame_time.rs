//! `lodestream-sim frame-time`: arguments; prints a line per target.

use clap::Args;
use lodestream_report::pictures::frame_time::{MAX_FRAMES, frame_times};

use crate::arguments::{DrawnCase, target_px};

/// Most targets of a run.
const MAX_TARGETS: usize = 16;

/// The plan must have one case, which runs with its first seed.
#[derive(Debug, Args)]
pub(crate) struct FrameTime {
    #[command(flatten)]
    case: DrawnCase,
    /// Target screen errors in pixels, separated by commas.
    #[arg(long, value_delimiter = ',', default_value = "8,4,2,1,0.5", value_parser = target_px)]
    target_px: Vec<f32>,
    /// Timed frames of each, after two untimed ones.
    #[arg(long, default_value_t = 30, value_parser = clap::value_parser!(u32).range(1..=i64::from(MAX_FRAMES)))]
    frames: u32,
}

impl FrameTime {
    pub(crate) fn run(&self) -> anyhow::Result<()> {
        anyhow::ensure!(
            self.target_px.len() <= MAX_TARGETS,
            "--target-px names {} targets; {MAX_TARGETS} are the most: each keeps a scene on the graphics device",
            self.target_px.len()
        );
        self.case.run(|plan, scene, gpu| frame_times(plan, scene, gpu, &self.target_px, self.frames))
    }
}
