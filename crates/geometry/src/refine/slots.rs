//! First-fit allocator of slot ranges: merges adjacent free ranges, grows and shrinks at the end.

use std::ops::Range;

/// Slots that may be free without the list counting as sparse.
const FEW: u32 = 64;

/// Free ranges below the end of the last range in use.
#[derive(Clone, Debug, Default)]
pub(crate) struct Slots {
    /// Disjoint, ascending, never adjacent, never empty, below `high`.
    free: Vec<Range<u32>>,
    high: u32,
    free_count: u32,
    /// Less than half of the slots were in use since there was last no free one.
    sparse: bool,
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
            self.free_count -= count;
            self.note_sparse();
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
        self.free_count += range.end - range.start;
        let at = self.free.partition_point(|r| r.start < range.start);
        self.free.insert(at, range);
        for i in [at + 1, at] {
            if i > 0 && i < self.free.len() && self.free[i - 1].end == self.free[i].start {
                self.free[i - 1].end = self.free[i].end;
                self.free.remove(i);
            }
        }
        if let Some(last) = self.free.pop_if(|last| last.end == self.high) {
            self.high = last.start;
            self.free_count -= last.end - last.start;
        }
        self.note_sparse();
    }

    fn note_sparse(&mut self) {
        self.sparse = self.free_count > 0 && (self.sparse || self.free_count > self.high / 2 + FEW);
    }

    /// One more than the highest slot in use.
    pub(crate) fn high(&self) -> u32 {
        self.high
    }

    /// Whether ranges are to be moved down into free ones: from when less than half of the slots are in use, until none
    /// is free.
    pub(crate) fn is_sparse(&self) -> bool {
        self.sparse
    }

    /// The moves that fill the lowest free ranges with the ranges above them, ascending, of at least `count` slots if
    /// there are as many, and at most a range more. `range_at` gives the range in use that begins at a slot.
    pub(crate) fn plan(&self, count: u32, mut range_at: impl FnMut(u32) -> Option<Range<u32>>) -> Vec<Move> {
        let mut moves = Vec::new();
        let Some(first) = self.free.first() else { return moves };
        let (mut to, mut at, mut moved) = (first.start, first.start, 0);
        let mut free = self.free.iter();
        let mut next = free.next();
        while at < self.high && moved < count {
            if let Some(range) = next.filter(|range| range.start == at) {
                at = range.end;
                next = free.next();
                continue;
            }
            let Some(from) = range_at(at).filter(|from| from.start == at && !from.is_empty()) else { break };
            let length = from.end - from.start;
            at = from.end;
            moves.push(Move { from, to });
            to += length;
            moved += length;
        }
        moves
    }

    /// Records moves of [`Self::plan`].
    pub(crate) fn moved(&mut self, moves: &[Move]) {
        let (Some(first), Some(last)) = (moves.first(), moves.last()) else {
            // Nothing can move.
            self.sparse = false;
            return;
        };
        let freed = last.to + (last.from.end - last.from.start)..last.from.end;
        debug_assert!(first.to < first.from.start && !freed.is_empty(), "moves go down");
        self.free.retain(|range| range.start >= freed.end);
        self.free_count = self.free.iter().map(|range| range.end - range.start).sum();
        self.give_back(freed);
    }
}

/// A range that moves down; its old and new slots may overlap.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Move {
    pub(crate) from: Range<u32>,
    /// First new slot.
    pub(crate) to: u32,
}

/// The slot after ascending moves.
pub(crate) fn after(moves: &[Move], slot: u32) -> u32 {
    let at = moves.partition_point(|step| step.from.end <= slot);
    match moves.get(at) {
        Some(step) if step.from.start <= slot => step.to + (slot - step.from.start),
        _ => slot,
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
        let d = slots.take(2);
        slots.give_back(a.clone());
        slots.give_back(b);
        assert_eq!(slots.take(15), 0..15, "neighbouring ranges merge");
        slots.give_back(c);
        assert_eq!(slots.take(3), 15..18);
        assert_eq!(slots.high(), 24);
        slots.give_back(d);
        assert_eq!(slots.high(), 18, "free slots at the end are given up");
    }

    #[test]
    fn moves_fill_free_ranges_from_below() {
        let mut slots = Slots::default();
        let ranges: Vec<_> = (0..10).map(|_| slots.take(100)).collect();
        for number in [1, 2, 4, 5, 7] {
            slots.give_back(ranges[number].clone());
        }
        assert!(!slots.is_sparse(), "half of them are in use");
        slots.give_back(ranges[8].clone());
        assert!(slots.is_sparse());
        let moves = slots.plan(101, |start| ranges.iter().find(|range| range.start == start).cloned());
        assert_eq!(moves, [Move { from: 300..400, to: 100 }, Move { from: 600..700, to: 200 }]);
        assert_eq!([99, 300, 650, 700, 950].map(|slot| after(&moves, slot)), [99, 100, 250, 700, 950]);
        slots.moved(&moves);
        assert!(slots.is_sparse() && slots.high() == 1000);
        let rest = slots.plan(u32::MAX, |start| ranges.iter().find(|range| range.start == start).cloned());
        assert_eq!(rest, [Move { from: 900..1000, to: 300 }]);
        slots.moved(&rest);
        assert!(!slots.is_sparse() && slots.high() == 400);
        assert_eq!(slots.take(1), 400..401);
    }
}
