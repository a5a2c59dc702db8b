//! Thread pool for decoding.

use std::num::NonZeroUsize;
use std::sync::Arc;

use lodestream_geometry::pool::{Pool, Tasks};

use crate::core::Decoders;

/// Runs tasks on the calling thread and on scoped threads, which are started for each call: some 30 µs each, against
/// milliseconds of decoding.
#[derive(Clone, Copy, Debug)]
pub struct Threads(NonZeroUsize);

impl Threads {
    /// A number of threads; `None` for all of the machine's cores but one, which is left for drawing, and at least one.
    #[must_use]
    pub fn new(count: Option<NonZeroUsize>) -> Self {
        let free = || {
            let cores = std::thread::available_parallelism().map_or(1, NonZeroUsize::get);
            NonZeroUsize::new(cores - 1).unwrap_or(NonZeroUsize::MIN)
        };
        Self(count.unwrap_or_else(free))
    }

    /// Number of threads.
    #[must_use]
    pub const fn count(self) -> NonZeroUsize {
        self.0
    }

    /// Decoders on these threads.
    #[must_use]
    pub fn decoders(self) -> Decoders {
        if self.0 == NonZeroUsize::MIN { Decoders::default() } else { Decoders::on(Arc::new(self)) }
    }
}

impl Pool for Threads {
    fn run(&self, count: usize, task: &(dyn Fn(usize) + Sync)) {
        let tasks = Tasks::new(count, task);
        std::thread::scope(|scope| {
            for _ in 1..self.0.get().min(count) {
                // If the system provides no thread, the others run all tasks.
                let thread = std::thread::Builder::new().name("decoding".into());
                drop(thread.spawn_scoped(scope, || tasks.work()));
            }
            tasks.work();
        });
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicUsize, Ordering};

    use super::*;

    #[test]
    fn every_task_runs_once_on_any_number_of_threads() {
        for threads in [1, 2, 7] {
            let pool = Threads::new(NonZeroUsize::new(threads));
            assert_eq!(pool.count().get(), threads);
            for count in [0, 1, 2, 1000] {
                let runs: Vec<AtomicUsize> = (0..count).map(|_| AtomicUsize::new(0)).collect();
                pool.run(count, &|i| {
                    runs[i].fetch_add(1, Ordering::Relaxed);
                });
                assert!(runs.iter().all(|r| r.load(Ordering::Relaxed) == 1));
            }
        }
    }
}
