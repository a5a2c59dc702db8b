//! The clock of a session's loop.

use std::time::Duration;

use lodestream_protocol::Time;
use tokio::time::Instant;

/// The clock of a session: tokio's, so that virtual time works, counted from a start.
#[derive(Clone, Copy, Debug)]
pub struct Clock {
    start: Instant,
}

impl Clock {
    /// A clock that starts now.
    #[must_use]
    pub fn start() -> Self {
        Self { start: Instant::now() }
    }

    /// A clock that started at `start`.
    #[cfg(feature = "runtime")]
    #[must_use]
    pub const fn since(start: Instant) -> Self {
        Self { start }
    }

    /// The time of an instant, zero before the start.
    #[cfg(feature = "runtime")]
    #[must_use]
    pub fn time_of(&self, instant: Instant) -> Time {
        Time::from(instant.saturating_duration_since(self.start))
    }

    /// The time since the start.
    #[must_use]
    pub fn now(&self) -> Time {
        Time::from(self.start.elapsed())
    }

    /// Resolves at `time`.
    pub async fn sleep_until(&self, time: Time) {
        let until = self.start.checked_add(Duration::from(time));
        // Far deadlines would overflow an instant.
        tokio::time::sleep_until(until.unwrap_or_else(|| self.start + Duration::from_secs(1 << 30))).await;
    }
}
