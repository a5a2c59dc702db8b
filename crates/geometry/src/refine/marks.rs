//! Sets of slots that are filled and drained in ascending order repeatedly: the slots touched by a change.

use crate::numbers::id32;

/// A two-level bit set: a bit per slot, and a bit per non-empty word, so draining costs time proportional to the
/// members.
#[derive(Clone, Debug, Default)]
pub(crate) struct Marks {
    words: Vec<u64>,
    summary: Vec<u64>,
}

impl Marks {
    /// Extends the range to slots below `count`.
    pub(crate) fn grow(&mut self, count: usize) {
        let words = count.div_ceil(64);
        if self.words.len() < words {
            self.words.resize(words, 0);
            self.summary.resize(words.div_ceil(64), 0);
        }
    }

    /// Inserts a slot, which must be within the range.
    #[inline]
    pub(crate) fn set(&mut self, slot: u32) {
        let word = (slot / 64) as usize;
        self.words[word] |= 1 << (slot % 64);
        self.summary[word / 64] |= 1 << (word % 64);
    }

    /// Removes all slots, in ascending order.
    #[inline]
    pub(crate) fn drain(&mut self, mut each: impl FnMut(u32)) {
        for (at, summary) in self.summary.iter_mut().enumerate() {
            let mut words = std::mem::take(summary);
            while words != 0 {
                let word = at * 64 + words.trailing_zeros() as usize;
                words &= words - 1;
                let mut bits = std::mem::take(&mut self.words[word]);
                while bits != 0 {
                    each(id32(word) * 64 + bits.trailing_zeros());
                    bits &= bits - 1;
                }
            }
        }
    }

    /// Memory held, in bytes.
    pub(crate) fn bytes(&self) -> usize {
        (self.words.capacity() + self.summary.capacity()) * 8
    }
}

/// Slots that the change in progress has touched. Vertices of touched faces are added when the change is finished.
#[derive(Clone, Debug, Default)]
pub(crate) struct TouchMarks {
    pub(crate) faces: Marks,
    pub(crate) vertices: Marks,
    pub(crate) wedges: Marks,
}

impl TouchMarks {
    /// Memory held, in bytes.
    pub(crate) fn bytes(&self) -> usize {
        self.faces.bytes() + self.vertices.bytes() + self.wedges.bytes()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn draining_yields_each_slot_once_in_order() {
        let mut marks = Marks::default();
        marks.grow(300_000);
        let slots = [299_999, 0, 63, 64, 4095, 4096, 64, 70_000, 0];
        for _ in 0..2 {
            slots.into_iter().for_each(|slot| marks.set(slot));
            let mut out = Vec::new();
            marks.drain(|slot| out.push(slot));
            assert_eq!(out, [0, 63, 64, 4095, 4096, 70_000, 299_999]);
        }
        marks.drain(|slot| panic!("{slot} was left"));
    }
}
