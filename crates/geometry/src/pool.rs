//! Thread pools and progress reports, both supplied by the caller.

use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use crate::error::{MeshError, SkippedTask};

/// Runs independent tasks on any number of threads.
///
/// Implementations must call `task(i)` exactly once for each `i < count` before returning. Nothing in
/// this crate depends on the order or on the number of threads.
pub trait Pool: Sync {
    /// Runs `task(0)` … `task(count - 1)`.
    fn run(&self, count: usize, task: &(dyn Fn(usize) + Sync));
}

/// A pool of one thread: the caller's.
#[derive(Clone, Copy, Debug, Default)]
pub struct Serial;

impl Pool for Serial {
    fn run(&self, count: usize, task: &(dyn Fn(usize) + Sync)) {
        for i in 0..count {
            task(i);
        }
    }
}

/// A queue of tasks for implementors of [`Pool`]: each thread calls [`Tasks::work`].
pub struct Tasks<'a> {
    next: AtomicUsize,
    count: usize,
    task: &'a (dyn Fn(usize) + Sync),
}

impl<'a> Tasks<'a> {
    /// Tasks `task(0)` … `task(count - 1)`, none started.
    #[must_use]
    pub fn new(count: usize, task: &'a (dyn Fn(usize) + Sync)) -> Self {
        Self { next: AtomicUsize::new(0), count, task }
    }

    /// Runs tasks until none is left to start.
    pub fn work(&self) {
        loop {
            let i = self.next.fetch_add(1, Ordering::Relaxed);
            if i >= self.count {
                break;
            }
            (self.task)(i);
        }
    }
}

/// The stage of a preparation. Stages alternate from level to level.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Stage {
    /// Choosing regions and collapsing their edges.
    #[default]
    Simplify,
    /// Measuring distances between the input and the simplified mesh.
    Measure,
    /// Encoding base mesh, chunks and index.
    Encode,
}

/// Progress of a preparation.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Progress {
    /// The stage that starts now.
    pub stage: Stage,
    /// Faces that need no further simplification.
    pub faces_done: usize,
    /// Faces of the input.
    pub faces_total: usize,
    /// Edge collapses performed so far.
    pub collapses: usize,
}

/// Receives progress and may cancel.
pub trait Monitor: Sync {
    /// Called before each stage and each region, by any thread of the pool. `false` cancels the preparation once the
    /// regions in progress are done.
    fn report(&self, progress: Progress) -> bool;
}

/// A monitor that ignores progress and never cancels.
#[derive(Clone, Copy, Debug, Default)]
pub struct Silent;

impl Monitor for Silent {
    fn report(&self, _progress: Progress) -> bool {
        true
    }
}

/// Runs `f(i)` for all `i` and returns the results in order.
pub(crate) fn map<T: Send>(
    pool: &dyn Pool,
    count: usize,
    f: &(dyn Fn(usize) -> T + Sync),
) -> Result<Vec<T>, SkippedTask> {
    let slots: Vec<Mutex<Option<T>>> = (0..count).map(|_| Mutex::new(None)).collect();
    pool.run(count, &|i| {
        put(&slots[i], f(i));
    });
    let results = slots.into_iter().map(taken);
    results.enumerate().map(|(task, result)| result.ok_or(SkippedTask { task, count })).collect()
}

fn put<T>(slot: &Mutex<Option<T>>, value: T) {
    if let Ok(mut slot) = slot.lock() {
        *slot = Some(value);
    }
}

fn taken<T>(slot: Mutex<Option<T>>) -> Option<T> {
    slot.into_inner().ok().flatten()
}

/// A pool that skips the remaining tasks once the monitor has cancelled.
#[derive(Clone, Copy)]
pub(crate) struct MonitoredPool<'a> {
    pool: &'a dyn Pool,
    monitor: &'a dyn Monitor,
    /// Progress reported before each task.
    progress: Progress,
}

impl<'a> MonitoredPool<'a> {
    pub(crate) fn new(pool: &'a dyn Pool, monitor: &'a dyn Monitor, faces_total: usize) -> Self {
        Self { pool, monitor, progress: Progress { faces_total, ..Progress::default() } }
    }

    /// The underlying pool, for subtasks of a task: the monitor is not asked again.
    pub(crate) fn threads(&self) -> &'a dyn Pool {
        self.pool
    }

    /// Starts a stage.
    pub(crate) fn begin(&mut self, stage: Stage) -> Result<(), MeshError> {
        self.progress.stage = stage;
        if self.monitor.report(self.progress) { Ok(()) } else { Err(MeshError::Cancelled) }
    }

    /// Updates the progress.
    pub(crate) fn advance(&mut self, faces_done: usize, collapses: usize) {
        self.progress.faces_done = faces_done;
        self.progress.collapses += collapses;
    }

    /// Runs `a` and `b`, in parallel if there are threads.
    pub(crate) fn both<A: Send, B: Send>(
        &self,
        a: &(dyn Fn() -> A + Sync),
        b: &(dyn Fn() -> B + Sync),
    ) -> Result<(A, B), MeshError> {
        let (first, second) = (Mutex::new(None), Mutex::new(None));
        self.pool.run(2, &|i| {
            if i == 0 {
                put(&first, a());
            } else {
                put(&second, b());
            }
        });
        let left_out = |task| MeshError::from(SkippedTask { task, count: 2 });
        Ok((taken(first).ok_or_else(|| left_out(0))?, taken(second).ok_or_else(|| left_out(1))?))
    }

    /// Runs `f(i)` for all `i`, calling the monitor before each, and returns the results in order.
    pub(crate) fn map<T: Send>(
        &self,
        count: usize,
        f: &(dyn Fn(usize) -> T + Sync),
    ) -> Result<Vec<T>, MeshError> {
        let cancelled = AtomicBool::new(false);
        let results = map(self.pool, count, &|i| {
            if cancelled.load(Ordering::Relaxed) || !self.monitor.report(self.progress) {
                cancelled.store(true, Ordering::Relaxed);
                return None;
            }
            Some(f(i))
        });
        if cancelled.into_inner() {
            return Err(MeshError::Cancelled);
        }
        // Results are missing only after cancellation.
        Ok(results?.into_iter().flatten().collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A faulty pool that leaves out one task.
    struct SkippingPool(usize);

    impl Pool for SkippingPool {
        fn run(&self, count: usize, task: &(dyn Fn(usize) + Sync)) {
            (0..count).filter(|&i| i != self.0).for_each(task);
        }
    }

    #[test]
    fn both_returns_both_results_or_an_error() {
        let both = |pool: &dyn Pool| MonitoredPool::new(pool, &Silent, 0).both(&|| 1, &|| "two");
        assert_eq!(both(&Serial).unwrap(), (1, "two"));
        for task in [0, 1] {
            let error = both(&SkippingPool(task)).unwrap_err();
            assert_eq!(error, MeshError::SkippedTask(SkippedTask { task, count: 2 }));
        }
    }

    #[test]
    fn a_skipped_task_is_named_and_shifts_no_result() {
        assert_eq!(map(&SkippingPool(7), 4, &|i| i * 10), Ok(vec![0, 10, 20, 30]));
        assert_eq!(map(&SkippingPool(1), 4, &|i| i * 10), Err(SkippedTask { task: 1, count: 4 }));
        let watched = MonitoredPool::new(&SkippingPool(3), &Silent, 0);
        let error = watched.map(4, &|i| i).unwrap_err();
        assert_eq!(error, MeshError::SkippedTask(SkippedTask { task: 3, count: 4 }));
        assert!(error.to_string().contains("left out task 3 of 4"), "{error}");
    }
}
