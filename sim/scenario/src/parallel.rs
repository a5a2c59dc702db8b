//! Runs all runs of a plan on several threads and reports them in the plan's order.
//!
//! Runs share only scenes, which are read-only, and the server's certificate, so results do not depend on the number of
//! threads.

use std::collections::BTreeMap;
use std::num::NonZeroUsize;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::sync_channel;

use anyhow::Context as _;
use lodestream_protocol::source::SceneSource;

use super::plan::{Case, Plan};
use super::result::RunResult;
use super::run::{Run, certificate};
use crate::baseline::{self, Library};

/// Results per thread that may wait for earlier ones.
const WAITING_PER_THREAD: usize = 64;

/// Runs all cases of a plan with all their seeds, without pictures. `scenes` are the plan's, in its order. `report`
/// receives each result in the plan's order.
///
/// # Errors
/// The first session, in the plan's order, that ends otherwise than settled, at the time limit or with a lost
/// connection; baselines that cannot be measured.
pub fn run(
    plan: &Plan,
    scenes: &[Arc<dyn SceneSource>],
    threads: NonZeroUsize,
    report: impl FnMut(&RunResult),
) -> anyhow::Result<Vec<RunResult>> {
    let library = Library::prepare(plan, scenes, |_| {})?;
    run_with(plan, scenes, Equipment { library: &library, gallery: None }, threads, report)
}

/// What runs need besides scenes.
#[derive(Clone, Copy)]
pub struct Equipment<'a> {
    /// Measured baselines.
    pub library: &'a Library,
    /// Renderer of the plan's pictures; `None` for none.
    pub gallery: Option<&'a dyn Draw>,
}

/// Runs a case and draws its pictures.
pub trait Draw: Sync {
    /// Runs a case with a seed and adds its pictures to the result, if the plan asks for some. `number` is the run's
    /// index in the plan.
    ///
    /// # Errors
    /// As [`Run::result`], and pictures that cannot be drawn or stored.
    fn drawn(&self, run: &Run<'_>, number: usize) -> anyhow::Result<RunResult>;
}

/// As [`run`], with measured baselines and the pictures that the plan asks for.
///
/// # Errors
/// As [`run`], and errors of the graphics device or the pictures' folder.
pub fn run_with(
    plan: &Plan,
    scenes: &[Arc<dyn SceneSource>],
    equipment: Equipment<'_>,
    threads: NonZeroUsize,
    mut report: impl FnMut(&RunResult),
) -> anyhow::Result<Vec<RunResult>> {
    let certificate = certificate()?;
    let jobs: Vec<(usize, &Case, u64)> = (0..)
        .zip(&plan.cases)
        .flat_map(|(number, case)| case.seeds.iter().map(move |&seed| (number, case, seed)))
        .collect();
    let next = AtomicUsize::new(0);
    let work = |job: usize| -> anyhow::Result<RunResult> {
        let (number, case, seed) = jobs[job];
        let scene = scenes.get(case.scene).context("the plan has a scene that was not opened")?;
        let ran = if case.technique.is_ours() {
            let run = Run { plan, case, scene, certificate: &certificate, seed };
            match equipment.gallery {
                Some(gallery) => gallery.drawn(&run, job),
                None => run.result(None),
            }
        } else {
            let entry = equipment.library.find(case).context("the case's baseline was not measured")?;
            baseline::run_case(plan, case, entry, &certificate, seed)
        };
        ran.with_context(|| format!("case {} of {} ({case}), seed {seed}", number + 1, plan.cases.len()))
    };
    let threads = threads.get().min(jobs.len().max(1));
    std::thread::scope(|scope| {
        let (sender, receiver) = sync_channel(threads * WAITING_PER_THREAD);
        for _ in 0..threads {
            let (sender, next, work) = (sender.clone(), &next, &work);
            let count = jobs.len();
            scope.spawn(move || {
                loop {
                    let job = next.fetch_add(1, Ordering::Relaxed);
                    // The receiver is gone after an error.
                    if job >= count || sender.send((job, work(job))).is_err() {
                        break;
                    }
                }
            });
        }
        drop(sender);
        let mut results = Vec::with_capacity(jobs.len());
        let mut early = BTreeMap::new();
        for (job, result) in receiver {
            early.insert(job, result);
            while let Some(result) = early.remove(&results.len()) {
                // Jobs are handed out in order, so results before an error arrive before it.
                let result = result?;
                report(&result);
                results.push(result);
            }
        }
        Ok(results)
    })
}
