//! A cache bounded in bytes, the least recently used blob leaving first.

use std::collections::{BTreeMap, HashMap};

use bytes::Bytes;

/// Cost of an entry beside its bytes, so that many tiny blobs are bounded too.
const ENTRY_BYTES: u64 = 128;

/// See the module. `K` names blobs.
#[derive(Debug)]
pub(super) struct Lru<K> {
    limit_bytes: u64,
    held_bytes: u64,
    clock: u64,
    entries: HashMap<K, (Bytes, u64)>,
    by_use: BTreeMap<u64, K>,
}

impl<K: Copy + Eq + std::hash::Hash> Lru<K> {
    pub(super) fn new(limit_bytes: u64) -> Self {
        Self { limit_bytes, held_bytes: 0, clock: 0, entries: HashMap::new(), by_use: BTreeMap::new() }
    }

    pub(super) fn get(&mut self, key: &K) -> Option<Bytes> {
        self.clock += 1;
        let (bytes, used) = self.entries.get_mut(key)?;
        self.by_use.remove(used);
        *used = self.clock;
        self.by_use.insert(self.clock, *key);
        Some(bytes.clone())
    }

    /// Keeps a blob, unless it alone exceeds the limit.
    pub(super) fn insert(&mut self, key: K, bytes: Bytes) {
        let cost = cost(&bytes);
        if cost > self.limit_bytes {
            return;
        }
        self.remove(&key);
        while self.held_bytes + cost > self.limit_bytes {
            let Some((_, oldest)) = self.by_use.pop_first() else { break };
            if let Some((bytes, _)) = self.entries.remove(&oldest) {
                self.held_bytes -= self::cost(&bytes);
            }
        }
        self.clock += 1;
        self.held_bytes += cost;
        self.entries.insert(key, (bytes, self.clock));
        self.by_use.insert(self.clock, key);
    }

    fn remove(&mut self, key: &K) {
        if let Some((bytes, used)) = self.entries.remove(key) {
            self.by_use.remove(&used);
            self.held_bytes -= cost(&bytes);
        }
    }
}

fn cost(bytes: &Bytes) -> u64 {
    bytes.len() as u64 + ENTRY_BYTES
}

#[cfg(test)]
mod tests {
    use super::*;

    fn blob(length: usize) -> Bytes {
        Bytes::from(vec![7; length])
    }

    #[test]
    fn the_least_recently_used_leaves_first() {
        let mut lru = Lru::new(3 * (100 + ENTRY_BYTES));
        for key in 0..3 {
            lru.insert(key, blob(100));
        }
        assert!(lru.get(&0).is_some());
        lru.insert(3, blob(100));
        assert!(lru.get(&1).is_none());
        assert!([0, 2, 3].iter().all(|key| lru.get(key).is_some()));
    }

    #[test]
    fn memory_stays_bounded_whatever_comes() {
        let mut lru = Lru::new(10_000);
        for i in 0..1000u32 {
            lru.insert(i % 37, blob((i as usize * 7919) % 5000));
            let held: u64 = lru.entries.values().map(|(bytes, _)| cost(bytes)).sum();
            assert_eq!(held, lru.held_bytes);
            assert_eq!(lru.entries.len(), lru.by_use.len());
            assert!(held <= 10_000);
        }
        lru.insert(99, blob(20_000));
        assert!(lru.get(&99).is_none());
    }
}
