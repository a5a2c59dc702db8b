//! Counts elementary steps, so that tests and fuzzing can hold decoders to a ceiling of work as they
//! hold them to one of memory. A step is one corner of a star visited, or one bit decoded: whatever a
//! decoder does is a constant number of operations beside these.
//!
//! Counted in builds with debug assertions, per thread; elsewhere nothing is counted and nothing costs.

#[cfg(debug_assertions)]
thread_local! {
    static TAKEN: std::cell::Cell<u64> = const { std::cell::Cell::new(0) };
}

/// Counts so many steps.
#[inline]
pub fn take(steps: u64) {
    #[cfg(debug_assertions)]
    TAKEN.set(TAKEN.get() + steps);
    #[cfg(not(debug_assertions))]
    let _ = steps;
}

/// Steps taken by this thread so far; `None` in builds that do not count.
#[must_use]
pub fn taken() -> Option<u64> {
    #[cfg(debug_assertions)]
    return Some(TAKEN.get());
    #[cfg(not(debug_assertions))]
    return None;
}
