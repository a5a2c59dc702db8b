//! Priority queue with lookup by unit: a binary heap, and a hash table of heap indices.
//!
//! A client may have thousands of units queued for as long as its session lasts, so entries are small: 36 bytes, and
//! 4 to 11 bytes of the table. A map by key with another by unit took three times as much.

use std::cmp::Reverse;
use std::hash::{BuildHasher as _, RandomState};
use std::ops::Range;

use super::length::number;
use super::reads::Key;
use super::unit::Unit;
use lodestream_select::priority::Priority;

/// Marks a free slot of the table.
const FREE: u32 = u32::MAX;
/// With fewer entries no memory is released.
const MIN_ENTRIES: usize = 16;

#[derive(Debug)]
struct Entry {
    unit: Unit,
    part: Range<u32>,
    priority: Priority,
    /// Arrival number, in two halves: a `u64` would align the entry to 8 bytes.
    number: [u32; 2],
    /// Index of its slot in the table.
    slot: u32,
}

/// A queued unit with its key and the wanted part.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct QueuedUnit {
    pub(super) key: Key,
    pub(super) unit: Unit,
    pub(super) part: Range<u32>,
}

/// The queued units of one session.
#[derive(Debug, Default)]
pub(super) struct Queue {
    /// A binary heap: no key is less than that of the parent, at index (i - 1) / 2.
    entries: Vec<Entry>,
    /// A hash table with linear probing: indices of entries, or [`FREE`]. Its length is a power of two, at least a
    /// quarter of it is free. The hash is keyed, because clients choose the units and must not cause collisions.
    slots: Vec<u32>,
    hasher: RandomState,
}

impl Entry {
    fn key(&self) -> Key {
        let [high, low] = self.number;
        (Reverse(self.priority), u64::from(high) << 32 | u64::from(low))
    }
}

impl Queue {
    pub(super) const fn len(&self) -> usize {
        self.entries.len()
    }

    pub(super) const fn is_empty(&self) -> bool {
        self.entries.is_empty()
    }

    pub(super) fn contains(&self, unit: &Unit) -> bool {
        self.find(unit).is_some()
    }

    /// The most urgent unit, with its key.
    pub(super) fn first(&self) -> Option<(Key, Unit)> {
        self.entries.first().map(|entry| (entry.key(), entry.unit))
    }

    /// All units with their wanted parts, unordered.
    pub(super) fn iter(&self) -> impl Iterator<Item = (&Unit, &Range<u32>)> {
        self.entries.iter().map(|entry| (&entry.unit, &entry.part))
    }

    /// Adds a unit that is not queued.
    pub(super) fn insert(&mut self, QueuedUnit { key: (Reverse(priority), order), unit, part }: QueuedUnit) {
        debug_assert!(!self.contains(&unit));
        if self.slots.len() * 3 < (self.entries.len() + 1) * 4 {
            self.rebuild_table((self.entries.len() + 1).max(MIN_ENTRIES));
        }
        let at = self.entries.len();
        let slot = self.free_slot(&unit);
        self.slots[slot] = number(at);
        #[expect(clippy::cast_possible_truncation, reason = "the halves of a number")]
        let number_halves = [(order >> 32) as u32, order as u32];
        self.entries.push(Entry { unit, part, priority, number: number_halves, slot: number(slot) });
        self.rise(at);
    }

    /// Changes the priority of a queued unit and extends its part to cover `part`. Returns `false` if it is not queued.
    pub(super) fn update(&mut self, unit: &Unit, priority: Priority, part: &Range<u32>) -> bool {
        let Some(at) = self.find(unit) else { return false };
        let entry = &mut self.entries[at];
        entry.part = entry.part.start.min(part.start)..entry.part.end.max(part.end);
        entry.priority = priority;
        self.settle(at);
        true
    }

    /// Removes the most urgent unit.
    pub(super) fn pop(&mut self) -> Option<QueuedUnit> {
        (!self.entries.is_empty()).then(|| self.take(0))
    }

    /// Removes a unit.
    pub(super) fn remove(&mut self, unit: &Unit) -> Option<QueuedUnit> {
        self.find(unit).map(|at| self.take(at))
    }

    /// Drops the units for which `keep` returns false.
    pub(super) fn retain(&mut self, mut keep: impl FnMut(&Unit) -> bool) {
        let before = self.entries.len();
        self.entries.retain(|entry| keep(&entry.unit));
        if self.entries.len() == before {
            return;
        }
        self.entries.shrink_to(MIN_ENTRIES);
        self.rebuild_table(self.entries.len().max(MIN_ENTRIES));
        for at in (0..self.entries.len() / 2).rev() {
            self.sink(at);
        }
    }

    /// Drops all units and releases their memory.
    pub(super) fn clear(&mut self) {
        (self.entries, self.slots) = (Vec::new(), Vec::new());
    }

    fn hash(&self, unit: &Unit) -> usize {
        #[expect(clippy::cast_possible_truncation, reason = "any bits of a hash serve")]
        let hash = self.hasher.hash_one(unit) as usize;
        hash & self.slots.len().wrapping_sub(1)
    }

    fn next(&self, slot: usize) -> usize {
        (slot + 1) & (self.slots.len() - 1)
    }

    /// The index of a unit's entry.
    fn find(&self, unit: &Unit) -> Option<usize> {
        if self.slots.is_empty() {
            return None;
        }
        let mut slot = self.hash(unit);
        loop {
            match self.slots[slot] {
                FREE => return None,
                at if self.entries[at as usize].unit == *unit => return Some(at as usize),
                _ => slot = self.next(slot),
            }
        }
    }

    /// The slot for a unit that is not in the table.
    fn free_slot(&self, unit: &Unit) -> usize {
        let mut slot = self.hash(unit);
        while self.slots[slot] != FREE {
            slot = self.next(slot);
        }
        slot
    }

    /// Builds a table with room for `entries` entries.
    fn rebuild_table(&mut self, entries: usize) {
        let length = (entries * 4).div_ceil(3).next_power_of_two();
        self.slots = vec![FREE; length];
        for at in 0..self.entries.len() {
            let slot = self.free_slot(&self.entries[at].unit);
            self.slots[slot] = number(at);
            self.entries[at].slot = number(slot);
        }
    }

    /// Frees a slot and moves later entries of its cluster up (Knuth, volume 3, section 6.4, algorithm R).
    fn free(&mut self, mut gap: usize) {
        let mut slot = gap;
        loop {
            slot = self.next(slot);
            let at = self.slots[slot];
            if at == FREE {
                break;
            }
            let home = self.hash(&self.entries[at as usize].unit);
            // An entry may move only to a slot at or after its home, counted around the table's end.
            let from_home = |to: usize| to.wrapping_sub(home) & (self.slots.len() - 1);
            if from_home(gap) < from_home(slot) {
                self.slots[gap] = at;
                self.entries[at as usize].slot = number(gap);
                gap = slot;
            }
        }
        self.slots[gap] = FREE;
    }

    fn take(&mut self, at: usize) -> QueuedUnit {
        self.free(self.entries[at].slot as usize);
        let entry = self.entries.swap_remove(at);
        if let Some(moved) = self.entries.get(at) {
            self.slots[moved.slot as usize] = number(at);
            self.settle(at);
        }
        if self.entries.len() >= MIN_ENTRIES && self.entries.len() * 4 < self.entries.capacity() {
            self.entries.shrink_to(self.entries.len() * 2);
            self.rebuild_table(self.entries.len() * 2);
        }
        QueuedUnit { key: entry.key(), unit: entry.unit, part: entry.part }
    }

    /// Restores the heap property for one entry.
    fn settle(&mut self, at: usize) {
        let at = self.rise(at);
        self.sink(at);
    }

    /// Moves an entry up the heap; returns its index.
    fn rise(&mut self, mut at: usize) -> usize {
        while at > 0 {
            let parent = (at - 1) / 2;
            if self.entries[parent].key() < self.entries[at].key() {
                break;
            }
            self.swap(at, parent);
            at = parent;
        }
        at
    }

    /// Moves an entry down the heap.
    fn sink(&mut self, mut at: usize) {
        loop {
            let children = 2 * at + 1..(2 * at + 3).min(self.entries.len());
            let Some(first) = children.min_by_key(|&child| self.entries[child].key()) else { return };
            if self.entries[at].key() < self.entries[first].key() {
                return;
            }
            self.swap(at, first);
            at = first;
        }
    }

    fn swap(&mut self, a: usize, b: usize) {
        self.entries.swap(a, b);
        for at in [a, b] {
            self.slots[self.entries[at].slot as usize] = number(at);
        }
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use proptest::prelude::*;

    use super::*;
    use lodestream_scene::blob::BlobId;

    fn check(queue: &Queue) {
        for (at, entry) in queue.entries.iter().enumerate() {
            assert_eq!((queue.find(&entry.unit), queue.slots[entry.slot as usize]), (Some(at), number(at)));
            assert!(at == 0 || queue.entries[(at - 1) / 2].key() < entry.key());
        }
        assert_eq!(queue.slots.iter().filter(|&&at| at != FREE).count(), queue.len());
        assert!(queue.slots.is_empty() || queue.len() * 4 <= queue.slots.len() * 3);
    }

    proptest! {
        #[test]
        fn queue_behaves_like_an_ordered_map(
            operations in proptest::collection::vec((0_u8..8, 0_u32..60, 0_u32..5, 0_u32..9), 0..400)
        ) {
            let mut queue = Queue::default();
            let mut map: BTreeMap<Key, (Unit, Range<u32>)> = BTreeMap::new();
            for (order, (operation, unit, priority, from)) in (u64::from(u32::MAX) - 100..).zip(operations) {
                let unit = Unit::Blob(BlobId::chunk(unit % 3, unit));
                let known = map.iter().find(|(_, (other, _))| *other == unit).map(|(key, _)| *key);
                prop_assert_eq!(queue.contains(&unit), known.is_some());
                match (operation, known) {
                    (0..4, None) => {
                        let (key, part) = ((Reverse(priority), order), from..from + 3);
                        map.insert(key, (unit, part.clone()));
                        queue.insert(QueuedUnit { key, unit, part });
                    }
                    (0..4, Some(key)) => {
                        let (_, part) = map.remove(&key).unwrap();
                        map.insert((Reverse(priority), key.1), (unit, part.start.min(from)..part.end.max(7)));
                        prop_assert!(queue.update(&unit, priority, &(from..7)));
                    }
                    (4, _) => {
                        let removed = known.and_then(|key| Some((key, map.remove(&key)?)));
                        let removed = removed.map(|(key, (unit, part))| QueuedUnit { key, unit, part });
                        prop_assert_eq!(queue.remove(&unit), removed);
                    }
                    (5, _) => {
                        let keep = |other: &Unit| *other != unit && *other != Unit::Blob(BlobId::chunk(0, from * 3));
                        map.retain(|_, (other, _)| keep(other));
                        queue.retain(keep);
                    }
                    _ => {
                        let first = map.pop_first().map(|(key, (unit, part))| QueuedUnit { key, unit, part });
                        prop_assert_eq!(queue.first(), first.as_ref().map(|first| (first.key, first.unit)));
                        prop_assert_eq!(queue.pop(), first);
                    }
                }
                check(&queue);
                prop_assert_eq!(queue.len(), map.len());
            }
        }
    }

    #[test]
    fn thousands_of_units_use_little_memory() {
        let mut queue = Queue::default();
        let bytes = |queue: &Queue| {
            queue.entries.capacity() * size_of::<Entry>() + queue.slots.capacity() * size_of::<u32>()
        };
        for n in 0..2048 {
            let (key, unit) = ((Reverse(n % 7), u64::from(n)), Unit::Blob(BlobId::chunk(n / 40, n % 40)));
            queue.insert(QueuedUnit { key, unit, part: 0..u32::MAX });
        }
        assert!(bytes(&queue) <= 2048 * 44, "{}", bytes(&queue));
        while queue.len() > 100 {
            queue.pop();
        }
        check(&queue);
        assert!(bytes(&queue) <= 400 * 44, "{}", bytes(&queue));
    }
}
