//! Virtual time: tokio's paused clock, as nanoseconds since the start of a simulation.
//!
//! On a current-thread runtime that was started paused, tokio moves its clock to the next timer
//! whenever no task can run. Work on the runtime's thread takes no virtual time; work that waits
//! for another thread would let time run ahead of it, so simulated code must not leave the thread.
//!
//! tokio's timers have a resolution of one millisecond and fire late, never early. Waiting tasks are therefore up to 1
//! ms late; arrival times are computed in nanoseconds, so rates are not affected.

use std::time::Duration;

use tokio::time::{Instant, Sleep};

/// A point in virtual time from which nanoseconds are counted.
#[derive(Clone, Copy, Debug)]
pub struct VirtualClock {
    start: Instant,
}

impl VirtualClock {
    /// A clock that starts now. Must be called inside the simulation's runtime.
    #[must_use]
    pub fn start() -> Self {
        Self { start: Instant::now() }
    }

    /// Nanoseconds since the start.
    #[must_use]
    pub fn now_ns(&self) -> u64 {
        u64::try_from(self.start.elapsed().as_nanos()).unwrap_or(u64::MAX)
    }

    /// The instant of tokio's clock `at_ns` after the start.
    #[must_use]
    pub fn instant(&self, at_ns: u64) -> Instant {
        self.start + Duration::from_nanos(at_ns)
    }

    /// Waits until `at_ns` after the start.
    pub fn sleep_until(&self, at_ns: u64) -> Sleep {
        tokio::time::sleep_until(self.instant(at_ns))
    }
}

/// A runtime whose clock is virtual: one thread, time paused, no I/O.
///
/// # Errors
/// Errors of the system.
pub fn virtual_runtime() -> std::io::Result<tokio::runtime::Runtime> {
    tokio::runtime::Builder::new_current_thread().enable_time().start_paused(true).build()
}
