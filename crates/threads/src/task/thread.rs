//! Tasks on threads of their own.

use std::thread::{Builder, JoinHandle};

/// A computation beside the calling thread.
#[derive(Debug)]
pub struct Task<T>(JoinHandle<T>);

impl<T: Send + 'static> Task<T> {
    /// Starts the computation, under a name for debuggers.
    ///
    /// # Errors
    /// The system provides no thread.
    pub fn start(name: &str, compute: impl FnOnce() -> T + Send + 'static) -> std::io::Result<Self> {
        Builder::new().name(name.into()).spawn(compute).map(Self)
    }

    /// Whether [`Task::finish`] returns at once.
    #[must_use]
    pub fn is_finished(&self) -> bool {
        self.0.is_finished()
    }

    /// Waits for the result; `None` if the computation panicked.
    #[must_use]
    pub fn finish(self) -> Option<T> {
        self.0.join().ok()
    }
}
