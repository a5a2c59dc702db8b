//! The thread pool of a preparation.

use std::num::NonZeroUsize;

use lodestream_geometry::pool::{Pool, Tasks};

/// Runs tasks on scoped threads, which live as long as one call.
#[derive(Clone, Copy, Debug)]
pub struct Threads {
    count: NonZeroUsize,
}

impl Threads {
    /// `count` threads, or as many as the machine has.
    #[must_use]
    pub fn new(count: Option<NonZeroUsize>) -> Self {
        let count = count.or_else(|| std::thread::available_parallelism().ok());
        Self { count: count.unwrap_or(NonZeroUsize::MIN) }
    }
}

impl Pool for Threads {
    fn run(&self, count: usize, task: &(dyn Fn(usize) + Sync)) {
        let tasks = Tasks::new(count, task);
        std::thread::scope(|scope| {
            // The calling thread works too, so one thread means none is spawned.
            for _ in 1..self.count.get().min(count) {
                scope.spawn(|| tasks.work());
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
