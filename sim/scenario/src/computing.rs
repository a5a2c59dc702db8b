//! What a client's decoding and applying take, in virtual time.

use std::time::Duration;

use lodestream_client::core::{ClientCore, Progress};
use lodestream_protocol::Time;

/// Payload that is decoded before time is taken for it: about a blob. So much counts as there up to its own time too early.
const SLICE_BYTES: u64 = 1024;
/// Faces that a vertex split brings.
const FACES_PER_SPLIT: f64 = 2.0;

/// A core that computes for a while, and then for another.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Computing {
    /// `None`: it takes no time.
    splits_per_s: Option<f64>,
    busy_until: Time,
}

impl Computing {
    /// Idle, of so many splits a second.
    pub(crate) const fn new(splits_per_s: Option<f64>) -> Self {
        Self { splits_per_s, busy_until: Time::ZERO }
    }

    /// Lets the core do what it can by now.
    pub(crate) fn turn(&mut self, core: &mut ClientCore, now: Time) -> Progress {
        let Some(splits_per_s) = self.splits_per_s else { return core.update(now, u64::MAX) };
        // What takes no time is done at once.
        while self.busy_until <= now {
            let before = core.decoded_faces();
            let progress = core.update(now, SLICE_BYTES);
            let splits = (core.decoded_faces() - before) as f64 / FACES_PER_SPLIT;
            self.busy_until = now + Duration::from_secs_f64(splits / splits_per_s);
            if progress == Progress::Idle {
                break;
            }
        }
        if self.busy_until > now {
            // What decodes does not keep another thread from choosing what is decoded next.
            core.update(now, 0);
        }
        // It is woken when it may go on.
        Progress::Idle
    }

    /// When it may go on, if that is later than now.
    pub(crate) fn next(&self, now: Time) -> Option<Time> {
        Some(self.busy_until).filter(|until| *until > now)
    }
}
