//! State that lives as long as the window, and the steps of its frames.

mod animation;
mod commands;
mod open;
mod overlay_state;
mod parts;
mod pending_picture;
mod picture;
mod playing;
mod pointer;
mod source;
mod streams;

use std::ffi::OsString;
use std::rc::Rc;
use std::sync::Arc;
use std::time::{Duration, Instant};

use lodestream_client::net::Clock;
use lodestream_client::streaming::{Controls, Streaming};
use lodestream_render::{Counters, Pose, SceneView, Settings, Shadows, upload_budget};
use winit::dpi::{LogicalSize, PhysicalPosition};
use winit::event::MouseButton;
use winit::event_loop::{ActiveEventLoop, EventLoopProxy, OwnedDisplayHandle};
use winit::window::Window;

use super::clicks::Clicks;
use super::event::Event;
use super::frame_capture::FrameCapture;
use super::keyboard::{self, Bindings, Keys};
use super::measure::Measure;
use super::open_panel::OpenPanel;
use super::overlay::{self, Choices, Controls as OverlayControls};
use super::painter::{self, Below, Painted, Painter};
use super::part_list::PartList;
use super::pivot::Pivot;
use super::section::Section;
use super::selection::Selection;
use lodestream_viewing::{CameraController, Quality, Step};

use super::session_status::SessionStatus;
use super::state::{FrameStatus, State};
use super::steps::{self, Steps};
use crate::args::Args;
use crate::frames::{FrameLog, Received};
use crate::local::{Preparation, Target};
use crate::outcome::describe_missing;
use crate::recent;
use crate::run::settings;
use animation::Animation;
use pending_picture::PendingPicture;
use streams::{NextScene, Notify, Opening, title};

/// Interval of checks for finished terrain tiles while nothing else changes.
const TILES_INTERVAL: Duration = Duration::from_millis(50);
/// Interval of overlay updates while nothing else changes.
const OVERLAY_INTERVAL: Duration = Duration::from_millis(250);
/// The same while only the progress of a preparation changes, whose processor the frames take.
const PROGRESS_INTERVAL: Duration = Duration::from_secs(1);

/// What a picture depends on besides the scene.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Drawn {
    camera: Pose,
    settings: Settings,
    heights: [f64; 2],
    target_px: f32,
}

/// State of an open window.
pub(super) struct Running {
    pub(super) painter: Painter,
    clock: Clock,
    notify: Notify,
    /// `None` while files are prepared.
    streaming: Option<Streaming>,
    /// The files that are prepared.
    files: Option<Preparation>,
    /// The scene that will replace the one that is drawn.
    next: Option<NextScene>,
    /// Other files that will replace it.
    opening: Option<Opening>,
    open_panel: OpenPanel,
    /// Files that were dropped together.
    dropped: Vec<OsString>,
    /// Files are held over the window.
    hovers: bool,
    /// Errors of what is shown do not end the program: it was not named on the command line.
    pub(super) stays_open: bool,
    /// Name of the transport in statistics.
    pub(super) transport: &'static str,
    pub(super) scene: SceneView,
    pub(super) controller: Option<CameraController>,
    pub(super) status: SessionStatus,
    adapter: String,
    /// What is shown, as the command line names it.
    address: String,
    settings: Settings,
    choices: Choices,
    pub(super) keys: Keys,
    pub(super) button: Option<MouseButton>,
    clicks: Clicks,
    pointer: PhysicalPosition<f64>,
    /// Where the button was pressed.
    pressed_at: PhysicalPosition<f64>,
    selection: Selection,
    part_list: PartList,
    measure: Measure,
    pivot: Pivot,
    section: Section,
    animation: Animation,
    drawn: Option<Instant>,
    counters: Counters,
    frame_ms: f64,
    fps: f64,
    /// Time and bytes at the start of the interval over which throughput is measured.
    window_start: (Instant, u64),
    bits_per_s: f64,
    pub(super) quality: Quality,
    /// Whether the last frame lacked nothing but terrain tiles.
    only_tiles_missing: bool,
    /// Whether terrain heights are changing.
    ground_moves: bool,
    /// Height of the terrain below the eye over that of the scene without exaggeration.
    rise: f64,
    /// What the last picture was drawn with, if it was final: frames in which the overlay alone changes show it again.
    last: Option<Drawn>,
    /// A picture that is not the window's and waits for what it shows.
    picture: Option<PendingPicture>,
    /// Whether a key asked for a picture.
    wants_picture: bool,
    /// A message about a written picture, and until when it is shown.
    notice: Option<(Duration, String)>,
    /// Whether an event requires a frame.
    pub(super) dirty: bool,
    pub(super) shown: FrameLog,
    pub(super) capture: FrameCapture,
    /// When the overlay was last drawn before the first frame of the scene.
    waiting: Option<Instant>,
    pub(super) state: State,
    /// Whether the incomplete picture has been logged.
    reported_incomplete: bool,
}

impl Running {
    /// Starts streaming, opens the window and its device.
    ///
    /// # Errors
    /// One line with the fault and the remedy.
    pub(super) fn start(
        args: &Args,
        target: Option<&Target>,
        bindings: Rc<Bindings>,
        proxy: EventLoopProxy<Event>,
        display: OwnedDisplayHandle,
        events: &ActiveEventLoop,
    ) -> anyhow::Result<Self> {
        let notify = Notify::new(proxy);
        // Before the device is opened: the server answers, and files are prepared, meanwhile.
        let (mut streaming, files) = match target {
            Some(Target::Stream(address)) => (Some(streams::stream(args, address, &notify)?), None),
            Some(Target::Files(files)) => (None, Some(streams::prepare(args, files, &notify)?)),
            None => (None, None),
        };
        let clock = streaming.as_ref().map_or_else(Clock::start, Streaming::clock);
        let [width, height] = args.window.0;
        let attributes = Window::default_attributes()
            .with_title(title(target))
            .with_inner_size(winit::dpi::PhysicalSize::new(width, height))
            .with_min_inner_size(LogicalSize::new(64, 64));
        let mut scene = SceneView::with_terrain_apart(notify.call())?;
        // Work that needs no device runs while it is opened: computing tables and measuring the terrain.
        std::thread::Builder::new().name("tables".into()).spawn(lodestream_render::compute_tables)?;
        let first_args = args.clone();
        let painter = Painter::new(
            Arc::new(events.create_window(attributes)?),
            display,
            args.frames.is_some(),
            move |gpu| {
                let full = settings(&first_args, gpu.is_software());
                [
                    vec![quality(&first_args, gpu.is_software()).step().limit(&full)],
                    lodestream_viewing::limited_settings(&full),
                ]
            },
            || {
                if let Some(streaming) = &mut streaming {
                    streams::take_steps(streaming, &mut scene);
                }
            },
        )?;
        tracing::debug!(now = ?Duration::from(clock.now()), "window and pipelines are made");
        let settings = settings(args, painter.gpu.is_software());
        let now = Instant::now();
        let mut running = Self {
            adapter: painter.gpu.describe(),
            address: target.map(ToString::to_string).unwrap_or_default(),
            transport: target.map_or("none", Target::transport),
            stays_open: target.is_none(),
            opening: None,
            open_panel: OpenPanel::default(),
            dropped: Vec::new(),
            hovers: false,
            clock,
            notify,
            streaming,
            files,
            next: None,
            scene,
            controller: args.camera.map(|camera| args.controller(camera.0)),
            status: SessionStatus::default(),
            choices: Choices {
                hidden: args.no_overlay,
                ..Choices::new(&settings, args.pixel_error.0, [args.ground_heights, args.ground_seconds])
            },
            settings,
            keys: Keys::new(bindings),
            button: None,
            clicks: Clicks::default(),
            pointer: PhysicalPosition::default(),
            pressed_at: PhysicalPosition::default(),
            selection: Selection::default(),
            part_list: PartList::default(),
            measure: Measure::default(),
            pivot: Pivot::default(),
            section: Section::default(),
            animation: Animation::new(crate::animation::playback(args)),
            drawn: None,
            counters: Counters::default(),
            frame_ms: 0.0,
            fps: 0.0,
            window_start: (now, 0),
            bits_per_s: 0.0,
            quality: quality(args, painter.is_software()),
            only_tiles_missing: false,
            ground_moves: false,
            rise: 0.0,
            last: None,
            picture: None,
            wants_picture: false,
            notice: None,
            dirty: false,
            shown: FrameLog::default(),
            capture: FrameCapture::default(),
            painter,
            waiting: Some(now),
            state: State::Refining,
            reported_incomplete: false,
        };
        match target {
            Some(_) => running.remember(&args.files),
            None => {
                running.open_panel.recent =
                    recent::default_file().as_deref().map(recent::read).unwrap_or_default()
            }
        }
        Ok(running)
    }

    pub(super) fn now(&self) -> Duration {
        self.clock.now().into()
    }

    /// Tells the streaming thread where the camera is and whether there are shadows, unless the selection is frozen.
    pub(super) fn send_view(&self) {
        if let Some(controller) = &self.controller
            && !self.choices.frozen
        {
            // Only while the camera moves, so that the first picture does not wait for a coarser one.
            let meshes = if self.quality.is_moving(self.now()) { self.step().meshes } else { 1.0 };
            let mut view = controller.view(self.painter.size(), self.choices.target_px * meshes);
            // The server has the heights without exaggeration, so it receives the camera lowered by the exaggeration
            // below it.
            view.eye[1] -= self.rise;
            let shadows = Some(self.choices.shadows);
            let control = |streaming: &Streaming, view| {
                streaming.control(Controls { view: Some(view), shadows, leave: false });
            };
            let of_picture = self.picture.as_ref().map_or(view, |picture| picture.view);
            self.streaming.iter().for_each(|streaming| control(streaming, of_picture));
            self.next.iter().for_each(|next| control(&next.streaming, view));
        }
    }

    fn measure(&mut self, now: Instant) {
        if let Some(drawn) = self.drawn.replace(now) {
            self.fps = 1.0 / (now - drawn).as_secs_f64().max(1e-6);
        }
        let (start, bytes) = self.window_start;
        let elapsed = (now - start).as_secs_f64();
        if elapsed >= 0.5 {
            let received = self.status.status().stats.transport_bytes;
            let bits = received.saturating_sub(bytes) as f64 * 8.0;
            self.bits_per_s = bits / elapsed;
            self.window_start = (now, received);
        }
    }

    /// Whether the next picture would equal the last: only terrain tiles are missing, and the new ones do not suffice
    /// for finer terrain. Drawing it would only take CPU time from making tiles.
    fn is_unchanged(&mut self) -> anyhow::Result<bool> {
        if self.ground_moves
            || self.animation.is_playing()
            || !self.only_tiles_missing
            || std::mem::take(&mut self.dirty)
            || self.keys.moves_camera()
        {
            return Ok(false);
        }
        let before = self.scene.ground_px();
        self.prepare_ground()?;
        Ok(self.scene.missing_tiles() > 0 && self.scene.ground_px() == before)
    }

    fn camera(&self) -> Pose {
        self.controller.map_or_else(
            || Pose::look_at(glam::DVec3::Z, glam::DVec3::ZERO, glam::DVec3::Y, 1.0),
            |controller| controller.pose(),
        )
    }

    /// Advances changing terrain heights, and moves the camera with the terrain below it.
    fn move_ground(&mut self) -> anyhow::Result<()> {
        let now_s = self.now().as_secs_f32();
        let [factor, seconds] = self.choices.heights;
        // Terrain that has not been shown does not move.
        if factor != self.scene.heights().target() && self.shown.has_begun() {
            self.scene.set_vertical_exaggeration(factor, seconds, now_s)?;
        }
        let eye = self.camera().eye;
        let before = self.scene.ground_rise(eye);
        self.ground_moves = self.scene.move_ground(now_s);
        self.rise = self.scene.ground_rise(eye);
        if let Some(controller) = &mut self.controller {
            controller.lift(self.rise - before);
        }
        Ok(())
    }

    fn prepare_ground(&mut self) -> anyhow::Result<()> {
        self.move_ground()?;
        let [width, height] = self.painter.size();
        let (camera, px) = (self.camera(), self.choices.target_px * self.step().ground);
        let shadows = self.shadows();
        Ok(self.scene.prepare_ground(&self.painter.gpu, &camera, (width, height), px, shadows)?)
    }

    /// Draws a frame; returns the time until the next.
    pub(super) fn frame(&mut self, args: &Args) -> anyhow::Result<Duration> {
        if std::mem::take(&mut self.wants_picture) {
            self.take_picture(args);
        }
        self.advance_picture(args);
        let wait = self.draw_frame(args)?;
        Ok(if self.picture.is_some() { wait.min(TILES_INTERVAL) } else { wait })
    }

    fn draw_frame(&mut self, args: &Args) -> anyhow::Result<Duration> {
        if self.update_parts(args)? {
            self.scene_changed();
        }
        self.dirty |= self.update_tools()?;
        self.dirty |= self.drop_old_notice();
        if self.is_unchanged()? {
            return Ok(TILES_INTERVAL);
        }
        // Events until now are part of this frame.
        self.dirty = false;
        let (began, begun) = (Instant::now(), self.now());
        let now_s = begun.as_secs_f32();
        let painted = steps::run(&mut FrameSteps { running: self, args, began, now_s })?;
        if painted.shows_kept {
            let notice = self.notice_left().unwrap_or(Duration::MAX);
            let moves = self.keys.moves_camera();
            return Ok(if moves { Duration::ZERO } else { painted.repaint_after.min(notice) });
        }
        self.frame_ms = began.elapsed().as_secs_f64() * 1e3;
        let shows = painted.counters.is_some();
        if let Some(picture) = painted.picture {
            let picture = picture.picture(&self.painter.gpu).map_err(anyhow::Error::from);
            self.save_picture(picture);
        }
        let full = !self.choices.adapt || self.quality.is_full();
        if let Some(counters) = painted.counters {
            let (now, whole) = (self.now(), self.scene.is_whole());
            if whole && self.shown.presented().is_none() {
                tracing::debug!(?now, frame_ms = self.frame_ms, "first frame presented");
            }
            self.painter.compile_rest();
            let received = Received::from(&self.status.status().stats);
            self.shown.note(now, whole, &counters, received);
            if let Some(copy) = painted.copy {
                self.capture.add(now, whole, received, copy);
            }
            self.counters = counters;
            // Includes waiting for the screen.
            self.quality.drawn(begun, self.frame_ms / 1e3);
        }
        let drawn = FrameStatus {
            shows,
            morphing: self.ground_moves
                || now_s - self.scene.changed_s() <= self.settings.morph_s
                || self.painter.renderer.fades_texture_tiles(),
            unfinished: self.counters.is_unfinished(),
            full,
            late_shadow_maps: self.counters.late_shadow_maps,
            waiting_steps: self.scene.waiting(),
            missing_tiles: self.scene.missing_tiles(),
        };
        let only_tiles = drawn.is_final_except_tiles() && self.status.status().settled;
        self.only_tiles_missing = shows && only_tiles && drawn.missing_tiles > 0;
        self.update_state(&drawn);
        self.last = (shows && drawn.is_final() && self.state != State::Refining).then(|| self.drawn());
        // Quality is raised only once the camera rests.
        let better = if full { None } else { self.quality.due(self.now()) };
        if self.only_tiles_missing && !self.keys.moves_camera() && !self.animation.is_playing() {
            return Ok(TILES_INTERVAL);
        }
        if self.keys.moves_camera()
            || (shows && self.animation.is_playing())
            || (shows && !drawn.is_final() && better.is_none_or(|wait| wait.is_zero()))
        {
            return Ok(Duration::ZERO);
        }
        // The overlay's values change while data arrives, and once more after it stops.
        let figures = self.state == State::Refining || self.bits_per_s > 0.0;
        let notice = self.notice_left().unwrap_or(Duration::MAX);
        let repaint_after =
            painted.repaint_after.min(notice).min(better.filter(|_| shows).unwrap_or(Duration::MAX));
        let interval = if shows && self.awaits_scene() { PROGRESS_INTERVAL } else { OVERLAY_INTERVAL };
        Ok(if figures { repaint_after.min(interval) } else { repaint_after })
    }

    /// Records that the scene looks otherwise than in the last picture.
    pub(super) fn scene_changed(&mut self) {
        self.last = None;
        self.dirty = true;
    }

    /// What the next picture depends on.
    fn drawn(&self) -> Drawn {
        let Choices { heights, target_px, .. } = self.choices;
        Drawn { camera: self.camera(), settings: self.settings, heights, target_px }
    }

    /// The frame's step of quality.
    fn step(&self) -> Step {
        if self.choices.adapt { self.quality.step() } else { lodestream_viewing::FULL }
    }

    /// The frame's shadow settings, without their staleness.
    fn shadows(&self) -> Option<Shadows> {
        self.step().limit(&self.settings).shadows
    }

    /// Updates the picture's state after a frame.
    fn update_state(&mut self, drawn: &FrameStatus) {
        let stats = &self.status.status().stats;
        self.state = State::of(self.status.status(), drawn, self.shown.presented().is_some());
        if self.awaits_scene() {
            self.state = State::Refining;
        }
        match self.state {
            State::Settled => self.shown.note_settled(self.clock.now().into()),
            State::Incomplete if !self.reported_incomplete => {
                self.reported_incomplete = true;
                tracing::warn!("{}", describe_missing(stats.lacking_blobs, &stats.lacking));
            }
            State::Incomplete | State::Refining => {}
        }
    }

    /// Draws scene and overlay, and applies changes made in the overlay.
    fn paint(&mut self, args: &Args, now_s: f32) -> anyhow::Result<Painted> {
        // Missing blobs are not waited for.
        let is_complete = self.scene.is_whole() || self.status.status().stats.lacking_blobs > 0;
        // The time for which it is held back begins with the stream, not with the preparation of files.
        let streamed = self.streaming.as_ref().map(|streaming| streaming.clock().now().into());
        let shows = streamed.is_some_and(|now| self.shown.may_show(is_complete, now));
        if !shows {
            // New data does not change the empty window, and drawing it would delay the first frame.
            if !self.is_empty()
                && let Some(left) = self.waiting.and_then(|at| OVERLAY_INTERVAL.checked_sub(at.elapsed()))
            {
                return Ok(Painted {
                    counters: None,
                    shows_kept: false,
                    copy: None,
                    picture: None,
                    repaint_after: left,
                });
            }
            self.waiting = Some(Instant::now());
        } else {
            self.prepare_ground()?;
        }
        self.settings.sections = self.section.with(&args.sections().unwrap_or_default());
        let overlay_state = self.overlay_state(shows);
        let table = self.choices.timed;
        self.painter.renderer.time_passes(&self.painter.gpu, table || args.stats.is_some());
        let (camera, step) = (self.camera(), self.step());
        let full = !self.choices.adapt || self.quality.is_full();
        let is_kept = full && self.last.is_some_and(|last| last == self.drawn()) && self.painter.has_kept();
        let mut choices = self.choices;
        let mut playback = self.animation.playback.clone();
        let mut scrubbed = false;
        let mut settings = step.limit(&self.settings);
        // While more changes are pending, shadows may be out of date for some frames.
        let morphing = now_s - self.scene.changed_s() <= self.settings.morph_s;
        let settled = self.status.status().settled && self.scene.waiting() == 0 && !morphing;
        let coming = if settled { 0 } else { self.quality.late_shadows() };
        // What moves by itself would get shadows of where it was, on itself too.
        let late = step.late_shadows.max(coming);
        let max_staleness = if self.animation.is_playing() { 0 } else { late };
        settings.shadows = settings.shadows.map(|shadows| Shadows { max_staleness, ..shadows });
        let (stats, scene) = (&self.status.status().stats, &self.scene);
        let draw = |draw: &mut painter::DrawScene<'_>| {
            scene.with_frame(camera, settings, now_s, |frame| draw(frame))
        };
        let below = match shows {
            true if is_kept => Below::Kept,
            true => Below::Scene { draw, keep: full },
            false => Below::Nothing,
        };
        let (open, parts) = (&mut self.open_panel, &mut self.part_list);
        let before = self.section.plane;
        let section = &mut self.section.plane;
        let painted = self.painter.paint(
            |ui| {
                let mut controls = OverlayControls { choices: &mut choices, open, parts, section };
                overlay::show(ui, stats, &overlay_state, &mut controls);
                if !choices.hidden {
                    scrubbed |= overlay::animation::show(ui, &self.animation.clips, &mut playback);
                }
            },
            below,
        )?;
        if scrubbed {
            self.animation.playback = playback;
            self.scene_changed();
        }
        if scrubbed || before != self.section.plane {
            self.painter.window.request_redraw();
        }
        if choices != self.choices {
            self.choices = choices;
            choices.apply(&mut self.settings);
            self.painter.window.request_redraw();
        }
        Ok(painted)
    }
}

/// The quality of frames, from the arguments.
fn quality(args: &Args, software: bool) -> Quality {
    Quality::new(software, args.frame_rate.map(|rate| rate.0))
}

/// The steps of a window's frame.
struct FrameSteps<'a> {
    running: &'a mut Running,
    args: &'a Args,
    began: Instant,
    now_s: f32,
}

impl Steps for FrameSteps<'_> {
    type Painted = Painted;

    fn receive(&mut self) -> anyhow::Result<()> {
        let running = &mut *self.running;
        if running.receive(self.args)? {
            running.scene_changed();
        }
        let was_whole = running.scene.is_whole();
        // The first frame needs few bytes: they are uploaded at once.
        let frame = Duration::from_secs_f64(running.frame_ms / 1e3);
        let budget = if running.shown.has_begun() { upload_budget(frame) } else { usize::MAX };
        running.scene.upload(&running.painter.gpu, &running.painter.renderer, budget, self.now_s)?;
        if running.scene.is_whole() && !was_whole {
            tracing::debug!(now = ?running.now(), "first frame uploaded");
        }
        if running.controller.is_none() {
            let args = self.args;
            running.controller = running.scene.header().map(|header| args.controller(header.camera));
        }
        running.play_animation(running.now())?;
        Ok(())
    }

    fn move_camera(&mut self) {
        let running = &mut *self.running;
        let now = running.now();
        keyboard::move_camera(now, &mut running.keys, running.controller.as_mut(), &mut running.quality);
        running.measure(self.began);
    }

    fn send_view(&mut self) {
        self.running.send_view();
    }

    fn paint(&mut self) -> anyhow::Result<Painted> {
        self.running.paint(self.args, self.now_s)
    }
}
