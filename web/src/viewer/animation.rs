//! Plays the clips of the scene. The script tells the worker what is shown: its client picks and refines moving instances.

use std::time::Duration;

use lodestream_render::RenderError;
use wasm_bindgen::prelude::*;

use super::Viewer;

impl Viewer {
    /// Moves the scene to where its clip has it; whether it plays.
    pub(super) fn play(&mut self, now: Duration) -> Result<bool, RenderError> {
        self.clips.follow(self.scene.animations());
        self.clips.playback.advance(now);
        self.scene.animate(&self.gpu, self.clips.playback.moment(&self.clips.all))?;
        let plays = self.clips.are_playing();
        if plays && self.presented_ms.is_some() {
            self.quality.moved(now);
        }
        Ok(plays)
    }
}

#[wasm_bindgen]
impl Viewer {
    /// Plays the scene's animation on, or pauses it.
    pub fn toggle_animation(&mut self) {
        self.clips.playback.toggle();
        self.scene_changed();
    }

    /// Shows another clip from its start, so many further in the list, which is a ring.
    pub fn step_clip(&mut self, by: i32) {
        self.clips.playback.step(&self.clips.all, by as isize);
        self.scene_changed();
    }

    /// Shows a clip at a time in seconds, and pauses there.
    pub fn scrub_animation(&mut self, clip: &str, time_s: f64) {
        self.clips.playback.choose(clip);
        self.clips.playback.scrub(time_s);
        self.scene_changed();
    }

    /// Whether the scene's animation plays.
    #[must_use]
    pub fn plays(&self) -> bool {
        self.clips.are_playing()
    }

    /// The clip that is shown; none if the scene has none.
    #[must_use]
    pub fn clip(&self) -> Option<String> {
        self.clips.shown().map(|clip| clip.name.clone())
    }

    /// The time within that clip, in seconds.
    #[must_use]
    pub fn clip_time(&self) -> Option<f64> {
        self.clips.shown().map(|clip| self.clips.playback.time_s(clip))
    }
}
