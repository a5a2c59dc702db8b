//! Notifications to the service manager for units of `Type=notify` (sd_notify(3)); without one they do nothing.

use std::time::Duration;

/// The server is ready: its sockets are open.
pub(crate) fn listening() {
    #[cfg(unix)]
    notify(&[sd_notify::NotifyState::Ready]);
}

/// The server drains, for `at_most` this long.
pub(crate) fn draining(at_most: Duration) {
    #[cfg(unix)]
    {
        let us = u32::try_from(at_most.as_micros()).unwrap_or(u32::MAX);
        notify(&[
            sd_notify::NotifyState::Stopping,
            sd_notify::NotifyState::Status("draining"),
            sd_notify::NotifyState::ExtendTimeoutUsec(us),
        ]);
    }
    #[cfg(not(unix))]
    let _ = at_most;
}

#[cfg(unix)]
fn notify(states: &[sd_notify::NotifyState<'_>]) {
    if let Err(why) = sd_notify::notify(states) {
        tracing::warn!("cannot notify the service manager: {why}");
    }
}
