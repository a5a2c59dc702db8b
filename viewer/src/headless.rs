//! Headless mode: streams until the picture is settled, then writes it.

use std::path::PathBuf;
use std::sync::mpsc;
use std::time::{Duration, Instant};

use anyhow::{Context, bail};
use image::RgbaImage;
use lodestream_client::net::{Address, Retry};
use lodestream_client::streaming::{Controls, Status, Streaming};
use lodestream_render::{Counters, Frame, Gpu, Headless, SceneView, Settings};
use lodestream_scene::description::Camera;
use lodestream_scene::view::View;

use crate::args::Args;
use crate::files::write_png;
use crate::frames::FrameLog;
use crate::local::{LocalOptions, Preparation, Target};
use crate::outcome::{Outcome, describe_end, describe_missing};
use crate::run::{core_config, server, settings, write_statistics};
use crate::sequence::{self, numbered};
use crate::{animation, matte, part_names, parts, signals, token};

/// Time limit of a run without `--timeout`.
const DEFAULT_TIMEOUT: Duration = Duration::from_secs(300);
/// Most attempts to reach the server.
const ATTEMPTS: u32 = 3;

/// Interval of questions whether another view is settled.
const POLL: Duration = Duration::from_millis(5);

/// Event that wakes the loop.
enum Event {
    /// There may be a new step or status.
    Streaming,
    /// A signal of this number has arrived.
    End(u8),
}

/// Runs the viewer without a window.
///
/// # Errors
/// One line with the fault and the remedy.
pub(crate) fn run(args: &Args, target: Target) -> anyhow::Result<Outcome> {
    let output = args.output.as_ref().context("--headless needs --output FILE.png")?;
    let [width, height] = args.window.0;
    // A notification is dropped if one waits already. A signal waits for room.
    let (sender, events) = mpsc::sync_channel(1);
    let ending = sender.clone();
    signals::on_termination(move |signal| {
        // Fails only once the run has ended.
        let _ = ending.send(Event::End(signal));
    })?;
    let retry = Retry { first_attempts: ATTEMPTS, ..Retry::default() };
    let transport = target.transport();
    let notify = move || {
        let _ = sender.try_send(Event::Streaming);
    };
    // Kept until the program ends: the scene is read from its folder.
    let (_preparation, address) = match target {
        Target::Stream(address) => (None, address),
        Target::Files(files) => match prepare(args, files, notify.clone(), &events)? {
            Ok((preparation, address)) => (Some(preparation), address),
            Err(signal) => return Ok(Outcome::Interrupted(signal)),
        },
    };
    // Before the device is opened: the server answers meanwhile.
    let mut streaming = Streaming::start(server(args, &address)?, core_config(args)?, retry, notify)?;
    token::follow(args.token_file.as_ref(), &streaming)?;
    streaming.pin_instances(parts::instances(args));
    streaming.animate(animation::moment(args));
    let mut headless = Headless::new(Gpu::headless()?, width, height)?;
    headless.time_passes(args.stats.is_some());
    let mut scene = SceneView::new();
    scene.animate(headless.gpu(), animation::moment(args))?;
    scene.set_vertical_exaggeration(args.ground_heights, 0.0, 0.0)?;
    let clock = streaming.clock();
    let deadline = args.timeout.map_or(DEFAULT_TIMEOUT, |t| t.0);
    let mut shown = FrameLog::default();
    let mut message = None;
    let mut outcome = Outcome::Finished;
    let status: Status = loop {
        // Before the steps: a status that says settled refers to steps that are taken below.
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
        if shown.presented().is_none() && scene.is_whole() {
            let counters = draw(&mut headless, &mut scene, args, seconds(clock.now().into()))?;
            shown.note(clock.now().into(), true, &counters, (&status.stats).into());
        }
        if let Some(end) = &status.end {
            bail!("{}", describe_end(end));
        }
        if status.settled {
            break status;
        }
        // Refused blobs may arrive once the server's disk is repaired, but the picture does not wait for that.
        if status.stats.lacking_blobs > 0 {
            tracing::warn!("{}", describe_missing(status.stats.lacking_blobs, &status.stats.lacking));
            outcome = Outcome::Incomplete;
            break status;
        }
        let left = deadline.saturating_sub(clock.now().into());
        if left.is_zero() {
            if scene.header().is_none() || shown.presented().is_none() {
                bail!(
                    "nothing could be drawn within {} s{}",
                    deadline.as_secs_f32(),
                    message.map(|m| format!(": {m}")).unwrap_or_default()
                );
            }
            tracing::warn!(
                "not settled within {} s: {} blobs in flight, {} chunks missing, screen error {:.2} px",
                deadline.as_secs_f32(),
                status.stats.session.in_flight_blobs,
                status.stats.counters.missing_chunks,
                status.stats.counters.max_screen_error_px
            );
            break status;
        }
        if let Ok(Event::End(signal)) = events.recv_timeout(left.min(Duration::from_millis(100))) {
            shown.note_times(headless.timings());
            write_statistics(args, transport, &status.stats, &shown)?;
            tracing::warn!("interrupted: no picture was written");
            return Ok(Outcome::Interrupted(signal));
        }
    };
    animation::check(args, scene.animations())?;
    part_names::print(args, &mut streaming, deadline.saturating_sub(clock.now().into()))?;
    parts::apply(args, headless.gpu(), &mut scene)?;
    if let Some(camera) = camera(args, &scene) {
        for pixel in &args.pick {
            let found =
                parts::describe_at(*pixel, (&camera.pose(), headless.size()), args, &streaming, &scene)?;
            println!("{found}");
        }
    }
    let start = camera(args, &scene).context("the server sent no scene")?;
    match sequence::cameras(args, start)? {
        None => write_png(output, &picture(&mut headless, &mut scene, args, &start)?)?,
        Some(cameras) => {
            for (number, camera) in (1..).zip(cameras) {
                let camera = args.projected(camera);
                // The first view may be settled already.
                if let Some(signal) =
                    settle(&mut streaming, &mut headless, &mut scene, args.view_of(&camera), &events)?
                {
                    tracing::warn!("interrupted: {} pictures were written", number - 1);
                    return Ok(Outcome::Interrupted(signal));
                }
                write_png(&numbered(output, number), &picture(&mut headless, &mut scene, args, &camera)?)?;
            }
        }
    }
    drop(streaming);
    shown.note_times(headless.timings());
    if status.settled {
        shown.note_settled(clock.now().into());
    }
    write_statistics(args, transport, &status.stats, &shown)?;
    Ok(outcome)
}

/// Prepares files and waits for it; gives the preparation and the scene's address, or the number of a signal.
fn prepare(
    args: &Args,
    files: Vec<PathBuf>,
    notify: impl Fn() + Clone + Send + 'static,
    events: &mpsc::Receiver<Event>,
) -> anyhow::Result<Result<(Preparation, Address), u8>> {
    let options = LocalOptions { cache: args.cache.clone(), up: args.up, ..LocalOptions::default() };
    let preparation = Preparation::start(files, options, notify)?;
    let begun = Instant::now();
    loop {
        if let Some(why) = preparation.take_failure() {
            return Err(why);
        }
        if let Some(ready) = preparation.take_ready() {
            return Ok(Ok((preparation, ready.address)));
        }
        if args.timeout.is_some_and(|limit| begun.elapsed() >= limit.0) {
            bail!("nothing is prepared within the time of --timeout: raise it");
        }
        if let Ok(Event::End(signal)) = events.recv_timeout(Duration::from_millis(100)) {
            tracing::warn!("interrupted: no picture was written");
            return Ok(Err(signal));
        }
    }
}

fn seconds(duration: Duration) -> f32 {
    duration.as_secs_f32()
}

/// The camera of the command line, else of the scene.
fn camera(args: &Args, scene: &SceneView) -> Option<Camera> {
    let camera = args.camera.map(|c| c.0).or_else(|| scene.header().map(|h| h.camera));
    camera.map(|camera| args.projected(camera))
}

/// Moves to a view and waits until it is settled, or ends with what is damaged or refused; gives the number of a signal
/// that has come.
fn settle(
    streaming: &mut Streaming,
    headless: &mut Headless,
    scene: &mut SceneView,
    view: View,
    events: &mpsc::Receiver<Event>,
) -> anyhow::Result<Option<u8>> {
    streaming.control(Controls { view: Some(view), shadows: None, leave: false });
    // A question is answered before the core selects anew: only the second answer for this view counts.
    let mut seen = 0;
    loop {
        let asked = streaming.ask(move |core| {
            let done = core.is_settled() || core.lacking_blobs().next().is_some();
            (core.view() == Some(view), done && !core.has_changes())
        })?;
        let (is_seen, is_done) = asked.wait()?;
        seen += u32::from(is_seen);
        while let Some(step) = streaming.take() {
            scene.push(step);
            scene.upload(headless.gpu(), headless.renderer(), usize::MAX, 0.0)?;
        }
        if let Some(end) = &streaming.status().end {
            bail!("{}", describe_end(end));
        }
        if seen > 1 && is_done {
            return Ok(None);
        }
        if let Ok(Event::End(signal)) = events.recv_timeout(POLL) {
            return Ok(Some(signal));
        }
    }
}

/// The finished picture from a camera.
fn picture(
    headless: &mut Headless,
    scene: &mut SceneView,
    args: &Args,
    camera: &Camera,
) -> anyhow::Result<RgbaImage> {
    let usual = settings(args, headless.gpu().is_software());
    let mut drawn = |settings: &Settings| -> anyhow::Result<RgbaImage> {
        // At this time all morphs are over.
        while draw_with(headless, scene, args, camera, settings, f32::MAX)?.is_unfinished() {}
        Ok(headless.picture()?)
    };
    if args.transparent { matte::drawn(&usual, drawn) } else { drawn(&usual) }
}

fn draw(
    headless: &mut Headless,
    scene: &mut SceneView,
    args: &Args,
    time_s: f32,
) -> anyhow::Result<Counters> {
    let Some(start) = camera(args, scene) else { bail!("the server sent no scene") };
    let settings = settings(args, headless.gpu().is_software());
    draw_with(headless, scene, args, &start, &settings, time_s)
}

fn draw_with(
    headless: &mut Headless,
    scene: &mut SceneView,
    args: &Args,
    camera: &Camera,
    settings: &Settings,
    time_s: f32,
) -> anyhow::Result<Counters> {
    let (camera, settings) = (camera.pose(), *settings);
    scene.move_ground(time_s);
    scene.prepare_ground(headless.gpu(), &camera, headless.size(), args.pixel_error.0, settings.shadows)?;
    let counters = scene.with_frame(camera, settings, time_s, |frame: &Frame<'_>| headless.frame(frame))?;
    Ok(counters)
}
