//! Limits on the cost of an input: peak memory and elementary steps.

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

use lodestream_geometry::steps;

thread_local! {
    static LIVE: Cell<usize> = const { Cell::new(0) };
    static PEAK: Cell<usize> = const { Cell::new(0) };
}

/// The system's allocator with a count of bytes per thread. Memory that one thread frees for another makes the count
/// wrong, so a measured piece of work must stay on its thread.
struct Counting;

#[global_allocator]
static COUNTING: Counting = Counting;

fn grown(bytes: usize) {
    // A thread that is being torn down no longer has the counters.
    let _ = LIVE.try_with(|live| {
        live.set(live.get().wrapping_add(bytes));
        let _ = PEAK.try_with(|peak| peak.set(peak.get().max(live.get())));
    });
}

fn shrunk(bytes: usize) {
    let _ = LIVE.try_with(|live| live.set(live.get().wrapping_sub(bytes)));
}

// SAFETY: every call goes to the system's allocator with the arguments given; the counters are plain
// cells with constant initialisers, so touching them allocates nothing.
#[allow(unsafe_code, reason = "an allocator is unsafe; see SAFETY")]
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        grown(layout.size());
        unsafe { System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        grown(layout.size());
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn dealloc(&self, at: *mut u8, layout: Layout) {
        shrunk(layout.size());
        unsafe { System.dealloc(at, layout) }
    }

    unsafe fn realloc(&self, at: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        // Both blocks may exist while one is copied to the other.
        grown(size);
        shrunk(layout.size());
        unsafe { System.realloc(at, layout, size) }
    }
}

/// Limits for an input of `n` bytes: `base + per_byte × n`, of memory and of steps.
#[derive(Clone, Copy, Debug)]
pub struct Ceiling {
    /// Bytes of memory for any input.
    pub base_bytes: usize,
    /// Additional bytes of memory per byte of input.
    pub bytes_per_byte: usize,
    /// Steps for any input.
    pub base_steps: u64,
    /// Additional steps per byte of input.
    pub steps_per_byte: u64,
}

/// Cost of a piece of work.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Cost {
    /// Peak bytes of memory, above those held before.
    pub peak_bytes: usize,
    /// Steps, as [`lodestream_geometry::steps`] counts them; 0 in builds that do not count.
    pub steps: u64,
}

/// Bytes of memory that the thread allocated and that are not freed.
#[must_use]
pub fn held_bytes() -> usize {
    LIVE.get()
}

/// Runs a piece of work and measures its cost.
pub fn measure<T>(work: impl FnOnce() -> T) -> (T, Cost) {
    let (before, steps_before) = (LIVE.get(), steps::taken());
    PEAK.set(before);
    let result = work();
    let peak_bytes = PEAK.get().saturating_sub(before);
    let steps = steps::taken().zip(steps_before).map_or(0, |(after, before)| after - before);
    (result, Cost { peak_bytes, steps })
}

/// Runs a piece of work on an input of `length` bytes.
///
/// # Panics
/// If its cost exceeds the limit.
pub fn within<T>(ceiling: Ceiling, length: usize, work: impl FnOnce() -> T) -> T {
    let (result, cost) = measure(work);
    let bytes = ceiling.base_bytes + ceiling.bytes_per_byte * length;
    let steps = ceiling.base_steps + ceiling.steps_per_byte * length as u64;
    assert!(
        cost.peak_bytes <= bytes,
        "{} bytes held for an input of {length}, over {bytes}",
        cost.peak_bytes
    );
    assert!(cost.steps <= steps, "{} steps for an input of {length} bytes, over {steps}", cost.steps);
    result
}

#[cfg(test)]
mod tests {
    use super::*;

    const TIGHT: Ceiling = Ceiling { base_bytes: 1000, bytes_per_byte: 1, base_steps: 0, steps_per_byte: 0 };

    #[test]
    fn the_peak_excludes_memory_freed_before() {
        let (_, cost) = measure(|| {
            drop(vec![1_u8; 700]);
            vec![1_u8; 200]
        });
        assert_eq!(cost, Cost { peak_bytes: 700, steps: 0 });
        let mut list = Vec::with_capacity(100);
        let ((), cost) = measure(|| list.resize(1000, 0_u8));
        assert_eq!(cost.peak_bytes, 1000);
    }

    #[test]
    #[should_panic(expected = "bytes held")]
    fn a_reservation_above_the_limit_is_a_finding_even_if_unused() {
        within(TIGHT, 24, || drop(Vec::<u8>::with_capacity(1025)));
    }

    #[test]
    fn a_cost_within_the_limit_is_no_finding() {
        assert_eq!(within(TIGHT, 24, || Vec::<u8>::with_capacity(1024).capacity()), 1024);
    }
}
