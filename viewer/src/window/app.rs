//! The application: events in, frames out.

use std::time::Instant;

use winit::application::ApplicationHandler;
use winit::event::{ElementState, MouseScrollDelta, StartCause, WindowEvent};
use winit::event_loop::{ActiveEventLoop, ControlFlow, EventLoopProxy, OwnedDisplayHandle};
use winit::keyboard::PhysicalKey;
use winit::window::WindowId;

use super::event::Event;
use super::running::Running;
use super::state::State;
use crate::args::Args;
use crate::local::Target;
use crate::outcome::Outcome;
use crate::run::write_statistics;

/// The application.
pub(super) struct App {
    args: Args,
    target: Target,
    proxy: EventLoopProxy<Event>,
    display: OwnedDisplayHandle,
    running: Option<Running>,
    outcome: Outcome,
    error: Option<anyhow::Error>,
}

impl App {
    pub(super) fn new(
        args: Args,
        target: Target,
        proxy: EventLoopProxy<Event>,
        display: OwnedDisplayHandle,
    ) -> Self {
        Self { args, target, proxy, display, running: None, outcome: Outcome::Finished, error: None }
    }

    /// Writes statistics and captured frames after the event loop; returns the run's outcome or error.
    pub(super) fn finish(self) -> anyhow::Result<Outcome> {
        if let Some(error) = self.error {
            return Err(error);
        }
        if let Some(mut running) = self.running {
            running.shown.note_times(running.painter.renderer.timings());
            write_statistics(
                &self.args,
                self.target.transport(),
                &running.status.status().stats,
                &running.shown,
            )?;
            if let Some(folder) = &self.args.frames {
                running.capture.write(&running.painter.gpu, folder, running.state != State::Refining)?;
            }
        }
        Ok(self.outcome)
    }

    fn start(&self, events: &ActiveEventLoop) -> anyhow::Result<Running> {
        Running::start(&self.args, &self.target, self.proxy.clone(), self.display.clone(), events)
    }

    fn fail(&mut self, events: &ActiveEventLoop, error: anyhow::Error) {
        self.error.get_or_insert(error);
        events.exit();
    }
}

impl ApplicationHandler<Event> for App {
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

    fn user_event(&mut self, events: &ActiveEventLoop, event: Event) {
        if let Event::End(signal) = event {
            self.outcome = Outcome::Interrupted(signal);
            return events.exit();
        }
        let Some(running) = &mut self.running else { return };
        // The timeout is checked here too, because an idle window draws no frames.
        let late = self.args.timeout.is_some_and(|limit| running.now() >= limit.0);
        match running.receive(&self.args) {
            Ok(changed) if changed || running.awaits_answer() || late => {
                running.dirty = true;
                running.painter.window.request_redraw();
            }
            Ok(_) => {}
            Err(why) => return self.fail(events, why),
        }
        let Some(running) = &self.running else { return };
        if let Some(why) = running.status.fatal(running.scene.header().is_some()) {
            self.fail(events, anyhow::anyhow!(why));
        }
    }

    fn window_event(&mut self, events: &ActiveEventLoop, _: WindowId, event: WindowEvent) {
        let Some(running) = &mut self.running else { return };
        let (consumed, repaint) = running.painter.pass_event(&event);
        let mut redraw = repaint && !matches!(event, WindowEvent::RedrawRequested);
        match event {
            WindowEvent::CloseRequested => events.exit(),
            WindowEvent::Resized(size) => {
                running.painter.resize(size);
                running.send_view();
                redraw = true;
            }
            WindowEvent::KeyboardInput { event, .. }
                if !consumed || event.state == ElementState::Released =>
            {
                if let PhysicalKey::Code(code) = event.physical_key
                    && !event.repeat
                {
                    match running.key(code, event.state == ElementState::Pressed) {
                        Ok(true) => events.exit(),
                        Ok(false) => {}
                        Err(why) => return self.fail(events, why),
                    }
                    redraw = true;
                }
            }
            WindowEvent::Focused(false) => {
                let now = running.now();
                running.keys.release(now, running.controller.as_mut());
                running.button = None;
            }
            WindowEvent::MouseInput { state, button, .. } => {
                running.button(button, state == ElementState::Pressed, consumed);
            }
            WindowEvent::CursorMoved { position, .. } => redraw |= running.drag(position),
            WindowEvent::MouseWheel { delta, .. } if !consumed => {
                let lines = match delta {
                    MouseScrollDelta::LineDelta(_, y) => f64::from(y),
                    MouseScrollDelta::PixelDelta(by) => by.y / 40.0,
                };
                if let Some(controller) = &mut running.controller {
                    controller.wheel(lines);
                    running.camera_moved();
                    redraw = true;
                }
            }
            WindowEvent::RedrawRequested => {
                match running.frame(&self.args) {
                    Ok(wait) if wait.is_zero() => {
                        running.painter.window.request_redraw();
                        events.set_control_flow(ControlFlow::Wait);
                    }
                    Ok(wait) => {
                        let until = Instant::now().checked_add(wait);
                        events.set_control_flow(until.map_or(ControlFlow::Wait, ControlFlow::WaitUntil));
                    }
                    Err(why) => return self.fail(events, why),
                }
                if self.args.exit_when_settled && running.state != State::Refining {
                    if running.state == State::Incomplete {
                        self.outcome = Outcome::Incomplete;
                    }
                    events.exit();
                }
                if self.args.timeout.is_some_and(|limit| running.now() >= limit.0) {
                    events.exit();
                }
            }
            _ => {}
        }
        if redraw {
            running.dirty = true;
            running.painter.window.request_redraw();
        }
    }
}
