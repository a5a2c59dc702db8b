//! View updates to the server: the latest view, at most every 100 ms.

use std::time::Duration;

use crate::time::Time;
use lodestream_scene::view::View;

/// Least time between two `SetView`.
const VIEW_INTERVAL: Duration = Duration::from_millis(100);

/// The view that is not sent yet, and when the last one was sent.
#[derive(Debug, Default)]
pub(super) struct ViewUpdates {
    view: Option<View>,
    sent: Option<Time>,
}

impl ViewUpdates {
    /// Records that `Hello` was sent. Without a view in it, the first update is due at once.
    pub(super) fn hello_sent(&mut self, now: Time, with_view: bool) {
        self.sent = with_view.then_some(now);
    }

    /// Sets the view; ignores an invalid one.
    pub(super) fn set(&mut self, view: View) {
        if view.check().is_ok() {
            self.view = Some(view);
        }
    }

    /// When the next update may be sent, if there is one.
    pub(super) fn next(&self) -> Option<Time> {
        self.view.and(self.sent).map(|sent| sent + VIEW_INTERVAL)
    }

    /// The view to send now.
    pub(super) fn poll(&mut self, now: Time) -> Option<View> {
        if self.sent.is_some_and(|sent| now < sent + VIEW_INTERVAL) {
            return None;
        }
        let view = self.view.take()?;
        self.sent = Some(now);
        Some(view)
    }
}
