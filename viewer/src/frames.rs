//! Record of the frames shown, and when the first may be shown.

use std::time::Duration;

use lodestream_client::core::Stats;
use lodestream_render::{Counters, Timings};
use serde::Serialize;

/// Longest time that the window stays empty: on slow links an incomplete scene is shown after it.
const MAX_HOLD_BACK: Duration = Duration::from_secs(2);
/// Time after the connect call until which frames are recorded.
const RECORDED_FOR: Duration = Duration::from_secs(10);
/// Most frames recorded.
const MAX_RECORDED: usize = 1000;

/// Bytes and screen error when a frame was drawn, with the simulator's field names.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub(crate) struct Received {
    /// Transport payload, handshakes included.
    pub(crate) bytes: u64,
    /// Bound on the screen error over all visible parts, in pixels; `None` while one of them cannot be drawn.
    pub(crate) error_px: Option<f64>,
    /// As `error_px`, without the parts that the scene's own surfaces hide.
    pub(crate) unoccluded_error_px: Option<f64>,
}

impl From<&Stats> for Received {
    fn from(stats: &Stats) -> Self {
        let counters = &stats.counters;
        let complete = stats.milestones.first_frame.is_some()
            && counters.drawable_instances >= counters.visible_instances;
        let of = |px: f64| Some(px).filter(|px| complete && px.is_finite());
        Self {
            bytes: stats.transport_bytes,
            error_px: of(counters.max_screen_error_px),
            unoccluded_error_px: of(counters.unoccluded_screen_error_px),
        }
    }
}

/// A frame shown.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub(crate) struct ShownFrame {
    /// When it was handed to the screen (headless: drawn), in milliseconds after the connect call.
    pub(crate) at_ms: f64,
    /// Whether the first frame was complete.
    pub(crate) whole: bool,
    /// Instances drawn; with a resting camera they never become fewer.
    pub(crate) instances: u32,
    /// Triangles drawn.
    pub(crate) triangles: u64,
    /// Bytes and screen error at that time.
    #[serde(flatten)]
    pub(crate) received: Received,
}

/// Record of the frames shown.
#[derive(Clone, Debug, Default)]
pub(crate) struct FrameLog {
    has_begun: bool,
    presented: Option<Duration>,
    settled: Option<Duration>,
    frames: Vec<ShownFrame>,
    times: Timings,
}

impl FrameLog {
    /// Whether the scene may be shown: the first frame has everything that will arrive (`is_complete`), or
    /// [`MAX_HOLD_BACK`] is over.
    pub(crate) fn may_show(&mut self, is_complete: bool, now: Duration) -> bool {
        self.has_begun |= is_complete || now >= MAX_HOLD_BACK;
        self.has_begun
    }

    /// Whether the scene has been shown, complete or not.
    pub(crate) const fn has_begun(&self) -> bool {
        self.has_begun
    }

    /// Records a frame that shows the scene.
    pub(crate) fn note(&mut self, now: Duration, whole: bool, drawn: &Counters, received: Received) {
        if whole {
            self.presented.get_or_insert(now);
        }
        if now <= RECORDED_FOR && self.frames.len() < MAX_RECORDED {
            let &Counters { instances, triangles, .. } = drawn;
            let at_ms = now.as_secs_f64() * 1e3;
            self.frames.push(ShownFrame { at_ms, whole, instances, triangles, received });
        }
    }

    /// Records the times of the last frames' passes.
    pub(crate) fn note_times(&mut self, times: Timings) {
        self.times = times;
    }

    /// Times of the last frames' passes.
    pub(crate) const fn times(&self) -> &Timings {
        &self.times
    }

    /// Records that the last frame is final.
    pub(crate) fn note_settled(&mut self, now: Duration) {
        self.settled.get_or_insert(now);
    }

    /// When the first complete frame was shown.
    pub(crate) const fn presented(&self) -> Option<Duration> {
        self.presented
    }

    /// When the settled picture was first shown.
    pub(crate) const fn settled(&self) -> Option<Duration> {
        self.settled
    }

    /// The frames of the first seconds.
    pub(crate) fn frames(&self) -> &[ShownFrame] {
        &self.frames
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use lodestream_client::core::Milestone;

    #[test]
    fn nothing_is_shown_before_the_first_frame_is_complete() {
        let mut shown = FrameLog::default();
        let ms = Duration::from_millis;
        assert!(!shown.may_show(false, ms(100)) && !shown.may_show(false, ms(1999)));
        assert!(shown.may_show(true, ms(300)));
        assert!(shown.may_show(false, ms(400)), "a scene that begins anew is shown as it comes");
        shown.note(ms(450), true, &Counters::default(), Received::default());
        shown.note(ms(500), true, &Counters::default(), Received::default());
        assert_eq!((shown.presented(), shown.frames().len()), (Some(ms(450)), 2));
    }

    #[test]
    fn an_incomplete_first_frame_is_shown_if_the_rest_fails_and_does_not_count_as_presented() {
        let mut shown = FrameLog::default();
        assert!(shown.may_show(true, Duration::from_millis(300)) && shown.has_begun());
        shown.note(Duration::from_millis(350), false, &Counters::default(), Received::default());
        assert_eq!((shown.presented(), shown.frames()[0].whole), (None, false));
    }

    #[test]
    fn an_incomplete_first_frame_is_shown_on_a_slow_link_and_does_not_count_as_presented() {
        let mut shown = FrameLog::default();
        assert!(shown.may_show(false, MAX_HOLD_BACK));
        shown.note(MAX_HOLD_BACK, false, &Counters::default(), Received::default());
        assert_eq!(shown.presented(), None);
        shown.note(2 * MAX_HOLD_BACK, true, &Counters::default(), Received::default());
        assert_eq!(shown.presented(), Some(2 * MAX_HOLD_BACK));
    }

    #[test]
    fn errors_are_recorded_once_everything_in_view_can_be_drawn() {
        let mut stats = Stats { transport_bytes: 700, ..Stats::default() };
        let counters = &mut stats.counters;
        (counters.visible_instances, counters.drawable_instances) = (2, 1);
        (counters.max_screen_error_px, counters.unoccluded_screen_error_px) = (f64::INFINITY, f64::INFINITY);
        assert_eq!(Received::from(&stats), Received { bytes: 700, ..Received::default() });
        let counters = &mut stats.counters;
        counters.drawable_instances = 2;
        (counters.max_screen_error_px, counters.unoccluded_screen_error_px) = (9.0, 3.0);
        // Not yet: others may be in view of which nothing is known.
        assert_eq!(Received::from(&stats).error_px, None);
        stats.milestones.first_frame = Some(Milestone { after: MAX_HOLD_BACK, bytes: 600 });
        let all = Received { bytes: 700, error_px: Some(9.0), unoccluded_error_px: Some(3.0) };
        assert_eq!(Received::from(&stats), all);
    }
}
