//! The frames that were shown, and whether the first of them may be.

use std::time::Duration;

use lodestream_client::core::Stats;
use lodestream_render::{Counters, Timings};
use serde::Serialize;

/// On links so slow that the first frame takes longer, what is here of it is shown meanwhile.
const HOLD_BACK: Duration = Duration::from_secs(2);
/// Frames are kept for so long after the connect call, and so many.
const KEPT_FOR: Duration = Duration::from_secs(10);
const MAX_KEPT: usize = 1000;

/// What had come when a frame was drawn, under the simulator's names.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub(crate) struct Received {
    /// Transport payload, handshakes included.
    pub(crate) bytes: u64,
    /// Bound on the screen error over all visible parts, in pixels; `None` while one of them cannot be drawn.
    pub(crate) error_px: Option<f64>,
    /// The same over what is seen, without what the scene's own surfaces hide.
    pub(crate) seen_error_px: Option<f64>,
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
            seen_error_px: of(counters.seen_screen_error_px),
        }
    }
}

/// A frame that was shown.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub(crate) struct ShownFrame {
    /// When it was handed to the screen (headless: drawn), in milliseconds after the connect call.
    pub(crate) at_ms: f64,
    /// Whether it held everything of the first frame.
    pub(crate) whole: bool,
    /// Instances drawn: with a camera that rests they never become fewer.
    pub(crate) instances: u32,
    /// Triangles drawn.
    pub(crate) triangles: u64,
    /// What had come by then.
    #[serde(flatten)]
    pub(crate) received: Received,
}

/// What was shown when.
#[derive(Clone, Debug, Default)]
pub(crate) struct Shown {
    began: bool,
    presented: Option<Duration>,
    settled: Option<Duration>,
    frames: Vec<ShownFrame>,
    times: Timings,
}

impl Shown {
    /// Whether the scene may be shown: all that there will be of the first frame is there, or nobody shall wait for it any
    /// longer.
    pub(crate) fn may_show(&mut self, all_there_is: bool, now: Duration) -> bool {
        self.began |= all_there_is || now >= HOLD_BACK;
        self.began
    }

    /// Whether the scene was shown, be it without something.
    pub(crate) const fn has_begun(&self) -> bool {
        self.began
    }

    /// Notes a frame with the scene in it.
    pub(crate) fn note(&mut self, now: Duration, whole: bool, drawn: &Counters, received: Received) {
        if whole {
            self.presented.get_or_insert(now);
        }
        if now <= KEPT_FOR && self.frames.len() < MAX_KEPT {
            let &Counters { instances, triangles, .. } = drawn;
            let at_ms = now.as_secs_f64() * 1e3;
            self.frames.push(ShownFrame { at_ms, whole, instances, triangles, received });
        }
    }

    /// Notes what the last frames' passes took.
    pub(crate) fn note_times(&mut self, times: Timings) {
        self.times = times;
    }

    /// What the last frames' passes took.
    pub(crate) const fn times(&self) -> &Timings {
        &self.times
    }

    /// Notes that the picture of the last frame will not change by itself.
    pub(crate) fn note_settled(&mut self, now: Duration) {
        self.settled.get_or_insert(now);
    }

    /// When the first frame was shown that held everything.
    pub(crate) const fn presented(&self) -> Option<Duration> {
        self.presented
    }

    /// When the settled picture was shown first.
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
    fn nothing_is_shown_before_all_of_the_first_frame_is_there() {
        let mut shown = Shown::default();
        let ms = Duration::from_millis;
        assert!(!shown.may_show(false, ms(100)) && !shown.may_show(false, ms(1999)));
        assert!(shown.may_show(true, ms(300)));
        assert!(shown.may_show(false, ms(400)), "a scene that begins anew is shown as it comes");
        shown.note(ms(450), true, &Counters::default(), Received::default());
        shown.note(ms(500), true, &Counters::default(), Received::default());
        assert_eq!((shown.presented(), shown.frames().len()), (Some(ms(450)), 2));
    }

    #[test]
    fn what_is_there_is_shown_at_once_where_the_rest_does_not_come_and_not_called_presented() {
        let mut shown = Shown::default();
        assert!(shown.may_show(true, Duration::from_millis(300)) && shown.has_begun());
        shown.note(Duration::from_millis(350), false, &Counters::default(), Received::default());
        assert_eq!((shown.presented(), shown.frames()[0].whole), (None, false));
    }

    #[test]
    fn on_a_slow_link_what_is_there_is_shown_and_not_called_presented() {
        let mut shown = Shown::default();
        assert!(shown.may_show(false, HOLD_BACK));
        shown.note(HOLD_BACK, false, &Counters::default(), Received::default());
        assert_eq!(shown.presented(), None);
        shown.note(2 * HOLD_BACK, true, &Counters::default(), Received::default());
        assert_eq!(shown.presented(), Some(2 * HOLD_BACK));
    }

    #[test]
    fn errors_are_told_once_all_in_view_can_be_drawn() {
        let mut stats = Stats { transport_bytes: 700, ..Stats::default() };
        let counters = &mut stats.counters;
        (counters.visible_instances, counters.drawable_instances) = (2, 1);
        (counters.max_screen_error_px, counters.seen_screen_error_px) = (f64::INFINITY, f64::INFINITY);
        assert_eq!(Received::from(&stats), Received { bytes: 700, ..Received::default() });
        let counters = &mut stats.counters;
        counters.drawable_instances = 2;
        (counters.max_screen_error_px, counters.seen_screen_error_px) = (9.0, 3.0);
        // Not yet: others may be in view of which nothing is known.
        assert_eq!(Received::from(&stats).error_px, None);
        stats.milestones.first_frame = Some(Milestone { after: HOLD_BACK, bytes: 600 });
        let all = Received { bytes: 700, error_px: Some(9.0), seen_error_px: Some(3.0) };
        assert_eq!(Received::from(&stats), all);
    }
}
