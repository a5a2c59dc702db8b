//! First-fit allocator of slot ranges: merges adjacent free ranges, grows at the end.

use std::ops::Range;

/// Free ranges below a high-water mark.
#[derive(Clone, Debug, Default)]
pub(crate) struct Slots {
    /// Disjoint, ascending, never adjacent, never empty.
    free: Vec<Range<u32>>,
    high: u32,
}

impl Slots {
    /// Allocates `count` consecutive slots.
    pub(crate) fn take(&mut self, count: u32) -> Range<u32> {
        if count == 0 {
            return 0..0;
        }
        if let Some(i) = self.free.iter().position(|r| r.end - r.start >= count) {
            let start = self.free[i].start;
            self.free[i].start += count;
            if self.free[i].is_empty() {
                self.free.remove(i);
            }
            return start..start + count;
        }
        let start = self.high;
        self.high += count;
        start..self.high
    }

    /// Frees a range.
    pub(crate) fn give_back(&mut self, range: Range<u32>) {
        if range.is_empty() {
            return;
        }
        let at = self.free.partition_point(|r| r.start < range.start);
        self.free.insert(at, range);
        for i in [at + 1, at] {
            if i > 0 && i < self.free.len() && self.free[i - 1].end == self.free[i].start {
                self.free[i - 1].end = self.free[i].end;
                self.free.remove(i);
            }
        }
    }

    /// One more than the highest slot ever allocated.
    pub(crate) fn high(&self) -> u32 {
        self.high
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_never_overlap_and_are_reused() {
        let mut slots = Slots::default();
        let a = slots.take(10);
        let b = slots.take(5);
        let c = slots.take(7);
        slots.give_back(a.clone());
        slots.give_back(b);
        assert_eq!(slots.take(15), 0..15, "neighbouring ranges merge");
        slots.give_back(c);
        assert_eq!(slots.take(3), 15..18);
        assert_eq!(slots.high(), 22);
    }
}
