//! `lodestream-sim pn-triangles`: arguments and output of each measurement.

use std::fmt::Display;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::Context as _;
use clap::{Args, ValueEnum};
use lodestream_protocol::source::SceneSource;
use lodestream_render::{Gpu, PnTriangles};
use lodestream_report::pictures::frame_time::MAX_FRAMES;
use lodestream_report::pictures::{pn_cost, pn_crowd, pn_waiting};
use lodestream_scenario::plan;
use serde::Serialize;

use crate::arguments::{Beside, CacheFolder};

/// What to measure.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Question {
    /// Errors of pictures while a scene arrives against the settled one, flat and curved; for all cases.
    Waiting,
    /// Cost of the first mesh of a settled case: flat, curved, and with the same triangles generated on the host.
    Cost,
    /// Number of its instances drawn at some frame rates.
    Crowd,
}

#[derive(Debug, Args)]
pub(crate) struct PnTrianglesOf {
    /// What is asked
    question: Question,
    /// The plan (TOML); each case runs with its first seed.
    plan: PathBuf,
    /// Another value for a key of the plan, as "sweep.rate_bits_per_s=16000000"; may be given more than once.
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Largest deviation of edges from their curves in pixels, separated by commas: the first for `waiting`, each for
    /// `cost`.
    #[arg(long, value_delimiter = ',', default_value = "0.25")]
    error_px: Vec<f32>,
    /// Timed frames of each.
    #[arg(long, default_value_t = 9, value_parser = clap::value_parser!(u32).range(1..=i64::from(MAX_FRAMES)))]
    frames: u32,
    /// Write the pictures into this folder.
    #[arg(long, value_name = "FOLDER")]
    pictures: Option<PathBuf>,
    #[command(flatten)]
    cache: CacheFolder,
    #[command(flatten)]
    beside: Beside,
    /// Print JSON instead of text.
    #[arg(long)]
    json: bool,
}

impl PnTrianglesOf {
    pub(crate) fn run(&self) -> anyhow::Result<()> {
        let plan = self.beside.add_to(plan::read_with(&self.plan, &self.set)?)?;
        // Before anything is prepared: without an adapter preparing would be in vain.
        let gpu = Gpu::headless().context("frames are to be drawn")?;
        let scenes = self.cache.open_scenes(&plan, true)?;
        let first: &Arc<dyn SceneSource> = scenes.first().context("the plan has no scene")?;
        match self.question {
            Question::Waiting => {
                let error_px = self.error_px.first().copied().context("no error")?;
                let patches = PnTriangles { error_px, ..PnTriangles::default() };
                self.print(&pn_waiting::waiting(&plan, &scenes, gpu, patches, |name, picture| {
                    self.keep(name, |file| Ok(picture.save(file)?))
                })?)
            }
            Question::Cost => self.print(&pn_cost::cost(&plan, first, gpu, &self.error_px, self.frames)?),
            Question::Crowd => self.print(&pn_crowd::crowd(
                &plan,
                first,
                gpu,
                (self.frames, pn_crowd::MOST),
                |name, picture| self.keep(name, |file| Ok(picture.save(file)?)),
            )?),
        }
    }

    /// Writes a picture into the folder of pictures, if one is named.
    fn keep(&self, name: &str, write: impl FnOnce(&Path) -> anyhow::Result<()>) -> anyhow::Result<()> {
        let Some(folder) = &self.pictures else { return Ok(()) };
        let file = folder.join(format!("{name}.png"));
        let fail = || format!("{}: cannot be written", file.display());
        std::fs::create_dir_all(folder).with_context(fail)?;
        write(&file).with_context(fail)
    }

    fn print<T: Display + Serialize>(&self, results: &[T]) -> anyhow::Result<()> {
        if self.json {
            println!("{}", serde_json::to_string(results)?);
        } else {
            results.iter().for_each(|result| println!("{result}"));
        }
        Ok(())
    }
}
