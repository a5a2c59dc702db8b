//! Window mode: camera, overlay, and a frame whenever something has changed.

mod app;
mod clicks;
mod event;
mod frame_capture;
mod keyboard;
mod measure;
mod open_panel;
mod overlay;
mod painter;
mod part_list;
mod pivot;
mod running;
mod screenshot;
mod section;
mod selection;
mod session_status;
mod state;
mod steps;
mod visible;

use anyhow::{Context, anyhow};
use winit::event_loop::EventLoop;

use crate::args::Args;
use crate::local::Target;
use crate::outcome::Outcome;
use crate::settings_file::SettingsFile;
use crate::signals;
use event::Event;
use keyboard::Bindings;

/// Runs the viewer in a window until it is closed.
///
/// # Errors
/// One line with the fault and the remedy.
pub(crate) fn run(args: &Args, target: Option<Target>) -> anyhow::Result<Outcome> {
    let settings = SettingsFile::load(args.settings.as_deref())?;
    let bindings = Bindings::new(&settings.keys()).with_context(|| settings.describe())?;
    let events = EventLoop::<Event>::with_user_event().build().map_err(|why| {
        // The window system's message names its source files, which does not help users.
        tracing::debug!("{why}");
        anyhow!(
            "no window can be opened: there is no Wayland or X11 display, or libraries are missing (Debian and Ubuntu: \
             apt-get install libwayland-client0 libx11-xcb1 libxcursor1 libxi6 libxkbcommon-x11-0); \
             without a display, add --headless --output FILE.png"
        )
    })?;
    let proxy = events.create_proxy();
    signals::on_termination(move |signal| {
        // Fails only once the window is gone.
        let _ = proxy.send_event(Event::End(signal));
    })?;
    let mut app =
        app::App::new(args.clone(), target, bindings, events.create_proxy(), events.owned_display_handle());
    events.run_app(&mut app).context("the window system failed")?;
    app.finish()
}
