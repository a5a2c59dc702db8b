//! Opening something else in an open window. What is shown stays until the first scene of the new files is ready.

use std::ffi::OsString;
use std::path::PathBuf;

use lodestream_bake::stderr::one_line;
use lodestream_client::net::Address;
use lodestream_render::SceneView;

use super::Running;
use super::animation::Animation;
use super::streams::{Opening, prepare, stream, title};
use crate::args::Args;
use crate::frames::FrameLog;
use crate::local::{Preparation, Target};
use crate::recent;
use crate::run::check;
use crate::window::measure::Measure;
use crate::window::overlay::Panel;
use crate::window::part_list::PartList;
use crate::window::pivot::Pivot;
use crate::window::section::Section;
use crate::window::selection::Selection;
use crate::window::session_status::SessionStatus;
use crate::window::state::State;

impl Running {
    /// A file was dropped; those dropped together come one after another.
    pub(in crate::window) fn drop_file(&mut self, path: PathBuf) {
        self.hovers = false;
        self.dropped.push(path.into());
    }

    /// Files are held over the window, or no longer.
    pub(in crate::window) fn hover(&mut self, hovers: bool) {
        self.hovers = hovers;
        self.dirty = true;
    }

    /// Opens what was dropped or chosen since the last call; returns whether there was anything.
    pub(in crate::window) fn open_chosen(&mut self, args: &Args) -> bool {
        let dropped = std::mem::take(&mut self.dropped);
        let chosen = self.open_panel.chosen.take();
        let Some(words) = Some(dropped).filter(|words| !words.is_empty()).or(chosen) else { return false };
        if self.choices.panel == Some(Panel::Open) {
            self.choices.panel = None;
        }
        if let Err(why) = self.open(args, &words) {
            self.warn(format!("not opened: {}", one_line(why.as_ref())));
        }
        self.dirty = true;
        true
    }

    fn open(&mut self, args: &Args, words: &[OsString]) -> anyhow::Result<()> {
        let target = Target::of(words)?;
        check(args, &target)?;
        self.remember(words);
        match &target {
            Target::Stream(address) => {
                self.opening = None;
                self.replace(args, &target, address, None)
            }
            Target::Files(paths) => {
                // Its folder is closed before the new one is made.
                self.opening = None;
                let files = prepare(args, paths, &self.notify)?;
                self.opening = Some(Opening { target, files });
                Ok(())
            }
        }
    }

    /// Puts words first among what was opened last.
    pub(super) fn remember(&mut self, words: &[OsString]) {
        if let Some(file) = recent::default_file() {
            self.open_panel.recent = recent::add(&file, words);
        }
    }

    /// Takes what has become ready of files that are being opened; returns whether there was anything.
    pub(super) fn receive_opening(&mut self, args: &Args) -> anyhow::Result<bool> {
        let Some(opening) = &self.opening else { return Ok(false) };
        if let Some(why) = opening.files.take_failure() {
            self.opening = None;
            self.warn(format!("not opened: {}", one_line(why.as_ref())));
            return Ok(true);
        }
        let Some(ready) = opening.files.take_ready() else { return Ok(false) };
        let Some(Opening { target, files }) = self.opening.take() else { return Ok(false) };
        self.replace(args, &target, &ready.address, Some(files))?;
        Ok(true)
    }

    /// Begins to show another scene, from its own camera.
    fn replace(
        &mut self,
        args: &Args,
        target: &Target,
        address: &Address,
        files: Option<Preparation>,
    ) -> anyhow::Result<()> {
        let streaming = stream(args, address, &self.notify)?;
        let mut scene = SceneView::with_terrain_apart(self.notify.call())?;
        scene.set_vertical_exaggeration(self.choices.heights[0], 0.0, 0.0)?;
        (self.streaming, self.files, self.next, self.scene) = (Some(streaming), files, None, scene);
        (self.controller, self.status, self.selection) =
            (None, SessionStatus::default(), Selection::default());
        (self.part_list, self.measure, self.pivot) =
            (PartList::default(), Measure::default(), Pivot::default());
        (self.section, self.picture) = (Section::default(), None);
        self.animation = Animation::new(crate::animation::playback(args));
        (self.shown, self.state, self.reported_incomplete) = (FrameLog::default(), State::Refining, false);
        (self.transport, self.stays_open, self.waiting) = (target.transport(), true, None);
        self.address = target.to_string();
        self.painter.window.set_title(&title(Some(target)));
        self.dirty = true;
        Ok(())
    }

    /// What is shown cannot be: the window is empty, with a message.
    pub(in crate::window) fn give_up(&mut self, why: &str) {
        (self.streaming, self.files, self.next, self.picture) = (None, None, None, None);
        self.status = SessionStatus::default();
        self.warn(why.to_owned());
    }

    /// Whether nothing is shown, and nothing is being opened.
    pub(super) fn is_empty(&self) -> bool {
        self.streaming.is_none() && self.files.is_none() && self.opening.is_none()
    }
}
