//! What lives as long as the window, and what a frame of it does.

use std::sync::Arc;
use std::time::{Duration, Instant};

use lodestream_client::net::Retry;
use lodestream_client::streaming::{Controls, Streaming};
use lodestream_render::{
    Counters, MAX_WAITING_STEPS, Pose, SceneView, Settings, Shadows, Timings, upload_budget,
};
use winit::dpi::{LogicalSize, PhysicalPosition};
use winit::event::MouseButton;
use winit::event_loop::{ActiveEventLoop, OwnedDisplayHandle};
use winit::keyboard::KeyCode;
use winit::window::Window;

use super::camera::{CameraController, Mode};
use super::frame_capture::FrameCapture;
use super::input;
use super::keys::Keys;
use super::overlay::{self, Choices, Facts};
use super::painter::{self, Painted, Painter};
use super::quality::{self, Quality, Step};
use super::session_status::SessionStatus;
use super::state::{Drawn, State};
use super::steps::{self, Steps};
use crate::args::Args;
use crate::frames::{Received, Shown};
use crate::outcome::lacks;
use crate::run::{core_config, server, settings};
use crate::token;

/// Time between two looks at the tiles that are being made, while nothing else changes.
const TILES_INTERVAL: Duration = Duration::from_millis(50);
/// Time between two pictures of the overlay while nothing else changes.
const OVERLAY_INTERVAL: Duration = Duration::from_millis(250);

/// What lives as long as the window.
pub(super) struct Running {
    pub(super) painter: Painter,
    streaming: Streaming,
    pub(super) scene: SceneView,
    pub(super) controller: Option<CameraController>,
    pub(super) status: SessionStatus,
    adapter: String,
    settings: Settings,
    choices: Choices,
    pub(super) keys: Keys,
    pub(super) button: Option<MouseButton>,
    pointer: PhysicalPosition<f64>,
    drawn: Option<Instant>,
    counters: Counters,
    frame_ms: f64,
    fps: f64,
    /// (moment, bytes) at the beginning of the interval over which throughput is measured.
    window_start: (Instant, u64),
    bits_per_s: f64,
    pub(super) quality: Quality,
    /// Whether the last frame showed all there is but for tiles of the terrain.
    only_tiles_missing: bool,
    /// Heights of the ground are on their way.
    ground_moves: bool,
    /// By how much the ground below the eye is higher than the scene's.
    rise: f64,
    /// Something else than time asks for a frame.
    pub(super) dirty: bool,
    pub(super) shown: Shown,
    pub(super) capture: FrameCapture,
    /// When the window said last what it waits for, before there was a scene in it.
    waiting: Option<Instant>,
    pub(super) state: State,
    /// Whether it was said that the picture is incomplete.
    told_incomplete: bool,
}

impl Running {
    /// Begins to stream, opens the window and its device.
    ///
    /// # Errors
    /// One line that says what went wrong and what to do.
    pub(super) fn start(
        args: &Args,
        notify: impl Fn() + Clone + Send + 'static,
        display: OwnedDisplayHandle,
        events: &ActiveEventLoop,
    ) -> anyhow::Result<Self> {
        // First of all: the server answers while the window's device is opened and its pipelines are made.
        let mut streaming =
            Streaming::start(server(args)?, core_config(args)?, Retry::default(), notify.clone())?;
        token::follow(args.token_file.as_ref(), &streaming)?;
        let [width, height] = args.window.0;
        let attributes = Window::default_attributes()
            .with_title(format!("Lodestream – {}", args.address))
            .with_inner_size(winit::dpi::PhysicalSize::new(width, height))
            .with_min_inner_size(LogicalSize::new(64, 64));
        let mut scene = SceneView::with_terrain_apart(notify)?;
        // What needs no device is done while it is opened: tables are computed, the terrain is measured.
        std::thread::Builder::new().name("tables".into()).spawn(lodestream_render::compute_tables)?;
        let first_args = args.clone();
        let painter = Painter::new(
            Arc::new(events.create_window(attributes)?),
            display,
            args.frames.is_some(),
            move |gpu| {
                let full = settings(&first_args, gpu.is_software());
                [vec![Quality::new(gpu.is_software()).step().of(&full)], quality::all_of(&full)]
            },
            || {
                while scene.waiting() < MAX_WAITING_STEPS
                    && let Some(step) = streaming.take()
                {
                    scene.push(step);
                }
            },
        )?;
        tracing::debug!(now = ?Duration::from(streaming.clock().now()), "window and pipelines are made");
        let settings = settings(args, painter.gpu.is_software());
        let now = Instant::now();
        Ok(Self {
            adapter: painter.gpu.describe(),
            streaming,
            scene,
            controller: args.camera.map(|camera| CameraController::new(camera.0)),
            status: SessionStatus::default(),
            choices: Choices {
                hidden: args.no_overlay,
                ..Choices::new(&settings, args.pixel_error.0, [args.ground_heights, args.ground_seconds])
            },
            settings,
            keys: Keys::default(),
            button: None,
            pointer: PhysicalPosition::default(),
            drawn: None,
            counters: Counters::default(),
            frame_ms: 0.0,
            fps: 0.0,
            window_start: (now, 0),
            bits_per_s: 0.0,
            quality: Quality::new(painter.is_software()),
            only_tiles_missing: false,
            ground_moves: false,
            rise: 0.0,
            dirty: false,
            shown: Shown::default(),
            capture: FrameCapture::default(),
            painter,
            waiting: Some(now),
            state: State::Refining,
            told_incomplete: false,
        })
    }

    pub(super) fn now(&self) -> Duration {
        self.streaming.clock().now().into()
    }

    /// Takes what the streaming thread has; says whether the picture may look different.
    pub(super) fn receive(&mut self) -> bool {
        // The status first: what it says is settled lies in the steps taken after it.
        let status = self.streaming.status();
        if let Some(message) = &status.message
            && Some(message) != self.status.status().message.as_ref()
        {
            tracing::info!("{message}");
        }
        let mut changed = false;
        while self.scene.waiting() < MAX_WAITING_STEPS
            && let Some(step) = self.streaming.take()
        {
            self.scene.push(step);
            changed = true;
        }
        self.status.take(status) || changed
    }

    /// Tells the streaming thread where the camera is and whether there are shadows, unless the selection is frozen.
    pub(super) fn steer(&self) {
        if let Some(controller) = &self.controller
            && !self.choices.frozen
        {
            // Only while it moves: the first picture waits for nothing coarser.
            let meshes = if self.quality.is_moving(self.now()) { self.step().meshes } else { 1.0 };
            let mut view = controller.view(self.painter.size(), self.choices.target_px * meshes);
            // The server knows what stands on the ground where the scene has it.
            view.eye[1] -= self.rise;
            let shadows = Some(self.choices.shadows);
            self.streaming.control(Controls { view: Some(view), shadows, leave: false });
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

    /// Whether the picture would be the last one again: nothing but tiles of the terrain is waited for, and those that came
    /// since are not enough for finer ground. Drawing it would only take the processor from those who make them.
    fn is_unchanged(&mut self) -> anyhow::Result<bool> {
        if self.ground_moves
            || !self.only_tiles_missing
            || std::mem::take(&mut self.dirty)
            || self.keys.is_pushing()
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

    /// Moves the ground on, and the camera with what is below it.
    fn move_ground(&mut self) -> anyhow::Result<()> {
        let now_s = self.now().as_secs_f32();
        let [factor, seconds] = self.choices.heights;
        // What nobody has seen is not moved.
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

    /// Draws a frame; says when the next is due.
    pub(super) fn frame(&mut self, args: &Args) -> anyhow::Result<Duration> {
        if self.is_unchanged()? {
            return Ok(TILES_INTERVAL);
        }
        // What has come until now is in this frame.
        self.dirty = false;
        let (began, begun) = (Instant::now(), self.now());
        let now_s = begun.as_secs_f32();
        let painted = steps::run(&mut FrameSteps { running: self, args, began, now_s })?;
        self.frame_ms = began.elapsed().as_secs_f64() * 1e3;
        let shows = painted.counters.is_some();
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
            // What the screen is waited for is in it.
            self.quality.drawn(begun, self.frame_ms / 1e3);
        }
        let drawn = Drawn {
            shows,
            morphing: self.ground_moves || now_s - self.scene.changed_s() <= self.settings.morph_s,
            unfinished: self.counters.is_unfinished(),
            full,
            late_shadow_maps: self.counters.late_shadow_maps,
            waiting_steps: self.scene.waiting(),
            missing_tiles: self.scene.missing_tiles(),
        };
        let only_tiles = drawn.lacks_tiles_at_most() && self.status.status().settled;
        self.only_tiles_missing = shows && only_tiles && drawn.missing_tiles > 0;
        self.look_at_state(&drawn);
        // While the camera may move on, the picture is not made better yet.
        let better = if full { None } else { self.quality.due(self.now()) };
        if self.only_tiles_missing && !self.keys.is_pushing() {
            return Ok(TILES_INTERVAL);
        }
        if self.keys.is_pushing() || (shows && !drawn.rests() && better.is_none_or(|wait| wait.is_zero())) {
            return Ok(Duration::ZERO);
        }
        // Figures change while something is received, and once more when nothing was for a while.
        let figures = self.state == State::Refining || self.bits_per_s > 0.0;
        let repaint_after = painted.repaint_after.min(better.filter(|_| shows).unwrap_or(Duration::MAX));
        Ok(if figures { repaint_after.min(OVERLAY_INTERVAL) } else { repaint_after })
    }

    /// What the frame gives up of its quality.
    fn step(&self) -> Step {
        if self.choices.adapt { self.quality.step() } else { quality::FULL }
    }

    /// The frame's shadows, but for how late they may be.
    fn shadows(&self) -> Option<Shadows> {
        self.step().of(&self.settings).shadows
    }

    /// Says how far the picture is.
    fn look_at_state(&mut self, drawn: &Drawn) {
        let stats = &self.status.status().stats;
        self.state = State::of(self.status.status(), drawn, self.shown.presented().is_some());
        match self.state {
            State::Settled => self.shown.note_settled(self.streaming.clock().now().into()),
            State::Incomplete if !self.told_incomplete => {
                self.told_incomplete = true;
                tracing::warn!("{}", lacks(stats.lacking_blobs, &stats.lacking));
            }
            State::Incomplete | State::Refining => {}
        }
    }

    /// Draws scene and overlay, and takes what was changed there.
    fn paint(&mut self, args: &Args, now_s: f32) -> anyhow::Result<Painted> {
        let address = args.address.to_string();
        // What does not come is not waited for: the others are shown.
        let all_there_is = self.scene.is_whole() || self.status.status().stats.lacking_blobs > 0;
        let shows = self.shown.may_show(all_there_is, self.now());
        if !shows {
            // What arrives meanwhile changes nothing on the screen, and a frame would keep the first one waiting.
            if let Some(left) = self.waiting.and_then(|at| OVERLAY_INTERVAL.checked_sub(at.elapsed())) {
                return Ok(Painted { counters: None, copy: None, repaint_after: left });
            }
            self.waiting = Some(Instant::now());
        } else {
            self.prepare_ground()?;
        }
        let message = self.status.message().or_else(|| (!shows).then(|| self.loading().into()));
        let facts = Facts {
            adapter: &self.adapter,
            address: &address,
            message: message.as_deref(),
            frame_ms: self.frame_ms,
            fps: self.fps,
            bits_per_s: self.bits_per_s,
            presented: self.shown.presented(),
            state: self.state,
            quality: if self.choices.adapt { self.quality.describe() } else { "full".into() },
            mode: match self.controller.map(|controller| controller.mode) {
                Some(Mode::Fly) => "fly",
                _ => "orbit",
            },
            camera: self.controller.map(|controller| controller.describe()).unwrap_or_default(),
            draw: self.counters.clone(),
            gpu_bytes: self.scene.geometry_bytes(),
            waiting_steps: self.scene.waiting(),
            times: if self.choices.timed { self.painter.renderer.timings() } else { Timings::default() },
        };
        let table = self.choices.timed && !self.choices.hidden;
        self.painter.renderer.time_passes(&self.painter.gpu, table || args.stats.is_some());
        let (camera, step) = (self.camera(), self.step());
        let mut choices = self.choices;
        let mut settings = step.of(&self.settings);
        // While there is more to come, the next frame is soon enough.
        let morphing = now_s - self.scene.changed_s() <= self.settings.morph_s;
        let settled = self.status.status().settled && self.scene.waiting() == 0 && !morphing;
        let coming = if settled { 0 } else { self.quality.late_shadows() };
        let max_staleness = step.late_shadows.max(coming);
        settings.shadows = settings.shadows.map(|shadows| Shadows { max_staleness, ..shadows });
        let (stats, scene) = (&self.status.status().stats, &self.scene);
        let painted = self.painter.paint(
            |ui| overlay::show(ui, stats, &facts, &mut choices),
            shows.then_some(|draw: &mut painter::DrawScene<'_>| {
                scene.with_frame(camera, settings, now_s, |frame| draw(frame))
            }),
        )?;
        if choices != self.choices {
            self.choices = choices;
            choices.apply(&mut self.settings);
            self.painter.window.request_redraw();
        }
        Ok(painted)
    }

    /// What is said while the first frame is not complete.
    fn loading(&self) -> String {
        let stats = &self.status.status().stats;
        let (here, all) = (stats.counters.drawable_instances, stats.counters.visible_instances);
        if all == 0 {
            "waiting for the scene".into()
        } else {
            format!("loading: {here} of {all} objects in view")
        }
    }

    pub(super) fn key(&mut self, code: KeyCode, pressed: bool) {
        input::key(self.now(), code, pressed, &mut self.keys, self.controller.as_mut(), &mut self.quality);
        if code == KeyCode::KeyH && pressed && self.controller.is_some() {
            self.choices.hidden ^= true;
        }
    }

    pub(super) fn drag(&mut self, to: PhysicalPosition<f64>) -> bool {
        let (dx, dy) = (to.x - self.pointer.x, to.y - self.pointer.y);
        self.pointer = to;
        let height = f64::from(self.painter.size()[1]);
        match (&mut self.controller, self.button) {
            (Some(controller), Some(MouseButton::Left)) => controller.turn(dx, dy),
            (Some(controller), Some(MouseButton::Right | MouseButton::Middle)) => {
                controller.pan(dx, dy, height)
            }
            _ => return false,
        }
        self.quality.moved(self.now());
        true
    }
}

/// A frame of the window.
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
        running.receive();
        let was_whole = running.scene.is_whole();
        // What the first frame needs is little, and is not put off.
        let frame = Duration::from_secs_f64(running.frame_ms / 1e3);
        let budget = if running.shown.has_begun() { upload_budget(frame) } else { usize::MAX };
        running.scene.upload(&running.painter.gpu, &running.painter.renderer, budget, self.now_s)?;
        if running.scene.is_whole() && !was_whole {
            tracing::debug!(now = ?running.now(), "first frame uploaded");
        }
        if running.controller.is_none() {
            running.controller = running.scene.header().map(|header| CameraController::new(header.camera));
        }
        Ok(())
    }

    fn move_camera(&mut self) {
        let running = &mut *self.running;
        let now = running.now();
        input::move_camera(now, &mut running.keys, running.controller.as_mut(), &mut running.quality);
        running.measure(self.began);
    }

    fn send_view(&mut self) {
        self.running.steer();
    }

    fn paint(&mut self) -> anyhow::Result<Painted> {
        self.running.paint(self.args, self.now_s)
    }
}
