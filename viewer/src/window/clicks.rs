//! Double clicks: two clicks at the same place, soon after each other.

use std::time::Duration;

/// Longest time between the clicks of a double click.
const DOUBLE_CLICK: Duration = Duration::from_millis(400);
/// Movement of the pointer, in pixels, from which on a click is a drag, and two clicks are single ones.
pub(super) const CLICK_PX: f64 = 4.0;

/// The last click.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Clicks {
    last: Option<(Duration, [f64; 2])>,
}

impl Clicks {
    /// Records a click; returns whether it is the second of a double click. Clicks during a frame are handled after
    /// it, so the time between them may be longer by `frame`.
    pub(super) fn click(&mut self, now: Duration, at: [f64; 2], frame: Duration) -> bool {
        let double = self.last.is_some_and(|(before, place)| {
            now.saturating_sub(before) <= DOUBLE_CLICK + frame
                && (at[0] - place[0]).hypot(at[1] - place[1]) < CLICK_PX
        });
        // A third click begins anew.
        self.last = (!double).then_some((now, at));
        double
    }

    /// Forgets the last click: something else has happened since.
    pub(super) fn forget(&mut self) {
        self.last = None;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_clicks_are_one_double_click_if_they_are_near_in_place_and_time() {
        let ms = Duration::from_millis;
        let (here, near, away) = ([10.0, 10.0], [11.0, 8.0], [10.0, 20.0]);
        let clicks = |clicks: &[(u64, [f64; 2])], frame: Duration| {
            let mut state = Clicks::default();
            clicks.iter().map(|(at, place)| state.click(ms(*at), *place, frame)).collect::<Vec<_>>()
        };
        let quick = ms(16);
        assert_eq!(clicks(&[(0, here), (300, near)], quick), [false, true]);
        assert_eq!(clicks(&[(0, here), (300, away)], quick), [false, false]);
        assert_eq!(clicks(&[(0, here), (900, here)], quick), [false, false]);
        assert_eq!(clicks(&[(0, here), (900, here)], ms(700)), [false, true], "frames are slow");
        assert_eq!(clicks(&[(0, here), (200, here), (400, here)], quick), [false, true, false]);
        let mut state = Clicks::default();
        state.click(ms(0), here, quick);
        state.forget();
        assert!(!state.click(ms(100), here, quick));
    }
}
