//! The viewer without a window: streams until settled, then writes a picture.

use std::sync::mpsc;
use std::time::Duration;

use anyhow::{Context, bail};
use lodestream_client::net::Retry;
use lodestream_client::streaming::{Status, Streaming};
use lodestream_render::{Frame, Gpu, Headless, SceneView};

use crate::args::Args;
use crate::run::{core_config, settings, tell_figures};

/// Time until a run without `--timeout` ends.
const DEFAULT_TIMEOUT: Duration = Duration::from_secs(300);
/// Attempts to reach the server.
const ATTEMPTS: u32 = 3;

/// Runs the viewer without a window.
///
/// # Errors
/// One line that says what went wrong and what to do.
pub(crate) fn run(args: &Args) -> anyhow::Result<()> {
    let output = args.output.as_ref().context("--headless needs --output FILE.png")?;
    let [width, height] = args.window.0;
    let mut headless = Headless::new(Gpu::headless()?, width, height)?;
    let mut scene = SceneView::new();
    // One token at most waits: it only says that there is something to look at.
    let (sender, notified) = mpsc::sync_channel(1);
    let retry = Retry { first_attempts: ATTEMPTS, reconnect: true };
    let mut streaming = Streaming::start(args.address.clone(), core_config(args), retry, move || {
        let _ = sender.try_send(());
    })?;
    let clock = streaming.clock();
    let deadline = args.timeout.map_or(DEFAULT_TIMEOUT, |t| t.0);
    let mut presented = None;
    let mut message = None;
    let status: Status = loop {
        // The status first: what it says is settled lies in the steps taken after it.
        let status = streaming.status();
        while let Some(step) = streaming.take() {
            scene.push(step);
            let now_s = seconds(clock.now().into());
            let renderer = headless.renderer();
            scene.upload(headless.gpu(), renderer, usize::MAX, now_s)?;
        }
        if status.message != message {
            message.clone_from(&status.message);
            if let Some(text) = &message {
                tracing::info!("{text}");
            }
        }
        if presented.is_none() && status.stats.milestones.first_frame.is_some() {
            draw(&mut headless, &mut scene, args, seconds(clock.now().into()))?;
            presented = Some(Duration::from(clock.now()));
        }
        if let Some(end) = &status.end {
            bail!("{end}");
        }
        if status.settled {
            break status;
        }
        // What is refused may come once the server's disk is mended, but a picture is not held up for that.
        if status.stats.lacking_blobs > 0 {
            tracing::warn!(
                "{} blobs came damaged or are refused by the server, whose log says why; the picture is coarser for it",
                status.stats.lacking_blobs
            );
            break status;
        }
        let left = deadline.saturating_sub(clock.now().into());
        if left.is_zero() {
            if scene.header().is_none() || presented.is_none() {
                bail!(
                    "nothing could be drawn within {} s{}",
                    deadline.as_secs_f32(),
                    message.map(|m| format!(": {m}")).unwrap_or_default()
                );
            }
            tracing::warn!(
                "not settled within {} s: {} blobs under way, {} chunks missing, screen error {:.2} px",
                deadline.as_secs_f32(),
                status.stats.session.in_flight_blobs,
                status.stats.counters.missing_chunks,
                status.stats.counters.max_screen_error_px
            );
            break status;
        }
        let _ = notified.recv_timeout(left.min(Duration::from_millis(100)));
    };
    drop(streaming);
    // A time at which every vertex is where it belongs.
    draw(&mut headless, &mut scene, args, f32::MAX)?;
    headless.save_png(output)?;
    tell_figures(args, &status.stats, presented)
}

fn seconds(duration: Duration) -> f32 {
    duration.as_secs_f32()
}

fn draw(headless: &mut Headless, scene: &mut SceneView, args: &Args, time_s: f32) -> anyhow::Result<()> {
    let start = args.camera.map(|c| c.0).or_else(|| scene.header().map(|h| h.camera));
    let Some(start) = start else { bail!("the server sent no scene") };
    let camera = start.pose();
    scene.prepare_ground(headless.gpu(), &camera, headless.size(), args.pixel_error.0)?;
    scene.with_frame(camera, settings(args), time_s, |frame: &Frame<'_>| headless.frame(frame))?;
    Ok(())
}
