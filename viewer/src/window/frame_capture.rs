//! Pictures of the frames that were shown, for `--frames`.

use std::path::Path;
use std::time::Duration;

use anyhow::Context as _;
use lodestream_render::{Gpu, TargetCopy};
use serde::Serialize;

use crate::files::{cannot_write, write_json, write_png};
use crate::frames::Received;

/// Frames are kept for so long after the connect call, at this distance at least: 3 s at 30 frames a second.
const KEPT_FOR: Duration = Duration::from_secs(3);
const LEAST_DISTANCE: Duration = Duration::from_millis(33);
/// Memory of kept frames: all of them at 1280×720.
const MAX_BYTES: u64 = 512 << 20;

/// A kept frame.
#[derive(Debug)]
struct CapturedFrame {
    at: Duration,
    whole: bool,
    received: Received,
    copy: TargetCopy,
}

/// Which frames are kept for good.
#[derive(Debug, Default)]
struct Choice {
    /// When the newest of them was shown.
    newest: Option<Duration>,
    /// Memory of all.
    bytes: u64,
    /// One of them holds everything of the first frame.
    has_whole: bool,
}

impl Choice {
    /// Whether a frame that takes so many bytes is kept: one of the first seconds', while there is room. The first that
    /// holds everything is what "presented" means, and is always kept, however late and near another it was.
    fn keeps(&mut self, at: Duration, whole: bool, bytes: u64) -> bool {
        let apart = self.newest.is_none_or(|newest| at >= newest + LEAST_DISTANCE);
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

/// The frames kept so far. They stay in the device's memory until the end, so that keeping them costs a copy.
#[derive(Debug, Default)]
pub(super) struct FrameCapture {
    first: Vec<CapturedFrame>,
    choice: Choice,
    /// The last frame of all.
    last: Option<CapturedFrame>,
}

/// What `frames.json` says of a frame.
#[derive(Debug, Serialize)]
struct Entry {
    at_ms: f64,
    whole: bool,
    #[serde(flatten)]
    received: Received,
    file: String,
}

/// `frames.json`.
#[derive(Debug, Serialize)]
struct Index {
    /// Until when frames were kept, in milliseconds after the connect call.
    until_ms: f64,
    /// Whether the last frame will not change by itself: it is settled, or as good as it will be.
    settled: bool,
    /// The frames, the last of which is the run's last.
    frames: Vec<Entry>,
}

impl FrameCapture {
    /// Keeps a frame, for good or until the next is there.
    pub(super) fn add(&mut self, at: Duration, whole: bool, received: Received, copy: TargetCopy) {
        if let Some(last) = self.last.replace(CapturedFrame { at, whole, received, copy })
            && self.choice.keeps(last.at, last.whole, last.copy.bytes())
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
        let mut choice = Choice::default();
        let kept: Vec<u64> =
            (0..400).map(|n| 10 * n).filter(|at| choice.keeps(ms(*at), true, PICTURE)).collect();
        assert_eq!((kept.len(), &kept[..3]), (76, &[0, 40, 80][..]));
        assert!(kept.last().is_some_and(|at| *at <= 3000));
        let mut large = Choice::default();
        let kept = (0..90).filter(|n| large.keeps(ms(33 * n), true, MAX_BYTES / 10)).count();
        assert_eq!(kept, 10);
    }

    /// On a slow device the first frame that held everything came after three seconds, or soon after one that did not,
    /// and was not among the pictures.
    #[test]
    fn the_first_whole_frame_is_kept_however_late_it_comes() {
        for (early, whole) in [(2000, 2010), (2000, 5000)] {
            let mut choice = Choice::default();
            assert!(choice.keeps(ms(early), false, PICTURE));
            assert!(choice.keeps(ms(whole), true, PICTURE), "the first whole one, at {whole} ms");
            assert!(!choice.keeps(ms(whole + 10), true, PICTURE));
        }
        let mut full = Choice::default();
        assert!(full.keeps(ms(100), false, MAX_BYTES) && !full.keeps(ms(200), false, PICTURE));
        assert!(full.keeps(ms(300), true, PICTURE), "where there is no room");
    }
}
