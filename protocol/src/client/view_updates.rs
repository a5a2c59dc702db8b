//! Views to tell the server of: the last one, at intervals.

use std::time::Duration;

use crate::time::Time;
use lodestream_scene::view::View;

/// Least time between two `SetView`.
const VIEW_INTERVAL: Duration = Duration::from_millis(100);

/// See the module.
#[derive(Debug, Default)]
pub(super) struct ViewUpdates {
    view: Option<View>,
    sent: Option<Time>,
}

impl ViewUpdates {
    /// `Hello` has named a view, or none: one that the server has not heard of yet need not wait.
    pub(super) fn greeted(&mut self, now: Time, with_view: bool) {
        self.sent = with_view.then_some(now);
    }

    /// The view is another. One that cannot be used is passed over.
    pub(super) fn set(&mut self, view: View) {
        if view.check().is_ok() {
            self.view = Some(view);
        }
    }

    /// When the next one may be told, if one waits.
    pub(super) fn next(&self) -> Option<Time> {
        self.view.and(self.sent).map(|sent| sent + VIEW_INTERVAL)
    }

    /// The view to tell now.
    pub(super) fn poll(&mut self, now: Time) -> Option<View> {
        if self.sent.is_some_and(|sent| now < sent + VIEW_INTERVAL) {
            return None;
        }
        let view = self.view.take()?;
        self.sent = Some(now);
        Some(view)
    }
}
