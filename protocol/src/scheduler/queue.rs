//! Units that wait, the most urgent first: a binary heap, and a table that tells where in it each unit stands.
//!
//! Whoever asks for much has thousands queued for as long as his session lasts. An entry takes 36 bytes and 4 to 11 of
//! the table; a map by key with one by unit beside it took three times as much.

use std::cmp::Reverse;
use std::hash::{BuildHasher as _, RandomState};
use std::ops::Range;

use super::reads::Key;
use super::{Unit, number};
use lodestream_select::priority::Priority;

/// In the table: nobody's place.
const FREE: u32 = u32::MAX;
/// Fewer entries keep the memory that they have.
const LEAST_ENTRIES: usize = 16;

#[derive(Debug)]
struct Entry {
    unit: Unit,
    part: Range<u32>,
    priority: Priority,
    /// First come, first served: the halves of a 64-bit number, which would align the entry to 8 bytes.
    number: [u32; 2],
    /// Its place in the table.
    place: u32,
}

/// A unit that waits: its place in the order, and what is wanted of it.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct Waiting {
    pub(super) key: Key,
    pub(super) unit: Unit,
    pub(super) part: Range<u32>,
}

/// See the module.
#[derive(Debug, Default)]
pub(super) struct Queue {
    /// A binary heap: no entry goes before its parent, which is that of half its index (less one).
    entries: Vec<Entry>,
    /// A hash table with linear probing: indices of entries, or [`FREE`]. A power of two long, a quarter of it free.
    /// Clients choose the units: the hash is keyed, so that none can make them collide.
    places: Vec<u32>,
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

    /// What goes first: its place in the order, and the unit.
    pub(super) fn first(&self) -> Option<(Key, Unit)> {
        self.entries.first().map(|entry| (entry.key(), entry.unit))
    }

    /// Units in no order, with what is wanted of them.
    pub(super) fn iter(&self) -> impl Iterator<Item = (&Unit, &Range<u32>)> {
        self.entries.iter().map(|entry| (&entry.unit, &entry.part))
    }

    /// Adds a unit that does not wait yet.
    pub(super) fn insert(&mut self, Waiting { key: (Reverse(priority), order), unit, part }: Waiting) {
        debug_assert!(!self.contains(&unit));
        if self.places.len() * 3 < (self.entries.len() + 1) * 4 {
            self.place_all((self.entries.len() + 1).max(LEAST_ENTRIES));
        }
        let at = self.entries.len();
        let place = self.free_place(&unit);
        self.places[place] = number(at);
        #[expect(clippy::cast_possible_truncation, reason = "the halves of a number")]
        let number_halves = [(order >> 32) as u32, order as u32];
        self.entries.push(Entry { unit, part, priority, number: number_halves, place: number(place) });
        self.rise(at);
    }

    /// Gives a unit that waits another priority, and makes what is wanted of it cover `part` too. `false` where it does
    /// not wait.
    pub(super) fn want(&mut self, unit: &Unit, priority: Priority, part: &Range<u32>) -> bool {
        let Some(at) = self.find(unit) else { return false };
        let entry = &mut self.entries[at];
        entry.part = entry.part.start.min(part.start)..entry.part.end.max(part.end);
        entry.priority = priority;
        self.settle(at);
        true
    }

    /// Takes what goes first.
    pub(super) fn pop(&mut self) -> Option<Waiting> {
        (!self.entries.is_empty()).then(|| self.take(0))
    }

    /// Takes a unit out.
    pub(super) fn remove(&mut self, unit: &Unit) -> Option<Waiting> {
        self.find(unit).map(|at| self.take(at))
    }

    /// Drops the units for which `keep` says no.
    pub(super) fn retain(&mut self, mut keep: impl FnMut(&Unit) -> bool) {
        let before = self.entries.len();
        self.entries.retain(|entry| keep(&entry.unit));
        if self.entries.len() == before {
            return;
        }
        self.entries.shrink_to(LEAST_ENTRIES);
        self.place_all(self.entries.len().max(LEAST_ENTRIES));
        for at in (0..self.entries.len() / 2).rev() {
            self.sink(at);
        }
    }

    /// Drops all, and the memory that they took.
    pub(super) fn clear(&mut self) {
        (self.entries, self.places) = (Vec::new(), Vec::new());
    }

    fn hash(&self, unit: &Unit) -> usize {
        #[expect(clippy::cast_possible_truncation, reason = "any bits of a hash serve")]
        let hash = self.hasher.hash_one(unit) as usize;
        hash & self.places.len().wrapping_sub(1)
    }

    fn next(&self, place: usize) -> usize {
        (place + 1) & (self.places.len() - 1)
    }

    /// The index of a unit's entry.
    fn find(&self, unit: &Unit) -> Option<usize> {
        if self.places.is_empty() {
            return None;
        }
        let mut place = self.hash(unit);
        loop {
            match self.places[place] {
                FREE => return None,
                at if self.entries[at as usize].unit == *unit => return Some(at as usize),
                _ => place = self.next(place),
            }
        }
    }

    /// Where a unit that is not in the table would stand.
    fn free_place(&self, unit: &Unit) -> usize {
        let mut place = self.hash(unit);
        while self.places[place] != FREE {
            place = self.next(place);
        }
        place
    }

    /// Makes a table for so many entries, and places all that there are.
    fn place_all(&mut self, entries: usize) {
        let length = (entries * 4).div_ceil(3).next_power_of_two();
        self.places = vec![FREE; length];
        for at in 0..self.entries.len() {
            let place = self.free_place(&self.entries[at].unit);
            self.places[place] = number(at);
            self.entries[at].place = number(place);
        }
    }

    /// Frees a place, and closes the gap that others were pushed beyond (Knuth, volume 3, section 6.4, algorithm R).
    fn free(&mut self, mut gap: usize) {
        let mut place = gap;
        loop {
            place = self.next(place);
            let at = self.places[place];
            if at == FREE {
                break;
            }
            let home = self.hash(&self.entries[at as usize].unit);
            // It may go where it is found from its home: not before that, around the table's end.
            let from_home = |to: usize| to.wrapping_sub(home) & (self.places.len() - 1);
            if from_home(gap) < from_home(place) {
                self.places[gap] = at;
                self.entries[at as usize].place = number(gap);
                gap = place;
            }
        }
        self.places[gap] = FREE;
    }

    fn take(&mut self, at: usize) -> Waiting {
        self.free(self.entries[at].place as usize);
        let entry = self.entries.swap_remove(at);
        if let Some(moved) = self.entries.get(at) {
            self.places[moved.place as usize] = number(at);
            self.settle(at);
        }
        if self.entries.len() >= LEAST_ENTRIES && self.entries.len() * 4 < self.entries.capacity() {
            self.entries.shrink_to(self.entries.len() * 2);
            self.place_all(self.entries.len() * 2);
        }
        Waiting { key: entry.key(), unit: entry.unit, part: entry.part }
    }

    /// Moves an entry to where it belongs.
    fn settle(&mut self, at: usize) {
        let at = self.rise(at);
        self.sink(at);
    }

    /// Moves an entry up, before those that it goes before; gives its index.
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

    /// Moves an entry down, behind those that go before it.
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
            self.places[self.entries[at].place as usize] = number(at);
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
            assert_eq!((queue.find(&entry.unit), queue.places[entry.place as usize]), (Some(at), number(at)));
            assert!(at == 0 || queue.entries[(at - 1) / 2].key() < entry.key());
        }
        assert_eq!(queue.places.iter().filter(|&&at| at != FREE).count(), queue.len());
        assert!(queue.places.is_empty() || queue.len() * 4 <= queue.places.len() * 3);
    }

    proptest! {
        #[test]
        fn it_does_what_an_ordered_map_does(
            deeds in proptest::collection::vec((0_u8..8, 0_u32..60, 0_u32..5, 0_u32..9), 0..400)
        ) {
            let mut queue = Queue::default();
            let mut map: BTreeMap<Key, (Unit, Range<u32>)> = BTreeMap::new();
            for (order, (deed, unit, priority, from)) in (u64::from(u32::MAX) - 100..).zip(deeds) {
                let unit = Unit::Blob(BlobId::chunk(unit % 3, unit));
                let known = map.iter().find(|(_, (other, _))| *other == unit).map(|(key, _)| *key);
                prop_assert_eq!(queue.contains(&unit), known.is_some());
                match (deed, known) {
                    (0..4, None) => {
                        let (key, part) = ((Reverse(priority), order), from..from + 3);
                        map.insert(key, (unit, part.clone()));
                        queue.insert(Waiting { key, unit, part });
                    }
                    (0..4, Some(key)) => {
                        let (_, part) = map.remove(&key).unwrap();
                        map.insert((Reverse(priority), key.1), (unit, part.start.min(from)..part.end.max(7)));
                        prop_assert!(queue.want(&unit, priority, &(from..7)));
                    }
                    (4, _) => {
                        let removed = known.and_then(|key| Some((key, map.remove(&key)?)));
                        let removed = removed.map(|(key, (unit, part))| Waiting { key, unit, part });
                        prop_assert_eq!(queue.remove(&unit), removed);
                    }
                    (5, _) => {
                        let keep = |other: &Unit| *other != unit && *other != Unit::Blob(BlobId::chunk(0, from * 3));
                        map.retain(|_, (other, _)| keep(other));
                        queue.retain(keep);
                    }
                    _ => {
                        let first = map.pop_first().map(|(key, (unit, part))| Waiting { key, unit, part });
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
    fn thousands_that_wait_took_three_hundred_kilobytes() {
        let mut queue = Queue::default();
        let bytes = |queue: &Queue| {
            queue.entries.capacity() * size_of::<Entry>() + queue.places.capacity() * size_of::<u32>()
        };
        for n in 0..2048 {
            let (key, unit) = ((Reverse(n % 7), u64::from(n)), Unit::Blob(BlobId::chunk(n / 40, n % 40)));
            queue.insert(Waiting { key, unit, part: 0..u32::MAX });
        }
        assert!(bytes(&queue) <= 2048 * 44, "{}", bytes(&queue));
        while queue.len() > 100 {
            queue.pop();
        }
        check(&queue);
        assert!(bytes(&queue) <= 400 * 44, "{}", bytes(&queue));
    }
}
