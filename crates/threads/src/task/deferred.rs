//! Tasks without threads: computed by the first call that needs the result.

use std::fmt;

/// A computation that is done when its result is asked for.
pub struct Task<T>(Box<dyn FnOnce() -> T + Send>);

impl<T> Task<T> {
    /// Keeps the computation.
    ///
    /// # Errors
    /// Never; with threads, the system may provide none.
    pub fn start(_name: &str, compute: impl FnOnce() -> T + Send + 'static) -> std::io::Result<Self> {
        Ok(Self(Box::new(compute)))
    }

    /// Whether [`Task::finish`] returns at once: never, so that it is called when the result is needed.
    #[must_use]
    pub const fn is_finished(&self) -> bool {
        false
    }

    /// Computes the result. A panic ends the program here.
    #[must_use]
    pub fn finish(self) -> Option<T> {
        Some((self.0)())
    }
}

impl<T> fmt::Debug for Task<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Task(deferred)")
    }
}
