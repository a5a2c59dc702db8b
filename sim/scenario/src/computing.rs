//! Virtual time that a client's decoding and applying take.

use std::time::Duration;

use lodestream_client::core::{ClientCore, Progress};
use lodestream_protocol::Time;

/// Payload decoded between two charges of time, about a blob. Its result is visible too early by the time of one slice.
const SLICE_BYTES: u64 = 1024;
/// Faces that a vertex split adds.
const FACES_PER_SPLIT: f64 = 2.0;

/// A model of a core that decodes at a limited rate.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Computing {
    /// Vertex splits per second; `None`: decoding takes no time.
    splits_per_s: Option<f64>,
    busy_until: Time,
}

impl Computing {
    /// An idle core of `splits_per_s`.
    pub(crate) const fn new(splits_per_s: Option<f64>) -> Self {
        Self { splits_per_s, busy_until: Time::ZERO }
    }

    /// Lets the core do what it can until now.
    pub(crate) fn turn(&mut self, core: &mut ClientCore, now: Time) -> Progress {
        let Some(splits_per_s) = self.splits_per_s else { return core.update(now, u64::MAX) };
        // Without a rate, everything is done at once.
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
            // Decoding does not block the thread that selects what is decoded next.
            core.update(now, 0);
        }
        // It is woken when it may go on.
        Progress::Idle
    }

    /// When it can continue, if that is later than now.
    pub(crate) fn next(&self, now: Time) -> Option<Time> {
        Some(self.busy_until).filter(|until| *until > now)
    }
}
