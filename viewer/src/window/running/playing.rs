//! Plays the clips of the window's scene, and tells the client where instances are.

use std::time::Duration;

use winit::keyboard::KeyCode;

use super::Running;
use super::animation::Animation;

/// Interval at which the client follows a clip that plays: picking and refinement need no more.
const FOLLOW_INTERVAL: Duration = Duration::from_millis(100);

impl Running {
    /// Moves the scene to where the clip has it at `now`, and tells the client from time to time.
    pub(super) fn play_animation(&mut self, now: Duration) {
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
        self.scene.animate(moment.clone());
        let (told, at) = &animation.told;
        let due = !animation.playback.is_playing() || now >= *at + FOLLOW_INTERVAL;
        if *told != moment && due {
            let next = self.next.as_ref().map(|next| &next.streaming);
            for streaming in self.streaming.iter().chain(next) {
                streaming.animate(moment.clone());
            }
            animation.told = (moment, now);
        }
    }

    /// Handles a key of the animation; returns whether it is one.
    pub(super) fn animation_key(&mut self, code: KeyCode) -> bool {
        let Animation { playback, clips, .. } = &mut self.animation;
        match code {
            _ if clips.is_empty() => return false,
            KeyCode::KeyK => playback.toggle(),
            KeyCode::Comma => playback.step(clips, -1),
            KeyCode::Period => playback.step(clips, 1),
            _ => return false,
        }
        self.painter.window.request_redraw();
        self.dirty = true;
        true
    }
}
