//! Time that a frame spends, on the drawing thread, on data that arrived since the last frame: taking them from the
//! streaming thread and uploading them to the graphics device.
//!
//! A plan's case runs in real time: the shipped daemon, a relay in place of the link, the shipped streaming thread, and
//! frames at fixed instants that take and upload changes as the viewer's do. They are not drawn: that would measure the
//! device.

use std::fmt;
use std::sync::Arc;
use std::time::{Duration, Instant};

use anyhow::Context as _;
use lodestream_client::Threads;
use lodestream_client::core::{Config, Decoders, StartView};
use lodestream_client::net::{Retry, Server};
use lodestream_client::streaming::Streaming;
use lodestream_protocol::source::SceneSource;
use lodestream_render::{Gpu, Headless, MAX_WAITING_STEPS, SceneView, upload_budget};
use lodestream_scenario::plan::{Case, Plan};
use lodestream_scenario::stopwatch::{median, rounded};
use lodestream_scenario::truth::RealLink;
use rustix::time::{ClockId, clock_gettime};
use serde::Serialize;

/// Times of the frames of a case.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Staging {
    /// The scene.
    pub scene: String,
    /// Transport and link.
    pub case: String,
    /// Target screen error.
    pub target_px: f32,
    /// The graphics adapter.
    pub adapter: String,
    /// Time between two frames.
    pub frame_ms: f64,
    /// Number of runs.
    pub repeats: u32,
    /// Median time until everything was uploaded.
    pub settled_ms: f64,
    /// Median processor time of the frame with the first complete picture: it cannot be deferred, and is not included
    /// in those below.
    pub first_frame_ms: f64,
    /// Number of later frames that uploaded something, in all runs.
    pub frames: usize,
    /// Their processor time.
    pub busy: Spent,
    /// Their elapsed time, including time in which other threads had the processors.
    pub took: Spent,
    /// Most bytes that one of them uploaded.
    pub most_bytes: usize,
    /// Bytes of the last run.
    pub bytes: usize,
    /// Most steps that waited for a later frame.
    pub most_waiting: usize,
}

/// Times of frames, in milliseconds.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Spent {
    /// Median.
    pub p50_ms: f64,
    /// 99th percentile; the maximum of fewer than a hundred.
    pub p99_ms: f64,
    /// Maximum.
    pub max_ms: f64,
}

impl Spent {
    /// Percentiles by nearest rank of times in any order; zeros if there are none.
    fn of(mut times: Vec<Duration>) -> Self {
        times.sort();
        let at = |percent: usize| times.get((times.len() * percent).div_ceil(100).max(1) - 1);
        let [p50_ms, p99_ms, max_ms] = [50, 99, 100].map(|percent| at(percent).map_or(0.0, |&time| ms(time)));
        Self { p50_ms, p99_ms, max_ms }
    }
}

fn ms(time: Duration) -> f64 {
    rounded(time.as_secs_f64() * 1e3, 3)
}

/// Processor time of the calling thread so far.
fn busy() -> Duration {
    let time = clock_gettime(ClockId::ThreadCPUTime);
    let [seconds, nanoseconds] = [time.tv_sec, time.tv_nsec].map(|part| u64::try_from(part).unwrap_or(0));
    Duration::from_secs(seconds) + Duration::from_nanos(nanoseconds)
}

/// Runs the plan's cases, each with its first seed, `repeats` times (at least once), with a frame at each multiple of
/// `interval`.
///
/// # Errors
/// Cases that are not settled in time, and errors of the system or the graphics device.
pub fn staging(
    plan: &Plan,
    scenes: &[Arc<dyn SceneSource>],
    interval: Duration,
    repeats: u32,
    mut report: impl FnMut(&Staging),
) -> anyhow::Result<Vec<Staging>> {
    let mut all = Vec::new();
    for case in &plan.cases {
        let scene = &scenes[case.scene];
        let one = of_case(plan, case, scene, interval, repeats.max(1)).with_context(|| case.to_string())?;
        report(&one);
        all.push(one);
    }
    Ok(all)
}

fn of_case(
    plan: &Plan,
    case: &Case,
    scene: &Arc<dyn SceneSource>,
    interval: Duration,
    repeats: u32,
) -> anyhow::Result<Staging> {
    let target_px = plan.client.target_px;
    let mut all = RunFrames::default();
    let (mut settled, mut first_frame, mut adapter) = (Vec::new(), Vec::new(), String::new());
    for _ in 0..repeats {
        // The smallest picture: nothing is drawn.
        let headless = Headless::new(Gpu::headless()?, 1, 1)?;
        let link = RealLink::start(case, scene, case.seeds.first().copied().unwrap_or(1))?;
        let mut config = Config::new(StartView::OfScene { viewport_px: plan.viewport_px, target_px });
        config.decoders = Decoders::on_threads(Threads::all_cores_but_one());
        let mut streaming = Streaming::start(Server::from(link.address()), config, Retry::default(), || {})?;
        let limit = Duration::from_secs_f64(case.time_limit_s);
        let one = watch(&headless, &mut streaming, interval, limit);
        drop(streaming);
        link.stop()?;
        let one = one?;
        adapter = headless.gpu().describe();
        settled.push(ms(one.settled));
        first_frame.push(ms(one.first_frame));
        all.busy.extend(one.busy);
        all.took.extend(one.took);
        all.most_bytes = all.most_bytes.max(one.most_bytes);
        all.most_waiting = all.most_waiting.max(one.most_waiting);
        all.bytes = one.bytes;
    }
    Ok(Staging {
        scene: plan.scenes[case.scene].name.clone(),
        case: case.to_string(),
        target_px,
        adapter,
        frame_ms: ms(interval),
        repeats,
        settled_ms: rounded(median(settled), 0),
        first_frame_ms: median(first_frame),
        frames: all.took.len(),
        busy: Spent::of(all.busy),
        took: Spent::of(all.took),
        most_bytes: all.most_bytes,
        bytes: all.bytes,
        most_waiting: all.most_waiting,
    })
}

/// Measurements of a run.
#[derive(Default)]
struct RunFrames {
    settled: Duration,
    first_frame: Duration,
    busy: Vec<Duration>,
    took: Vec<Duration>,
    most_bytes: usize,
    bytes: usize,
    most_waiting: usize,
}

fn watch(
    headless: &Headless,
    streaming: &mut Streaming,
    interval: Duration,
    limit: Duration,
) -> anyhow::Result<RunFrames> {
    let clock = streaming.clock();
    let now = || Duration::from(clock.now());
    let mut scene = SceneView::with_terrain_apart(|| {})?;
    let mut found = RunFrames::default();
    let mut next = now();
    loop {
        next += interval;
        std::thread::sleep(next.saturating_sub(now()));
        // A late frame is not made up for.
        next = next.max(now());
        // The status first: steps that it calls settled are among those taken after it.
        let status = streaming.status();
        let was_whole = scene.is_whole();
        let (began, busy_before) = (Instant::now(), busy());
        while scene.waiting() < MAX_WAITING_STEPS
            && let Some(step) = streaming.take()
        {
            scene.push(step);
        }
        let steps = scene.waiting();
        let budget = if was_whole { upload_budget(interval) } else { usize::MAX };
        let bytes = scene.upload(headless.gpu(), headless.renderer(), budget, now().as_secs_f32())?;
        headless.flush()?;
        let (took, busy) = (began.elapsed(), busy().saturating_sub(busy_before));
        if was_whole && steps > 0 {
            found.took.push(took);
            found.busy.push(busy);
            found.bytes += bytes;
            found.most_bytes = found.most_bytes.max(bytes);
            found.most_waiting = found.most_waiting.max(scene.waiting());
        } else if scene.is_whole() && !was_whole {
            found.first_frame = busy;
        }
        if let Some(end) = &status.end {
            anyhow::bail!("the session ended early: {end}");
        }
        found.settled = now();
        if status.settled && scene.waiting() == 0 {
            return Ok(found);
        }
        anyhow::ensure!(found.settled < limit, "not settled within {} s", limit.as_secs_f64());
    }
}

/// One line of text.
impl fmt::Display for Staging {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{}, {}, to {} px, a frame every {} ms on {}: settled after {} ms; {} frames spent {} ms of a processor \
             (median), {} (p99), {} (most), and took {}, {}, {}, on {} bytes, at most {} at once, at most {} steps put \
             off; the first picture: {} ms",
            self.scene,
            self.case,
            self.target_px,
            self.frame_ms,
            self.adapter,
            self.settled_ms,
            self.frames,
            self.busy.p50_ms,
            self.busy.p99_ms,
            self.busy.max_ms,
            self.took.p50_ms,
            self.took.p99_ms,
            self.took.max_ms,
            self.bytes,
            self.most_bytes,
            self.most_waiting,
            self.first_frame_ms
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percentiles_are_those_of_the_nearest_rank() {
        let times: Vec<Duration> = (1..=200).rev().map(Duration::from_millis).collect();
        assert_eq!(Spent::of(times), Spent { p50_ms: 100.0, p99_ms: 198.0, max_ms: 200.0 });
        let few = Spent::of(vec![Duration::from_micros(1500), Duration::from_micros(250)]);
        assert_eq!(few, Spent { p50_ms: 0.25, p99_ms: 1.5, max_ms: 1.5 });
        assert_eq!(Spent::of(Vec::new()).max_ms, 0.0);
    }

    #[test]
    fn a_sleeping_thread_uses_no_processor_time() {
        let before = busy();
        std::thread::sleep(Duration::from_millis(50));
        assert!(busy() - before < Duration::from_millis(50));
    }
}
