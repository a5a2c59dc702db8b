//! How the pure crate borrows threads and reports progress: both are handed in by the caller.

/// Runs independent tasks, on as many threads as the implementor likes.
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

/// Runs `f(i)` for all `i` and returns the results in order.
pub(crate) fn map<T: Send>(pool: &dyn Pool, count: usize, f: &(dyn Fn(usize) -> T + Sync)) -> Vec<T> {
    let slots: Vec<std::sync::Mutex<Option<T>>> = (0..count).map(|_| std::sync::Mutex::new(None)).collect();
    pool.run(count, &|i| {
        let value = f(i);
        if let Ok(mut slot) = slots[i].lock() {
            *slot = Some(value);
        }
    });
    slots.into_iter().filter_map(|s| s.into_inner().ok().flatten()).collect()
}

/// How far a preparation has come.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Progress {
    /// Faces that no longer need simplification.
    pub faces_done: usize,
    /// Faces in all.
    pub faces_total: usize,
    /// Edge collapses performed so far.
    pub collapses: usize,
}

/// Receives progress; answers whether to go on.
pub trait Monitor: Sync {
    /// Called from time to time; `false` cancels the preparation.
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
