//! The window's scene: begins to stream it once files are prepared, and replaces a coarse one by a finer one.

use lodestream_bake::stderr::one_line;
use lodestream_client::streaming::Status;
use lodestream_render::SceneView;

use super::Running;
use super::streams::{NextScene, stream, take_steps};
use crate::args::Args;
use crate::local::Preparation;
use crate::window::session_status::SessionStatus;

impl Running {
    /// Takes status and steps from the streaming threads, and scenes of files that are prepared; returns whether the
    /// picture may change.
    ///
    /// # Errors
    /// Files that cannot be prepared; no thread; errors of the graphics device.
    pub(in crate::window) fn receive(&mut self, args: &Args) -> anyhow::Result<bool> {
        let mut changed = self.receive_opening(args)?;
        changed |= self.receive_files(args)?;
        changed |= self.receive_next()?;
        let Some(streaming) = &mut self.streaming else { return Ok(changed) };
        // Before the steps: a status that says settled refers to steps that are taken below.
        let status = streaming.status();
        if let Some(message) = &status.message
            && Some(message) != self.status.status().message.as_ref()
        {
            tracing::info!("{message}");
        }
        changed |= take_steps(streaming, &mut self.scene);
        Ok(self.status.take(status) || changed)
    }

    /// Begins to stream a scene of files that has become ready.
    fn receive_files(&mut self, args: &Args) -> anyhow::Result<bool> {
        let Some(files) = &self.files else { return Ok(false) };
        if let Some(why) = files.take_failure() {
            if self.stays_open {
                self.give_up(&one_line(why.as_ref()));
                return Ok(true);
            }
            return Err(why);
        }
        let Some(ready) = files.take_ready() else { return Ok(false) };
        tracing::debug!(now = ?self.now(), coarse = ready.is_coarse, "a scene is ready");
        let streaming = stream(args, &ready.address, &self.notify)?;
        if self.streaming.is_none() {
            self.streaming = Some(streaming);
            return Ok(true);
        }
        let mut scene = SceneView::with_terrain_apart(self.notify.call())?;
        scene.set_vertical_exaggeration(self.choices.heights[0], 0.0, 0.0)?;
        self.animation.forget();
        self.next = Some(NextScene { streaming, scene, status: Status::default(), whole: None });
        self.send_view();
        Ok(true)
    }

    /// Receives the next scene, and replaces the one that is drawn once it is ready; the camera stays.
    fn receive_next(&mut self) -> anyhow::Result<bool> {
        let now = self.now();
        let Some(next) = &mut self.next else { return Ok(false) };
        next.status = next.streaming.status();
        take_steps(&mut next.streaming, &mut next.scene);
        next.scene.upload(&self.painter.gpu, &self.painter.renderer, usize::MAX, now.as_secs_f32())?;
        if next.scene.is_whole() {
            next.whole.get_or_insert(now);
        }
        let Some(next) = self.next.take_if(|next| next.is_ready(now)) else { return Ok(false) };
        tracing::debug!(?now, "the next scene is shown");
        self.streaming = Some(next.streaming);
        self.scene = next.scene;
        // Asked of the scene before.
        self.wants_picture |= self.picture.take().is_some();
        self.animation.forget();
        self.status = SessionStatus::default();
        self.status.take(next.status);
        Ok(true)
    }

    /// Whether another scene will replace the one that is drawn.
    pub(super) fn awaits_scene(&self) -> bool {
        self.next.is_some() || self.files.as_ref().is_some_and(Preparation::is_pending)
    }

    /// Message over the picture, which `shows` the scene.
    pub(super) fn message(&self, shows: bool) -> Option<String> {
        let of_files = self.files.as_ref().and_then(Preparation::message);
        let of_session = self.status.message().map(Into::into);
        let loading = || (!shows && self.streaming.is_some()).then(|| self.loading());
        let of_session: Option<String> = of_session.or_else(loading);
        let of_picture = self.notice.as_ref().map(|(_, notice)| notice.clone());
        let of_drop = self.hovers.then(|| "drop to open".into());
        let lines: Vec<String> = [of_files, of_session, of_picture, of_drop].into_iter().flatten().collect();
        (!lines.is_empty()).then(|| lines.join("\n"))
    }

    /// Message shown until the first frame is complete.
    fn loading(&self) -> String {
        let stats = &self.status.status().stats;
        let (here, all) = (stats.counters.drawable_instances, stats.counters.visible_instances);
        if all == 0 {
            "waiting for the scene".into()
        } else {
            format!("loading: {here} of {all} objects in view")
        }
    }
}
