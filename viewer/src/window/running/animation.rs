//! What is known of the animation of the window's scene.

use std::time::Duration;

use lodestream_scene::animation::{ClipInfo, Moment};
use lodestream_viewing::Playback;

/// The playback, and what is known of the scene's clips.
#[derive(Debug, Default)]
pub(super) struct Animation {
    pub(super) playback: Playback,
    pub(super) clips: Vec<ClipInfo>,
    /// Number of animated models from which the clips were listed.
    pub(super) models: usize,
    /// What the client was told last, and when.
    pub(super) told: (Option<Moment>, Duration),
}

impl Animation {
    pub(super) fn new(playback: Playback) -> Self {
        Self { playback, ..Self::default() }
    }

    /// Lists clips and tells the client anew: there is another scene, which may have none.
    pub(super) fn forget(&mut self) {
        *self = Self::new(self.playback.clone());
    }

    /// Whether it moves anything.
    pub(super) fn is_playing(&self) -> bool {
        self.playback.is_playing() && !self.clips.is_empty()
    }
}
