//! Keys of the window, and the picture that one of them writes.

use std::path::Path;
use std::time::Duration;

use lodestream_render::TargetCopy;
use winit::keyboard::KeyCode;
use winit::window::Fullscreen;

use super::Running;
use crate::window::input::{self, Command};
use crate::window::screenshot;

/// Time for which a message about a written picture is shown.
const NOTICE: Duration = Duration::from_secs(4);

impl Running {
    /// Handles a key that went down or up; returns whether the window is to be closed.
    ///
    /// # Errors
    /// Errors of the graphics device.
    pub(in crate::window) fn key(&mut self, code: KeyCode, pressed: bool) -> anyhow::Result<bool> {
        input::key(self.now(), code, pressed, &mut self.keys, self.controller.as_mut(), &mut self.quality);
        if !pressed {
            return Ok(false);
        }
        self.clicks.forget();
        let control = self.keys.is_control_held();
        match input::command(code, control) {
            Some(Command::Frame) => self.frame_pointer(),
            Some(Command::Overlay) if self.controller.is_some() => self.choices.hidden ^= true,
            Some(Command::Overlay) => {}
            Some(Command::FullScreen) => {
                let whole = self.painter.window.fullscreen().is_none();
                self.painter.window.set_fullscreen(whole.then_some(Fullscreen::Borderless(None)));
            }
            Some(Command::LeaveFullScreen) => self.painter.window.set_fullscreen(None),
            Some(Command::Picture) => {
                if let Err(why) = self.painter.take_picture() {
                    self.fail_to_write(&why);
                }
            }
            Some(Command::Quit) => return Ok(true),
            None if !control && self.animation_key(code) => {}
            None => {
                if let Some(streaming) = self.streaming.as_ref().filter(|_| !control) {
                    self.selection.key(code, &self.painter.gpu, &mut self.scene, streaming)?;
                }
            }
        }
        Ok(false)
    }

    /// Writes a picture into the current folder, and says so.
    pub(super) fn write_picture(&mut self, copy: TargetCopy) {
        let picture = copy.picture(&self.painter.gpu).map_err(anyhow::Error::from);
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
        tracing::warn!("no picture: {why:#}");
        self.notify_user(format!("no picture: {why:#}"));
    }

    fn notify_user(&mut self, message: String) {
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
