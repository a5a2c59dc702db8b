//! Time to first frame (TTFF) and times to quality (TTQ).

use std::time::Duration;

use lodestream_protocol::Time;
use lodestream_select::Counters;

/// Screen errors in pixels for which the time to quality is measured.
pub const QUALITIES_PX: [f64; 3] = [16.0, 4.0, 1.0];

/// A time since the connect call, and the transport payload received until then.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Milestone {
    /// Time since the connect call.
    pub after: Duration,
    /// Transport payload received until then, handshake included.
    pub bytes: u64,
}

/// Whether every visible instance can be drawn. `all_known`: all instances that may be visible are known.
pub(crate) const fn is_drawable(all_known: bool, counters: &Counters) -> bool {
    all_known && counters.drawable_instances >= counters.visible_instances
}

/// The milestones of a run. Each is recorded once and kept over reconnections.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Milestones {
    /// When every visible instance could be drawn, at least as its base mesh (TTFF).
    pub first_frame: Option<Milestone>,
    /// When every part in view had a screen error of at most [`QUALITIES_PX`] pixels (TTQ).
    pub quality: [Option<Milestone>; 3],
    /// As `quality`, without the parts that the scene's own surfaces hide.
    pub unoccluded_quality: [Option<Milestone>; 3],
}

impl Milestones {
    /// Records the milestones that a selection's counters reach. `all_known`: all instances that may be visible are
    /// known.
    pub(crate) fn note(&mut self, start: Time, now: Time, bytes: u64, all_known: bool, counters: &Counters) {
        if !is_drawable(all_known, counters) {
            return;
        }
        let here = Milestone { after: now.since(start), bytes };
        self.first_frame.get_or_insert(here);
        let errors = [
            (&mut self.quality, counters.max_screen_error_px),
            (&mut self.unoccluded_quality, counters.unoccluded_screen_error_px),
        ];
        for (slots, error_px) in errors {
            for (slot, px) in slots.iter_mut().zip(QUALITIES_PX) {
                if error_px <= px {
                    slot.get_or_insert(here);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_milestone_is_noted_once_and_only_when_everything_visible_is_known() {
        let mut m = Milestones::default();
        let counters = |drawable_instances, max_screen_error_px| Counters {
            visible_instances: 2,
            drawable_instances,
            max_screen_error_px,
            unoccluded_screen_error_px: max_screen_error_px / 3.0,
            ..Counters::default()
        };
        let start = Time::from_ms(10);
        m.note(start, Time::from_ms(20), 100, false, &counters(2, 3.0));
        m.note(start, Time::from_ms(30), 200, true, &counters(1, f64::INFINITY));
        assert_eq!(m, Milestones::default());
        m.note(start, Time::from_ms(40), 300, true, &counters(2, 9.0));
        m.note(start, Time::from_ms(50), 400, true, &counters(2, 0.5));
        let at = |ms, bytes| Some(Milestone { after: Duration::from_millis(ms), bytes });
        assert_eq!(m.first_frame, at(30, 300));
        assert_eq!(m.quality, [at(30, 300), at(40, 400), at(40, 400)]);
        assert_eq!(m.unoccluded_quality, [at(30, 300), at(30, 300), at(40, 400)]);
    }
}
