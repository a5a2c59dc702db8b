//! A run over time: bytes and screen error as a series of bounded length, and stalls.

use lodestream_protocol::Time;
use serde::Serialize;
use serde::ser::SerializeTuple;

/// Most samples of a series.
pub const MAX_SAMPLES: usize = 120;
/// Finest resolution.
const FIRST_INTERVAL_NS: u64 = 1_000_000;
/// Length from which a pause counts as a stall.
pub const STALL_NS: u64 = 500_000_000;

/// Milliseconds of virtual time, exact to the microsecond.
#[must_use]
pub fn milliseconds(ns: u64) -> f64 {
    (ns as f64 / 1e3).round() / 1e3
}

/// One moment of a series; in JSON `[ms, bytes, px, px of visible parts]`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// Time since the connect call.
    pub at_ns: u64,
    /// Transport payload received so far.
    pub bytes: u64,
    /// Upper bound on the screen error over all parts in view, from the last selection; `None` while a visible instance
    /// cannot be drawn.
    pub error_px: Option<f64>,
    /// The same without parts that the scene's own surfaces occlude; `None` for baselines, which do not know them.
    pub unoccluded_error_px: Option<f64>,
}

impl Sample {
    /// The sample without its time.
    fn news(&self) -> (u64, Option<f64>, Option<f64>) {
        (self.bytes, self.error_px, self.unoccluded_error_px)
    }
}

impl Serialize for Sample {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut tuple = serializer.serialize_tuple(4)?;
        tuple.serialize_element(&milliseconds(self.at_ns))?;
        tuple.serialize_element(&self.bytes)?;
        for px in [self.error_px, self.unoccluded_error_px] {
            tuple.serialize_element(&px.map(|px| (px * 1e4).round() / 1e4))?;
        }
        tuple.end()
    }
}

/// At most [`MAX_SAMPLES`] samples: the last change within each interval, whose length doubles as the run grows longer.
/// The series covers a run of any length evenly, and every sample was observed.
#[derive(Clone, Debug)]
pub(crate) struct Series {
    interval_ns: u64,
    samples: Vec<Sample>,
}

impl Default for Series {
    fn default() -> Self {
        Self { interval_ns: FIRST_INTERVAL_NS, samples: Vec::new() }
    }
}

impl Series {
    /// Adds a sample if it differs from the last.
    pub(crate) fn push(&mut self, sample: Sample) {
        if let Some(last) = self.samples.last_mut() {
            if last.news() == sample.news() {
                return;
            }
            if last.at_ns / self.interval_ns == sample.at_ns / self.interval_ns {
                *last = sample;
                return;
            }
        }
        self.samples.push(sample);
        while self.samples.len() > MAX_SAMPLES {
            self.interval_ns *= 2;
            let interval_ns = self.interval_ns;
            // The last sample of each doubled interval stays.
            self.samples.reverse();
            self.samples.dedup_by_key(|sample| sample.at_ns / interval_ns);
            self.samples.reverse();
        }
    }

    pub(crate) fn samples(&self) -> &[Sample] {
        &self.samples
    }
}

/// Detects pauses in which blobs were requested and no byte arrived.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Stalls {
    /// Start of the present wait: since then blobs are requested and nothing has arrived.
    waiting_since: Option<Time>,
    bytes: u64,
    count: u32,
    total_ns: u64,
}

impl Stalls {
    /// Records the bytes received so far and whether blobs are requested. To be called whenever either may have
    /// changed, from the first frame on.
    pub(crate) fn observe(&mut self, now: Time, bytes: u64, wants: bool) {
        let came = bytes > self.bytes;
        self.bytes = bytes;
        if came || !wants {
            self.end(now);
        }
        if wants {
            self.waiting_since.get_or_insert(now);
        }
    }

    /// Ends a pause at `now`.
    pub(crate) fn end(&mut self, now: Time) {
        if let Some(since) = self.waiting_since.take() {
            let pause_ns = now.as_ns().saturating_sub(since.as_ns());
            if pause_ns >= STALL_NS {
                self.count += 1;
                self.total_ns += pause_ns;
            }
        }
    }

    /// Number of stalls and their total length.
    pub(crate) fn totals(&self) -> (u32, u64) {
        (self.count, self.total_ns)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample(at_ns: u64, bytes: u64) -> Sample {
        Sample { at_ns, bytes, error_px: None, unoccluded_error_px: None }
    }

    #[test]
    fn a_series_is_bounded_and_covers_the_run() {
        for steps in [50, 1000, 100_000_u64] {
            let mut series = Series::default();
            for i in 0..steps {
                series.push(sample(i * 3_700_000, i + 1));
            }
            let samples = series.samples();
            assert!(samples.len() <= MAX_SAMPLES && samples.len() >= MAX_SAMPLES.min(steps as usize) / 2 - 1);
            assert_eq!(samples.last(), Some(&sample((steps - 1) * 3_700_000, steps)));
            assert!(samples.is_sorted_by(|a, b| a.at_ns < b.at_ns && a.bytes < b.bytes));
            // Every sample was pushed, and gaps are at most two intervals and a step.
            assert!(samples.iter().all(|s| s.at_ns == (s.bytes - 1) * 3_700_000));
            let widest = samples.windows(2).map(|pair| pair[1].at_ns - pair[0].at_ns).max().unwrap();
            assert!(widest <= 2 * series.interval_ns + 3_700_000, "{widest}");
        }
    }

    #[test]
    fn unchanged_samples_are_not_stored() {
        let mut series = Series::default();
        for (at_ns, bytes) in [(0, 1), (5_000_000, 1), (9_000_000, 2), (9_400_000, 3)] {
            series.push(sample(at_ns, bytes));
        }
        // The last two share a millisecond.
        assert_eq!(series.samples(), [sample(0, 1), sample(9_400_000, 3)]);
        let seen =
            Sample { error_px: Some(1.234_567), unoccluded_error_px: Some(0.5), ..sample(1_500_000, 7) };
        assert_eq!(serde_json::to_string(&seen).unwrap(), "[1.5,7,1.2346,0.5]");
        assert_eq!(serde_json::to_string(&sample(0, 7)).unwrap(), "[0.0,7,null,null]");
    }

    /// Parts may come into view or become occluded without a byte.
    #[test]
    fn a_change_of_the_visible_error_alone_is_stored() {
        let at = |at_ns, seen_px| Sample {
            error_px: Some(9.0),
            unoccluded_error_px: Some(seen_px),
            ..sample(at_ns, 1)
        };
        let mut series = Series::default();
        for (at_ns, seen_px) in [(0, 9.0), (5_000_000, 9.0), (8_000_000, 2.0)] {
            series.push(at(at_ns, seen_px));
        }
        assert_eq!(series.samples(), [at(0, 9.0), at(8_000_000, 2.0)]);
    }

    #[test]
    fn a_stall_is_half_a_second_of_waiting_without_a_byte() {
        let mut stalls = Stalls::default();
        let looks = [
            (0, 10, true),
            (499, 11, true),   // almost
            (999, 12, true),   // 500 ms: one
            (2000, 12, true),  // still waiting
            (3000, 13, true),  // 2001 ms: two
            (3100, 13, false), // wants nothing more
            (9000, 13, true),  // wants again, and waits until the end
        ];
        for (ms, bytes, wants) in looks {
            stalls.observe(Time::from_ms(ms), bytes, wants);
        }
        assert_eq!(stalls.totals(), (2, 2_501_000_000));
        stalls.end(Time::from_ms(9_700));
        assert_eq!(stalls.totals(), (3, 3_201_000_000));
    }
}
