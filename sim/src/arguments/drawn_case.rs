//! Arguments and output shared by the commands that draw a plan's settled case.

use std::fmt::Display;
use std::path::PathBuf;
use std::sync::Arc;

use anyhow::Context as _;
use clap::Args;
use lodestream_protocol::source::SceneSource;
use lodestream_render::Gpu;
use lodestream_scenario::plan::Plan;
use lodestream_scenario::{plan, scene};
use serde::Serialize;

use super::CacheFolder;

// No doc comment: it would take the place of the command's own in --help.
#[derive(Debug, Args)]
pub(crate) struct DrawnCase {
    /// The plan (TOML).
    plan: PathBuf,
    /// Another value for a key of the plan, as "sweep.rate_bits_per_s=16000000"; may be given more than once.
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
    #[command(flatten)]
    cache: CacheFolder,
    /// Prints JSON instead of text.
    #[arg(long)]
    json: bool,
}

impl DrawnCase {
    /// Opens the plan's scene and the graphics device, passes them to `draw`, and prints the results.
    pub(crate) fn run<T: Display + Serialize>(
        &self,
        draw: impl FnOnce(&Plan, &Arc<dyn SceneSource>, Gpu) -> anyhow::Result<Vec<T>>,
    ) -> anyhow::Result<()> {
        let plan = plan::read_with(&self.plan, &self.set)?;
        // Before anything is prepared: without an adapter preparing would be in vain.
        let gpu = Gpu::headless().context("frames are to be drawn")?;
        let one = plan.scenes.first().context("the plan has no scene")?;
        let scene = scene::open(&one.choice, plan.codec, &self.cache.path()?, true)?;
        let results = draw(&plan, &scene, gpu).with_context(|| self.plan.display().to_string())?;
        if self.json {
            println!("{}", serde_json::to_string(&results)?);
        } else {
            results.iter().for_each(|result| println!("{result}"));
        }
        Ok(())
    }
}
