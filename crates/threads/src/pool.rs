//! A pool of threads for preparing and decoding meshes.

use std::num::NonZeroUsize;

use lodestream_geometry::pool::{Pool, Tasks};

/// Runs tasks on the calling thread and on scoped threads, which are started for each call: some 30 µs each, against
/// milliseconds of work. Where the system provides no threads, the calling thread runs all tasks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Threads(NonZeroUsize);

impl Threads {
    /// A number of threads, the calling one included.
    #[must_use]
    pub const fn new(count: NonZeroUsize) -> Self {
        Self(count)
    }

    /// As many as the machine has cores.
    #[must_use]
    pub fn all_cores() -> Self {
        Self(std::thread::available_parallelism().unwrap_or(NonZeroUsize::MIN))
    }

    /// One less than the machine has cores, but at least one.
    #[must_use]
    pub fn all_cores_but_one() -> Self {
        Self(NonZeroUsize::new(Self::all_cores().0.get() - 1).unwrap_or(NonZeroUsize::MIN))
    }

    /// A thread for each task, for a few short ones.
    #[must_use]
    pub const fn each_task() -> Self {
        Self(NonZeroUsize::MAX)
    }

    /// Number of threads, the calling one included.
    #[must_use]
    pub const fn count(self) -> NonZeroUsize {
        self.0
    }
}

impl Pool for Threads {
    fn run(&self, count: usize, task: &(dyn Fn(usize) + Sync)) {
        let tasks = Tasks::new(count, task);
        std::thread::scope(|scope| {
            for _ in 1..self.0.get().min(count) {
                // If the system provides no thread, the others run all tasks.
                let thread = std::thread::Builder::new().name("pool".into());
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
            let pool = Threads::new(NonZeroUsize::new(threads).unwrap());
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
