//! Captures the frames shown, for `--frames`.

use std::path::Path;
use std::time::Duration;

use anyhow::Context as _;
use lodestream_render::{Gpu, TargetCopy};
use serde::Serialize;

use crate::files::{cannot_write, write_json, write_png};
use crate::frames::Received;

/// Time after the connect call until which frames are kept.
const KEPT_FOR: Duration = Duration::from_secs(3);
/// Least time between two kept frames: 30 frames a second.
const MIN_INTERVAL: Duration = Duration::from_millis(33);
/// Most memory of kept frames: enough for all at 1280×720.
const MAX_BYTES: u64 = 512 << 20;

/// A captured frame.
#[derive(Debug)]
struct CapturedFrame {
    at: Duration,
    whole: bool,
    received: Received,
    copy: TargetCopy,
}

/// Decides which frames are kept until the end.
#[derive(Debug, Default)]
struct RetentionPolicy {
    /// When the newest kept frame was shown.
    newest: Option<Duration>,
    /// Memory of all kept frames.
    bytes: u64,
    /// Whether a complete first frame is among them.
    has_whole: bool,
}

impl RetentionPolicy {
    /// Whether a frame of so many bytes is kept: those of the first seconds, while there is memory, and always the
    /// first complete one, which defines "presented".
    fn keeps(&mut self, at: Duration, whole: bool, bytes: u64) -> bool {
        let apart = self.newest.is_none_or(|newest| at >= newest + MIN_INTERVAL);
        let kept = at <= KEPT_FOR && apart && self.bytes + bytes <= MAX_BYTES;
        let presented = whole && !self.has_whole;
        if kept || presented {
            self.newest = Some(at);
            self.bytes += bytes;
            self.has_whole |= whole;
        }
        kept || presented
    }
}

/// The captured frames. They stay in the device's memory until the end, so that capturing costs only a copy.
#[derive(Debug, Default)]
pub(super) struct FrameCapture {
    first: Vec<CapturedFrame>,
    retention: RetentionPolicy,
    /// The newest frame.
    last: Option<CapturedFrame>,
}

/// A frame's entry in `frames.json`.
#[derive(Debug, Serialize)]
struct Entry {
    at_ms: f64,
    whole: bool,
    #[serde(flatten)]
    received: Received,
    file: String,
}

/// Contents of `frames.json`.
#[derive(Debug, Serialize)]
struct Index {
    /// Time until which frames were kept, in milliseconds after the connect call.
    until_ms: f64,
    /// Whether the last frame is final: settled or incomplete.
    settled: bool,
    /// The frames, the last of which is the run's last.
    frames: Vec<Entry>,
}

impl FrameCapture {
    /// Adds a frame. The previous one is kept only if the policy says so.
    pub(super) fn add(&mut self, at: Duration, whole: bool, received: Received, copy: TargetCopy) {
        if let Some(last) = self.last.replace(CapturedFrame { at, whole, received, copy })
            && self.retention.keeps(last.at, last.whole, last.copy.bytes())
        {
            self.first.push(last);
        }
    }

    /// Writes all pictures and `frames.json` into a folder, which is created where it is missing.
    pub(super) fn write(self, gpu: &Gpu, folder: &Path, settled: bool) -> anyhow::Result<()> {
        std::fs::create_dir_all(folder).with_context(|| cannot_write(folder))?;
        let mut frames = Vec::new();
        for (number, kept) in (1..).zip(self.first.into_iter().chain(self.last)) {
            let CapturedFrame { at, whole, received, copy } = kept;
            let file = format!("frame-{number:04}.png");
            write_png(&folder.join(&file), &copy.picture(gpu)?)?;
            frames.push(Entry { at_ms: at.as_secs_f64() * 1e3, whole, received, file });
        }
        let index = Index { until_ms: KEPT_FOR.as_secs_f64() * 1e3, settled, frames };
        write_json(&folder.join("frames.json"), &index)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PICTURE: u64 = 1280 * 720 * 4;

    fn ms(ms: u64) -> Duration {
        Duration::from_millis(ms)
    }

    #[test]
    fn frames_of_the_first_seconds_are_kept_at_a_distance_and_while_there_is_room() {
        let mut choice = RetentionPolicy::default();
        let kept: Vec<u64> =
            (0..400).map(|n| 10 * n).filter(|at| choice.keeps(ms(*at), true, PICTURE)).collect();
        assert_eq!((kept.len(), &kept[..3]), (76, &[0, 40, 80][..]));
        assert!(kept.last().is_some_and(|at| *at <= 3000));
        let mut large = RetentionPolicy::default();
        let kept = (0..90).filter(|n| large.keeps(ms(33 * n), true, MAX_BYTES / 10)).count();
        assert_eq!(kept, 10);
    }

    /// On a slow device the first complete frame can come after the first three seconds, or soon after an incomplete
    /// one.
    /// It must be among the pictures.
    #[test]
    fn the_first_whole_frame_is_kept_however_late_it_comes() {
        for (early, whole) in [(2000, 2010), (2000, 5000)] {
            let mut choice = RetentionPolicy::default();
            assert!(choice.keeps(ms(early), false, PICTURE));
            assert!(choice.keeps(ms(whole), true, PICTURE), "the first whole one, at {whole} ms");
            assert!(!choice.keeps(ms(whole + 10), true, PICTURE));
        }
        let mut full = RetentionPolicy::default();
        assert!(full.keeps(ms(100), false, MAX_BYTES) && !full.keeps(ms(200), false, PICTURE));
        assert!(full.keeps(ms(300), true, PICTURE), "where there is no room");
    }
}
