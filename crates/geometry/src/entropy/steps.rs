//! Counts elementary steps, so that tests and fuzzing can bound a decoder's work as they bound its memory. A step is
//! one visited corner of a star or one decoded bit; a decoder does a constant number of operations per step.
//!
//! Counted per thread, in builds with debug assertions only.

#[cfg(debug_assertions)]
thread_local! {
    static TAKEN: std::cell::Cell<u64> = const { std::cell::Cell::new(0) };
}

/// Adds steps to this thread's count.
#[inline]
pub fn take(steps: u64) {
    #[cfg(debug_assertions)]
    TAKEN.set(TAKEN.get() + steps);
    #[cfg(not(debug_assertions))]
    let _ = steps;
}

/// Steps of this thread so far; `None` in builds that do not count.
#[must_use]
pub fn taken() -> Option<u64> {
    #[cfg(debug_assertions)]
    return Some(TAKEN.get());
    #[cfg(not(debug_assertions))]
    return None;
}
