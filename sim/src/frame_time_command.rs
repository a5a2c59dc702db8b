//! `lodestream-sim frame-time`: its arguments, and a line for each target.

use std::path::PathBuf;

use anyhow::Context as _;
use clap::Args;
use lodestream_client::render::Gpu;
use lodestream_sim::scenario::pictures::frame_time::{MAX_FRAMES, frame_times};
use lodestream_sim::scenario::{plan, scene};

/// Most targets of a run.
const MAX_TARGETS: usize = 16;

/// The plan must come to one case; it runs with its first seed.
#[derive(Debug, Args)]
pub(crate) struct FrameTimeCommand {
    /// The plan (TOML).
    plan: PathBuf,
    /// Another value for a key of the plan, as "sweep.rate_bits_per_s=16000000"; may be given more than once.
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Screen errors to refine to, in pixels, divided by commas.
    #[arg(long, value_delimiter = ',', default_value = "8,4,2,1,0.5", value_parser = target_px)]
    target_px: Vec<f32>,
    /// Frames of each that are timed, after two that are not.
    #[arg(long, default_value_t = 30, value_parser = clap::value_parser!(u32).range(1..=i64::from(MAX_FRAMES)))]
    frames: u32,
    /// Folder of prepared packs [default: $XDG_CACHE_HOME/lodestream or ~/.cache/lodestream].
    #[arg(long, env = "LODESTREAM_CACHE", value_name = "DIR")]
    cache: Option<PathBuf>,
    /// Prints JSON instead of text.
    #[arg(long)]
    json: bool,
}

/// A screen error on the command line.
pub(crate) fn target_px(text: &str) -> Result<f32, String> {
    match text.parse::<f32>() {
        Ok(px) if (0.01..=1000.0).contains(&px) => Ok(px),
        _ => Err("a screen error from 0.01 to 1000 pixels is needed".to_owned()),
    }
}

impl FrameTimeCommand {
    pub(crate) fn run(&self) -> anyhow::Result<()> {
        anyhow::ensure!(
            self.target_px.len() <= MAX_TARGETS,
            "--target-px names {} targets; {MAX_TARGETS} are the most: each keeps a scene on the graphics device",
            self.target_px.len()
        );
        let plan = plan::read_with(&self.plan, &self.set)?;
        // Before anything is prepared: without an adapter it would be for nothing.
        let gpu = Gpu::headless().context("frames are to be drawn")?;
        let cache = self.cache.clone().or_else(lodestream_server::prepare::cache::default_folder);
        let cache = cache.context("no cache folder is known; name one with --cache DIR")?;
        let one = plan.scenes.first().context("the plan has no scene")?;
        let scene = scene::open(&one.choice, plan.codec, &cache, true)?;
        let times = frame_times(&plan, &scene, gpu, &self.target_px, self.frames)
            .with_context(|| self.plan.display().to_string())?;
        if self.json {
            println!("{}", serde_json::to_string(&times)?);
        } else {
            times.iter().for_each(|time| println!("{time}"));
        }
        Ok(())
    }
}
