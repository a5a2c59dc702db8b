//! What the service manager is told of a unit of `Type=notify` (sd_notify(3)); where there is none, nobody is told.

use std::time::Duration;

/// The server listens: whoever waits for it may connect.
pub(crate) fn listening() {
    #[cfg(unix)]
    tell(&[sd_notify::NotifyState::Ready]);
}

/// The server drains, and takes at most so long.
pub(crate) fn draining(at_most: Duration) {
    #[cfg(unix)]
    {
        let us = u32::try_from(at_most.as_micros()).unwrap_or(u32::MAX);
        tell(&[
            sd_notify::NotifyState::Stopping,
            sd_notify::NotifyState::Status("draining"),
            sd_notify::NotifyState::ExtendTimeoutUsec(us),
        ]);
    }
    #[cfg(not(unix))]
    let _ = at_most;
}

#[cfg(unix)]
fn tell(states: &[sd_notify::NotifyState<'_>]) {
    if let Err(why) = sd_notify::notify(states) {
        tracing::warn!("the service manager cannot be told how the server is: {why}");
    }
}
