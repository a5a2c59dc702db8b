//! The application: events in, frames out.

use std::collections::BTreeSet;
use std::sync::Arc;
use std::time::{Duration, Instant};

use lodestream_client::net::Retry;
use lodestream_client::streaming::{Controls, Streaming};
use lodestream_render::{Counters, Pose, SceneView, Settings};
use winit::application::ApplicationHandler;
use winit::dpi::{LogicalSize, PhysicalPosition};
use winit::event::{ElementState, MouseButton, MouseScrollDelta, StartCause, WindowEvent};
use winit::event_loop::{ActiveEventLoop, ControlFlow, EventLoopProxy, OwnedDisplayHandle};
use winit::keyboard::{KeyCode, PhysicalKey};
use winit::window::{Window, WindowId};

use super::camera::{Mode, Push, Rig};
use super::news::News;
use super::overlay::{self, Choices, Facts};
use super::painter::{Painted, Painter};
use super::steps::{self, Steps};
use crate::args::Args;
use crate::run::{core_config, settings, tell_figures};

/// Bytes uploaded per frame, so that a burst of chunks does not make it late.
const UPLOAD_BYTES: usize = 8 << 20;
/// Time between two pictures of the overlay while nothing else changes.
const OVERLAY_INTERVAL: Duration = Duration::from_millis(250);

/// What lives as long as the window.
struct Running {
    painter: Painter,
    streaming: Streaming,
    scene: SceneView,
    rig: Option<Rig>,
    news: News,
    adapter: String,
    settings: Settings,
    choices: Choices,
    keys: BTreeSet<KeyCode>,
    button: Option<MouseButton>,
    pointer: PhysicalPosition<f64>,
    drawn: Option<Instant>,
    moved: Instant,
    counters: Counters,
    frame_ms: f64,
    fps: f64,
    /// (moment, bytes) at the beginning of the interval over which throughput is measured.
    window_start: (Instant, u64),
    bits_per_s: f64,
    presented: Option<Duration>,
}

/// The application.
pub(super) struct App {
    args: Args,
    proxy: EventLoopProxy<()>,
    display: OwnedDisplayHandle,
    running: Option<Running>,
    error: Option<anyhow::Error>,
}

impl App {
    pub(super) fn new(args: Args, proxy: EventLoopProxy<()>, display: OwnedDisplayHandle) -> Self {
        Self { args, proxy, display, running: None, error: None }
    }

    /// After the event loop: writes what is to be written, and says what went wrong.
    pub(super) fn finish(self) -> anyhow::Result<()> {
        if let Some(error) = self.error {
            return Err(error);
        }
        let Some(running) = self.running else { return Ok(()) };
        tell_figures(&self.args, &running.news.status().stats, running.presented)
    }

    fn start(&self, events: &ActiveEventLoop) -> anyhow::Result<Running> {
        let [width, height] = self.args.window.0;
        let attributes = Window::default_attributes()
            .with_title(format!("Lodestream – {}", self.args.address))
            .with_inner_size(winit::dpi::PhysicalSize::new(width, height))
            .with_min_inner_size(LogicalSize::new(64, 64));
        let painter = Painter::new(Arc::new(events.create_window(attributes)?), self.display.clone())?;
        let proxy = self.proxy.clone();
        let streaming = Streaming::start(
            self.args.address.clone(),
            core_config(&self.args),
            Retry::default(),
            move || {
                // Fails only once the window is gone.
                let _ = proxy.send_event(());
            },
        )?;
        let settings = settings(&self.args);
        let proxy = self.proxy.clone();
        let scene = SceneView::with_terrain_apart(move || {
            let _ = proxy.send_event(());
        })?;
        let now = Instant::now();
        Ok(Running {
            adapter: painter.gpu.describe(),
            painter,
            streaming,
            scene,
            rig: self.args.camera.map(|camera| Rig::new(camera.0)),
            news: News::default(),
            choices: Choices::new(&settings, self.args.pixel_error.0),
            settings,
            keys: BTreeSet::new(),
            button: None,
            pointer: PhysicalPosition::default(),
            drawn: None,
            moved: now,
            counters: Counters::default(),
            frame_ms: 0.0,
            fps: 0.0,
            window_start: (now, 0),
            bits_per_s: 0.0,
            presented: None,
        })
    }

    fn fail(&mut self, events: &ActiveEventLoop, error: anyhow::Error) {
        self.error.get_or_insert(error);
        events.exit();
    }
}

impl Running {
    /// Keys that push the camera.
    fn pushed(&self) -> Push {
        let axis = |plus: KeyCode, minus: KeyCode| {
            f64::from(i8::from(self.keys.contains(&plus)) - i8::from(self.keys.contains(&minus)))
        };
        [
            axis(KeyCode::KeyD, KeyCode::KeyA),
            axis(KeyCode::KeyE, KeyCode::KeyQ),
            axis(KeyCode::KeyW, KeyCode::KeyS),
        ]
    }

    fn is_moving(&self) -> bool {
        self.rig.is_some() && self.pushed() != [0.0; 3]
    }

    /// Takes what the streaming thread has; says whether the picture may look different.
    fn receive(&mut self) -> bool {
        let status = self.streaming.status();
        let mut news = false;
        while self.scene.waiting() < 16
            && let Some(step) = self.streaming.take()
        {
            self.scene.push(step);
            news = true;
        }
        self.news.take(status) || news
    }

    /// Tells the streaming thread where the camera is, unless the selection is frozen.
    fn steer(&self) {
        if let Some(rig) = &self.rig
            && !self.choices.frozen
        {
            let view = rig.view(self.painter.size(), self.choices.target_px);
            self.streaming.control(Controls { view: Some(view), leave: false });
        }
    }

    fn measure(&mut self, now: Instant) {
        if let Some(drawn) = self.drawn.replace(now) {
            self.fps = 1.0 / (now - drawn).as_secs_f64().max(1e-6);
        }
        let (start, bytes) = self.window_start;
        let elapsed = (now - start).as_secs_f64();
        if elapsed >= 0.5 {
            let received = self.news.status().stats.transport_bytes;
            let bits = received.saturating_sub(bytes) as f64 * 8.0;
            self.bits_per_s = bits / elapsed;
            self.window_start = (now, received);
        }
    }

    /// Draws a frame; says when the next is due.
    fn frame(&mut self, args: &Args) -> anyhow::Result<Duration> {
        let began = Instant::now();
        let now_s = Duration::from(self.streaming.clock().now()).as_secs_f32();
        let painted = steps::run(&mut FrameSteps { running: self, args, began, now_s })?;
        if let Some(counters) = painted.counters {
            self.counters = counters;
            let first = self.news.status().stats.milestones.first_frame;
            if first.is_some() && self.scene.waiting() == 0 && self.presented.is_none() {
                self.presented = Some(self.streaming.clock().now().into());
            }
        }
        self.frame_ms = began.elapsed().as_secs_f64() * 1e3;
        let morphing = now_s - self.scene.changed_s() <= self.settings.morph_s;
        if self.is_moving() || morphing || self.scene.waiting() > 0 || self.scene.missing_tiles() > 0 {
            return Ok(Duration::ZERO);
        }
        // Figures change while something is received, and once more when nothing was for a while.
        let figures = !self.news.status().settled || self.bits_per_s > 0.0 || self.presented.is_none();
        Ok(if figures { painted.repaint_after.min(OVERLAY_INTERVAL) } else { painted.repaint_after })
    }

    /// Draws scene and overlay, and takes what was changed there.
    fn paint(&mut self, args: &Args, now_s: f32) -> anyhow::Result<Painted> {
        let address = args.address.to_string();
        let message = self.news.message();
        let facts = Facts {
            adapter: &self.adapter,
            address: &address,
            message: message.as_deref(),
            frame_ms: self.frame_ms,
            fps: self.fps,
            bits_per_s: self.bits_per_s,
            presented: self.presented,
            mode: match self.rig.map(|rig| rig.mode) {
                Some(Mode::Fly) => "fly",
                _ => "orbit",
            },
            camera: self.rig.map(|rig| rig.describe()).unwrap_or_default(),
            draw: self.counters.clone(),
            gpu_bytes: self.scene.geometry_bytes(),
            waiting_steps: self.scene.waiting(),
        };
        let camera = self.rig.map_or_else(
            || Pose::look_at(glam::DVec3::Z, glam::DVec3::ZERO, glam::DVec3::Y, 1.0),
            |rig| rig.pose(),
        );
        let [width, height] = self.painter.size();
        self.scene.prepare_ground(&self.painter.gpu, &camera, (width, height), self.choices.target_px)?;
        let mut choices = self.choices;
        let (stats, scene, settings) = (&self.news.status().stats, &self.scene, self.settings);
        let painted = self.painter.paint(
            |ui| overlay::show(ui, stats, &facts, &mut choices),
            |draw| scene.with_frame(camera, settings, now_s, |frame| draw(frame)),
        )?;
        if choices != self.choices {
            self.choices = choices;
            choices.apply(&mut self.settings);
            self.painter.window.request_redraw();
        }
        Ok(painted)
    }

    fn key(&mut self, code: KeyCode, pressed: bool) {
        if !pressed {
            self.keys.remove(&code);
            return;
        }
        if self.keys.is_empty() {
            self.moved = Instant::now();
        }
        self.keys.insert(code);
        if let Some(rig) = &mut self.rig {
            match code {
                KeyCode::KeyF => rig.toggle(),
                KeyCode::KeyR => rig.reset(),
                _ => {}
            }
        }
    }

    fn drag(&mut self, to: PhysicalPosition<f64>) -> bool {
        let (dx, dy) = (to.x - self.pointer.x, to.y - self.pointer.y);
        self.pointer = to;
        let height = f64::from(self.painter.size()[1]);
        match (&mut self.rig, self.button) {
            (Some(rig), Some(MouseButton::Left)) => rig.turn(dx, dy),
            (Some(rig), Some(MouseButton::Right | MouseButton::Middle)) => rig.pan(dx, dy, height),
            _ => return false,
        }
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
        running.scene.upload(&running.painter.gpu, &running.painter.renderer, UPLOAD_BYTES, self.now_s)?;
        if running.rig.is_none() {
            running.rig = running.scene.header().map(|header| Rig::new(header.camera));
        }
        Ok(())
    }

    fn move_camera(&mut self) {
        let running = &mut *self.running;
        let (push, fast) = (running.pushed(), running.keys.contains(&KeyCode::ShiftLeft));
        let seconds = (self.began - running.moved).as_secs_f64().min(0.25);
        running.moved = self.began;
        if let Some(rig) = &mut running.rig
            && push != [0.0; 3]
        {
            rig.push(push, fast, seconds);
        }
        running.measure(self.began);
    }

    fn send_view(&mut self) {
        self.running.steer();
    }

    fn paint(&mut self) -> anyhow::Result<Painted> {
        self.running.paint(self.args, self.now_s)
    }
}

impl ApplicationHandler<()> for App {
    fn resumed(&mut self, events: &ActiveEventLoop) {
        if self.running.is_none() {
            match self.start(events) {
                Ok(running) => {
                    running.painter.window.request_redraw();
                    self.running = Some(running);
                }
                Err(why) => self.fail(events, why),
            }
        }
    }

    fn new_events(&mut self, _: &ActiveEventLoop, cause: StartCause) {
        if let (StartCause::ResumeTimeReached { .. }, Some(running)) = (cause, &self.running) {
            running.painter.window.request_redraw();
        }
    }

    /// The streaming thread has something.
    fn user_event(&mut self, events: &ActiveEventLoop, (): ()) {
        let Some(running) = &mut self.running else { return };
        // An idle window draws no frames, in which its time would be looked at.
        let elapsed: Duration = running.streaming.clock().now().into();
        if running.receive() || self.args.timeout.is_some_and(|limit| elapsed >= limit.0) {
            running.painter.window.request_redraw();
        }
        if let Some(why) = running.news.fatal(running.scene.header().is_some()) {
            self.fail(events, anyhow::anyhow!(why));
        }
    }

    fn window_event(&mut self, events: &ActiveEventLoop, _: WindowId, event: WindowEvent) {
        let Some(running) = &mut self.running else { return };
        let (consumed, repaint) = running.painter.offer(&event);
        let mut redraw = repaint && !matches!(event, WindowEvent::RedrawRequested);
        match event {
            WindowEvent::CloseRequested => events.exit(),
            WindowEvent::Resized(size) => {
                running.painter.resize(size);
                running.steer();
                redraw = true;
            }
            WindowEvent::KeyboardInput { event, .. }
                if !consumed || event.state == ElementState::Released =>
            {
                if let PhysicalKey::Code(code) = event.physical_key
                    && !event.repeat
                {
                    running.key(code, event.state == ElementState::Pressed);
                    redraw = true;
                }
            }
            WindowEvent::Focused(false) => {
                running.keys.clear();
                running.button = None;
            }
            WindowEvent::MouseInput { state, button, .. } => {
                running.button = (state == ElementState::Pressed && !consumed).then_some(button);
            }
            WindowEvent::CursorMoved { position, .. } => redraw |= running.drag(position),
            WindowEvent::MouseWheel { delta, .. } if !consumed => {
                let lines = match delta {
                    MouseScrollDelta::LineDelta(_, y) => f64::from(y),
                    MouseScrollDelta::PixelDelta(by) => by.y / 40.0,
                };
                if let Some(rig) = &mut running.rig {
                    rig.wheel(lines);
                    redraw = true;
                }
            }
            WindowEvent::RedrawRequested => {
                let done = match running.frame(&self.args) {
                    Ok(wait) => {
                        if wait.is_zero() {
                            running.painter.window.request_redraw();
                            events.set_control_flow(ControlFlow::Wait);
                        } else {
                            let until = Instant::now().checked_add(wait);
                            events.set_control_flow(until.map_or(ControlFlow::Wait, ControlFlow::WaitUntil));
                        }
                        let elapsed: Duration = running.streaming.clock().now().into();
                        let settled = running.news.status().settled
                            && running.presented.is_some()
                            && running.scene.waiting() == 0;
                        (self.args.exit_when_settled && settled)
                            || self.args.timeout.is_some_and(|limit| elapsed >= limit.0)
                    }
                    Err(why) => return self.fail(events, why),
                };
                if done {
                    events.exit();
                }
            }
            _ => {}
        }
        if redraw {
            running.painter.window.request_redraw();
        }
    }
}
