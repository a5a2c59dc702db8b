//! The application: events in, frames out.

use std::rc::Rc;
use std::time::Instant;

use winit::application::ApplicationHandler;
use winit::event::{ElementState, MouseScrollDelta, StartCause, WindowEvent};
use winit::event_loop::{ActiveEventLoop, ControlFlow, EventLoopProxy, OwnedDisplayHandle};
use winit::keyboard::PhysicalKey;
use winit::window::WindowId;

use super::event::Event;
use super::keyboard::Bindings;
use super::running::Running;
use super::state::State;
use crate::args::Args;
use crate::local::Target;
use crate::outcome::Outcome;
use crate::run::write_statistics;

/// The application.
pub(super) struct App {
    args: Args,
    target: Option<Target>,
    bindings: Rc<Bindings>,
    proxy: EventLoopProxy<Event>,
    display: OwnedDisplayHandle,
    running: Option<Running>,
    outcome: Outcome,
    error: Option<anyhow::Error>,
}

impl App {
    pub(super) fn new(
        args: Args,
        target: Option<Target>,
        bindings: Bindings,
        proxy: EventLoopProxy<Event>,
        display: OwnedDisplayHandle,
    ) -> Self {
        let bindings = Rc::new(bindings);
        let outcome = Outcome::Finished;
        Self { args, target, bindings, proxy, display, running: None, outcome, error: None }
    }

    /// Writes statistics and captured frames after the event loop; returns the run's outcome or error.
    pub(super) fn finish(self) -> anyhow::Result<Outcome> {
        if let Some(error) = self.error {
            return Err(error);
        }
        if let Some(mut running) = self.running {
            running.shown.note_times(running.painter.renderer.timings());
            let stats = &running.status.status().stats;
            write_statistics(&self.args, running.transport, stats, &running.shown)?;
            if let Some(folder) = &self.args.frames {
                running.capture.write(&running.painter.gpu, folder, running.state != State::Refining)?;
            }
        }
        Ok(self.outcome)
    }

    fn start(&self, events: &ActiveEventLoop) -> anyhow::Result<Running> {
        let (bindings, proxy, display) =
            (Rc::clone(&self.bindings), self.proxy.clone(), self.display.clone());
        Running::start(&self.args, self.target.as_ref(), bindings, proxy, display, events)
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
                if changed {
                    running.scene_changed();
                }
                running.dirty = true;
                running.painter.window.request_redraw();
            }
            Ok(_) => {}
            Err(why) => return self.fail(events, why),
        }
        let Some(running) = &mut self.running else { return };
        match running.status.fatal(running.scene.header().is_some()) {
            Some(why) if running.stays_open => running.give_up(&why),
            Some(why) => self.fail(events, anyhow::anyhow!(why)),
            None => {}
        }
    }

    fn about_to_wait(&mut self, _: &ActiveEventLoop) {
        if let Some(running) = &mut self.running
            && running.open_chosen(&self.args)
        {
            running.painter.window.request_redraw();
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
                redraw |= running.wheel(lines);
            }
            WindowEvent::PinchGesture { delta, .. } if !consumed => redraw |= running.pinch(delta),
            WindowEvent::DroppedFile(path) => running.drop_file(path),
            WindowEvent::HoveredFile(_) => {
                running.hover(true);
                redraw = true;
            }
            WindowEvent::HoveredFileCancelled => {
                running.hover(false);
                redraw = true;
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
