//! The clips of the page's scene, and which is shown.

use lodestream_scene::animation::{Animations, ClipInfo};
use lodestream_viewing::Playback;

/// The playback, and what is known of the scene's clips.
#[derive(Debug)]
pub(crate) struct Clips {
    pub(crate) playback: Playback,
    pub(crate) all: Vec<ClipInfo>,
    /// Number of animated models from which they were listed.
    models: usize,
}

impl Clips {
    pub(crate) const fn new() -> Self {
        Self { playback: Playback::new(None, 0.0, true), all: Vec::new(), models: 0 }
    }

    /// Lists the clips anew if more models have arrived, or another scene has begun.
    pub(crate) fn follow(&mut self, animations: &Animations) {
        let models = animations.models().count();
        if models != self.models {
            (self.models, self.all) = (models, animations.clips());
        }
    }

    /// Whether a clip plays.
    pub(crate) fn are_playing(&self) -> bool {
        self.playback.is_playing() && !self.all.is_empty()
    }

    /// The clip that is shown; `None` without clips.
    pub(crate) fn shown(&self) -> Option<&ClipInfo> {
        self.playback.clip(&self.all).map(|(_, clip)| clip)
    }
}
