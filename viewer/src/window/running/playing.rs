//! Plays the clips of the window's scene, and tells the client where instances are.

use std::time::Duration;

use lodestream_render::RenderError;

use super::Running;
use super::animation::Animation;
use crate::window::keyboard::Action;

/// Interval at which the client follows a clip that plays: picking and refinement need no more.
const FOLLOW_INTERVAL: Duration = Duration::from_millis(100);

impl Running {
    /// Moves the scene to where the clip has it at `now`, and tells the client from time to time.
    ///
    /// # Errors
    /// As [`lodestream_render::SceneView::animate`].
    pub(super) fn play_animation(&mut self, now: Duration) -> Result<(), RenderError> {
        let animation = &mut self.animation;
        let models = self.scene.animations().models().count();
        if models != animation.models {
            (animation.models, animation.clips) = (models, self.scene.animations().clips());
        }
        animation.playback.advance(now);
        if animation.is_playing() && self.shown.has_begun() {
            self.quality.moved(now);
        }
        let moment = animation.playback.moment(&animation.clips);
        self.scene.animate(&self.painter.gpu, moment.clone())?;
        let (told, at) = &animation.told;
        let due = !animation.playback.is_playing() || now >= *at + FOLLOW_INTERVAL;
        if *told != moment && due {
            let next = self.next.as_ref().map(|next| &next.streaming);
            for streaming in self.streaming.iter().chain(next) {
                streaming.animate(moment.clone());
            }
            animation.told = (moment, now);
        }
        Ok(())
    }

    /// Does what a key of the animation is for, if the scene has one.
    pub(super) fn act_on_animation(&mut self, action: Action) {
        let Animation { playback, clips, .. } = &mut self.animation;
        match action {
            _ if clips.is_empty() => return,
            Action::Play => playback.toggle(),
            Action::PreviousClip => playback.step(clips, -1),
            _ => playback.step(clips, 1),
        }
        self.painter.window.request_redraw();
        self.scene_changed();
    }
}
