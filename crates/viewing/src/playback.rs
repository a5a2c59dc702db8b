//! Playback of a scene's clips, by real time and independent of the frame rate.

use std::time::Duration;

use lodestream_scene::animation::{ClipInfo, Moment};

/// Which clip is shown at what time, and whether it plays.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Playback {
    /// Name of the clip; of one that the scene does not have, its first is shown.
    clip: Option<String>,
    time_s: f64,
    plays: bool,
    /// Time up to which it has been advanced.
    advanced_until: Option<Duration>,
}

impl Playback {
    /// Shows a clip, the scene's first if `None`, from a time in seconds on.
    #[must_use]
    pub const fn new(clip: Option<String>, time_s: f64, plays: bool) -> Self {
        Self { clip, time_s, plays, advanced_until: None }
    }

    /// Whether it plays.
    #[must_use]
    pub const fn is_playing(&self) -> bool {
        self.plays
    }

    /// Plays on, or pauses.
    pub const fn toggle(&mut self) {
        self.plays = !self.plays;
    }

    /// The clip among those of the scene that is shown; `None` without clips.
    #[must_use]
    pub fn clip<'a>(&self, clips: &'a [ClipInfo]) -> Option<(usize, &'a ClipInfo)> {
        let named = self.clip.as_ref().and_then(|name| clips.iter().position(|clip| clip.name == *name));
        let at = named.unwrap_or(0);
        Some((at, clips.get(at)?))
    }

    /// Shows another clip from its start: so many further in the list, which is a ring.
    pub fn step(&mut self, clips: &[ClipInfo], by: isize) {
        let Some((at, _)) = self.clip(clips) else { return };
        let count = clips.len().cast_signed();
        let next = (at.cast_signed() + by).rem_euclid(count).unsigned_abs();
        self.choose(&clips[next].name);
    }

    /// Shows a clip from its start.
    pub fn choose(&mut self, clip: &str) {
        (self.clip, self.time_s) = (Some(clip.to_owned()), 0.0);
    }

    /// The time within the shown clip, in seconds.
    #[must_use]
    pub fn time_s(&self, clip: &ClipInfo) -> f64 {
        let within = (0.0..=clip.duration_s).contains(&self.time_s) || clip.duration_s <= 0.0;
        if within { self.time_s } else { self.time_s.rem_euclid(clip.duration_s) }
    }

    /// Shows another time, and pauses there.
    pub const fn scrub(&mut self, time_s: f64) {
        (self.time_s, self.plays) = (time_s, false);
    }

    /// Plays for the time since the last call. A clock that goes back plays nothing.
    pub fn advance(&mut self, now: Duration) {
        let since = self.advanced_until.map_or(Duration::ZERO, |until| now.saturating_sub(until));
        self.advanced_until = Some(self.advanced_until.map_or(now, |until| until.max(now)));
        if self.plays {
            self.time_s += since.as_secs_f64();
        }
    }

    /// What is shown; `None` without clips.
    #[must_use]
    pub fn moment(&self, clips: &[ClipInfo]) -> Option<Moment> {
        self.clip(clips).map(|(_, clip)| Moment { clip: clip.name.clone(), time_s: self.time_s })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn clips() -> Vec<ClipInfo> {
        [("walk", 2.0), ("jump", 0.5), ("stand", 0.0)]
            .map(|(name, duration_s)| ClipInfo { name: name.into(), duration_s })
            .to_vec()
    }

    #[test]
    fn time_passes_only_while_it_plays_and_repeats() {
        let (clips, mut playback) = (clips(), Playback::new(None, 0.5, true));
        let at = |playback: &Playback| {
            playback.clip(&clips).map(|(_, clip)| (clip.name.clone(), playback.time_s(clip)))
        };
        let second = Duration::from_secs;
        assert_eq!(at(&playback), Some(("walk".into(), 0.5)));
        // The first call only begins.
        playback.advance(second(10));
        playback.advance(second(11));
        assert_eq!(at(&playback), Some(("walk".into(), 1.5)));
        playback.advance(second(12));
        assert_eq!(at(&playback), Some(("walk".into(), 0.5)));
        playback.toggle();
        playback.advance(second(15));
        playback.toggle();
        playback.advance(second(14));
        playback.advance(Duration::from_millis(15_250));
        assert_eq!(at(&playback), Some(("walk".into(), 0.75)));
        playback.scrub(2.0);
        assert_eq!((at(&playback), playback.is_playing()), (Some(("walk".into(), 2.0)), false));
        assert_eq!(playback.moment(&clips), Some(Moment { clip: "walk".into(), time_s: 2.0 }));
        assert_eq!(playback.moment(&[]), None);
    }

    #[test]
    fn clips_are_a_ring_and_begin_at_their_start() {
        let (clips, mut playback) = (clips(), Playback::new(Some("jump".into()), 0.3, false));
        let name = |playback: &Playback| playback.clip(&clips).unwrap().1.name.clone();
        for (by, expected) in [(1, "stand"), (1, "walk"), (-1, "stand"), (-1, "jump")] {
            playback.step(&clips, by);
            assert_eq!(name(&playback), expected);
        }
        assert_eq!(playback.moment(&clips).unwrap().time_s, 0.0);
        playback.step(&[], 1);
        playback.choose("swim");
        assert_eq!(name(&playback), "walk", "the first stands for one that the scene does not have");
    }
}
