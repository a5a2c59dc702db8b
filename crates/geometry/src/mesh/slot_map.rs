//! A small hash map from slots to local numbers.
//!
//! Open addressing with linear probing and multiplicative hashing (Knuth, TAOCP 3, §6.4): keys are small, distinct
//! and trusted, and consecutive keys, which slots are, do not collide.

/// Key of an empty place: no slot is that large.
const EMPTY: u32 = u32::MAX;
const FIRST_BITS: u32 = 6;
/// Most places retained by [`SlotMap::clear`].
const MAX_RETAINED: usize = 1 << 14;

/// A map from slots to numbers, without removal.
#[derive(Clone, Debug)]
pub(crate) struct SlotMap {
    /// (slot, number) pairs; the length is a power of two, at most half used.
    places: Vec<(u32, u32)>,
    taken: usize,
    shift: u32,
}

impl Default for SlotMap {
    fn default() -> Self {
        Self { places: vec![(EMPTY, 0); 1 << FIRST_BITS], taken: 0, shift: 32 - FIRST_BITS }
    }
}

impl SlotMap {
    /// A map with capacity for `slots` slots.
    pub(crate) fn with_capacity(slots: usize) -> Self {
        let bits = (slots * 2).next_power_of_two().trailing_zeros().max(FIRST_BITS);
        Self { places: vec![(EMPTY, 0); 1 << bits], taken: 0, shift: 32 - bits }
    }

    /// Removes all entries. Retains the memory, unless clearing it would cost more than filling it.
    pub(crate) fn clear(&mut self) {
        if self.places.len() > MAX_RETAINED {
            *self = Self::default();
        } else if self.taken > 0 {
            self.places.fill((EMPTY, 0));
            self.taken = 0;
        }
    }

    /// Memory held, in bytes.
    pub(crate) fn bytes(&self) -> usize {
        self.places.capacity() * size_of::<(u32, u32)>()
    }

    /// The number of a slot; inserts `number` if it has none.
    #[inline]
    pub(crate) fn number_or(&mut self, slot: u32, number: u32) -> u32 {
        if 2 * (self.taken + 1) > self.places.len() {
            self.grow();
        }
        let at = self.find(slot);
        if self.places[at].0 == EMPTY {
            self.places[at] = (slot, number);
            self.taken += 1;
        }
        self.places[at].1
    }

    #[inline]
    pub(crate) fn get(&self, slot: u32) -> Option<u32> {
        let (key, number) = self.places[self.find(slot)];
        (key == slot).then_some(number)
    }

    /// Inserts the number of a slot; returns false, without change, if the slot has one.
    pub(crate) fn insert(&mut self, slot: u32, number: u32) -> bool {
        if 2 * (self.taken + 1) > self.places.len() {
            self.grow();
        }
        let at = self.find(slot);
        let new = self.places[at].0 == EMPTY;
        if new {
            self.places[at] = (slot, number);
            self.taken += 1;
        }
        new
    }

    /// The place of a slot, or where it would be inserted.
    #[inline]
    fn find(&self, slot: u32) -> usize {
        let mask = self.places.len() - 1;
        let mut at = (slot.wrapping_mul(0x9e37_79b9) >> self.shift) as usize;
        loop {
            let key = self.places[at & mask].0;
            if key == slot || key == EMPTY {
                return at & mask;
            }
            at += 1;
        }
    }

    fn grow(&mut self) {
        let larger = vec![(EMPTY, 0); self.places.len() * 2];
        let old = std::mem::replace(&mut self.places, larger);
        self.shift -= 1;
        for (slot, number) in old.into_iter().filter(|p| p.0 != EMPTY) {
            let at = self.find(slot);
            self.places[at] = (slot, number);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn finds_exactly_the_inserted_slots() {
        let mut map = SlotMap::default();
        let slots: Vec<u32> = (0..500).chain((1000..90_000).step_by(89)).collect();
        for (number, &slot) in slots.iter().enumerate() {
            assert_eq!(map.get(slot), None);
            assert!(map.insert(slot, number as u32) && !map.insert(slot, 0));
        }
        for (number, &slot) in slots.iter().enumerate() {
            assert_eq!(map.get(slot), Some(number as u32));
        }
        assert!(map.get(500).is_none() && map.get(90_001).is_none());
        let mut roomy = SlotMap::with_capacity(slots.len());
        let places = roomy.places.len();
        for (number, &slot) in (0..).zip(&slots) {
            assert_eq!((roomy.number_or(slot, number), roomy.number_or(slot, 7)), (number, number));
        }
        assert_eq!(roomy.places.len(), places, "it grew");
    }
}
