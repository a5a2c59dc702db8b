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
struct Kept {
    at: Duration,
    whole: bool,
    received: Received,
    copy: TargetCopy,
}

/// The frames kept so far. They stay in the device's memory until the end, so that keeping them costs a copy.
#[derive(Debug, Default)]
pub(super) struct Film {
    first: Vec<Kept>,
    /// Memory of these.
    bytes: u64,
    /// The last frame of all.
    last: Option<Kept>,
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

impl Film {
    /// Keeps a frame: one of the first seconds' for good, while there is room, another until the next is there.
    pub(super) fn add(&mut self, at: Duration, whole: bool, received: Received, copy: TargetCopy) {
        if let Some(last) = self.last.replace(Kept { at, whole, received, copy })
            && last.at <= KEPT_FOR
            && self.first.last().is_none_or(|before| last.at >= before.at + LEAST_DISTANCE)
            && self.bytes + last.copy.bytes() <= MAX_BYTES
        {
            self.bytes += last.copy.bytes();
            self.first.push(last);
        }
    }

    /// Writes all pictures and `frames.json` into a folder, which is created where it is missing.
    pub(super) fn write(self, gpu: &Gpu, folder: &Path, settled: bool) -> anyhow::Result<()> {
        std::fs::create_dir_all(folder).with_context(|| cannot_write(folder))?;
        let mut frames = Vec::new();
        for (number, kept) in (1..).zip(self.first.into_iter().chain(self.last)) {
            let Kept { at, whole, received, copy } = kept;
            let file = format!("frame-{number:04}.png");
            write_png(&folder.join(&file), &copy.picture(gpu)?)?;
            frames.push(Entry { at_ms: at.as_secs_f64() * 1e3, whole, received, file });
        }
        let index = Index { until_ms: KEPT_FOR.as_secs_f64() * 1e3, settled, frames };
        write_json(&folder.join("frames.json"), &index)
    }
}
