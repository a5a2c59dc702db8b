//! `lodestream-sim run`: arguments; writes a report.

use std::num::NonZeroUsize;
use std::path::PathBuf;

use anyhow::Context as _;
use clap::Args;
use lodestream_report::{pictures, write_drawn};
use lodestream_scenario::baseline::Library;
use lodestream_scenario::parallel::Draw;
use lodestream_scenario::plan::{self, Plan};
use lodestream_scenario::{Equipment, run_with};

use crate::arguments::{Beside, CacheFolder};
use crate::progress::Progress;

#[derive(Debug, Args)]
pub(crate) struct Run {
    /// The plan (TOML).
    plan: PathBuf,
    /// Run only this seed of packet loss, jitter and the endpoints' random numbers [default: the
    /// plan's seeds].
    #[arg(long)]
    seed: Option<u64>,
    /// Another value for a key of the plan, as "client.target_px=4" or "sweep.seeds=3"; may be given more than once.
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Folder of the report: report.html, results.json and results.csv, plots, pictures if the plan asks for them,
    /// percentiles of cases with enough seeds, and bytes and times until each level of a chain (levels.csv).
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
    /// Concurrent runs [default: number of processors]. The report does not depend on it.
    #[arg(long)]
    threads: Option<NonZeroUsize>,
    #[command(flatten)]
    cache: CacheFolder,
    #[command(flatten)]
    beside: Beside,
    /// Show no progress.
    #[arg(long)]
    quiet: bool,
}

impl Run {
    fn plan(&self) -> anyhow::Result<Plan> {
        let plan = self.beside.add_to(plan::read_with(&self.plan, &self.set)?)?;
        Ok(match self.seed {
            Some(seed) => plan.with_seed(seed),
            None => plan,
        })
    }

    pub(crate) fn run(&self) -> anyhow::Result<()> {
        let plan = self.plan()?;
        // Before anything is prepared: without a graphics adapter preparing would be in vain.
        let device = plan.pictures.as_ref().map(|_| pictures::open_device()).transpose()?;
        let scenes = self.cache.open_scenes(&plan, self.quiet)?;
        let threads = self.threads.or(std::thread::available_parallelism().ok()).unwrap_or(NonZeroUsize::MIN);
        let library = Library::prepare(&plan, &scenes, |what| {
            if !self.quiet {
                eprintln!("{what}");
            }
        })?;
        let gallery = device.map(|device| pictures::Gallery::new(device, &self.output)).transpose()?;
        let draw = gallery.as_ref().map(|gallery| gallery as &dyn Draw);
        let equipment = Equipment { library: &library, gallery: draw };
        let progress = Progress::new(plan.runs(), self.quiet);
        let results = run_with(&plan, &scenes, equipment, threads, |result| progress.line(result));
        progress.finish();
        write_drawn(&self.output, &plan, &results?, gallery)
            .with_context(|| format!("{}: the report cannot be written", self.output.display()))
    }
}
