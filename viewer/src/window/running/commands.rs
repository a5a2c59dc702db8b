//! Keys of the window, and the picture that one of them writes.

use std::path::Path;
use std::time::Duration;

use image::RgbaImage;
use winit::keyboard::KeyCode;
use winit::window::Fullscreen;

use super::Running;
use crate::args::Args;
use crate::window::keyboard::{self, Action};
use crate::window::overlay::Panel;
use crate::window::screenshot;

/// Time for which a message about a picture or a file is shown.
const NOTICE: Duration = Duration::from_secs(6);

impl Running {
    /// Handles a key that went down or up; returns whether the window is to be closed.
    ///
    /// # Errors
    /// Errors of the graphics device.
    pub(in crate::window) fn key(&mut self, code: KeyCode, pressed: bool) -> anyhow::Result<bool> {
        let quality = &mut self.quality;
        let now = self.clock.now().into();
        let action = keyboard::key(now, code, pressed, &mut self.keys, self.controller.as_mut(), quality);
        if pressed {
            self.clicks.forget();
            self.pivot.forget_zoom();
        }
        let Some(action) = action else {
            if pressed {
                self.selection.forget_frame();
            }
            return Ok(false);
        };
        match action {
            Action::Frame => self.frame_pointer(),
            Action::Help => self.toggle(Panel::Help),
            Action::Information => self.toggle(Panel::Information),
            Action::Parts => self.toggle(Panel::Parts),
            Action::Settings => self.toggle(Panel::Settings),
            Action::Open => {
                self.toggle(Panel::Open);
                self.open_panel.refresh();
            }
            Action::Overlay => {
                self.choices.hidden ^= true;
                self.choices.panel = None;
            }
            Action::Wireframe => {
                self.choices.wireframe ^= true;
                self.choices.apply(&mut self.settings);
            }
            Action::Measure => self.measure.toggle(),
            Action::Section => {
                let forward = self.camera().rotation * glam::DVec3::NEG_Z;
                self.section.toggle(forward, self.streaming.as_ref());
            }
            Action::FullScreen => {
                let whole = self.painter.window.fullscreen().is_none();
                self.painter.window.set_fullscreen(whole.then_some(Fullscreen::Borderless(None)));
            }
            Action::Leave if self.measure.is_active() => self.measure.toggle(),
            Action::Leave if self.choices.panel.is_some() => self.choices.panel = None,
            Action::Leave => self.painter.window.set_fullscreen(None),
            Action::Picture => self.wants_picture = true,
            Action::Play | Action::NextClip | Action::PreviousClip => self.act_on_animation(action),
            Action::Quit => return Ok(true),
            other => {
                if let Some(streaming) = &self.streaming {
                    self.selection.act(other, &self.painter.gpu, &mut self.scene, streaming)?;
                    self.scene_changed();
                }
            }
        }
        Ok(false)
    }

    /// Opens or closes a panel.
    fn toggle(&mut self, panel: Panel) {
        self.choices.panel = (self.choices.panel != Some(panel)).then_some(panel);
    }

    /// Has the next frame copied, or begins a picture that the window does not show.
    pub(super) fn take_picture(&mut self, args: &Args) {
        let taken = match self.begin_picture(args) {
            Ok(false) => self.painter.take_picture(),
            begun => begun.map(drop),
        };
        if let Err(why) = taken {
            self.fail_to_write(&why);
        }
        self.dirty = true;
    }

    /// Writes a picture into the current folder, and says so.
    pub(super) fn save_picture(&mut self, picture: anyhow::Result<RgbaImage>) {
        match picture.and_then(|picture| screenshot::write(Path::new(""), &picture)) {
            Ok(path) => {
                tracing::info!("{} is written", path.display());
                self.notify_user(format!("{} is written", path.display()));
            }
            Err(why) => self.fail_to_write(&why),
        }
    }

    /// The window goes on without the picture.
    fn fail_to_write(&mut self, why: &anyhow::Error) {
        self.warn(format!("no picture: {why:#}"));
    }

    /// A warning for the log and over the picture.
    pub(super) fn warn(&mut self, message: String) {
        tracing::warn!("{message}");
        self.notify_user(message);
    }

    pub(super) fn notify_user(&mut self, message: String) {
        self.notice = Some((self.now() + NOTICE, message));
        self.painter.window.request_redraw();
        self.dirty = true;
    }

    /// Time for which the message about a picture is still shown.
    pub(super) fn notice_left(&self) -> Option<Duration> {
        self.notice.as_ref().map(|(until, _)| until.saturating_sub(self.now()))
    }

    /// Forgets the message about a picture once it was shown long enough; returns whether it did.
    pub(super) fn drop_old_notice(&mut self) -> bool {
        let now = self.now();
        self.notice.take_if(|(until, _)| *until <= now).is_some()
    }
}
