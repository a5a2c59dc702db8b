//! What may be had again, bounded in cost: the least recently used leaves first.

use std::collections::{BTreeMap, HashMap};

/// See the module. What a value costs is said when it comes.
#[derive(Debug)]
pub(super) struct Lru<K, V> {
    limit: u64,
    held: u64,
    clock: u64,
    entries: HashMap<K, Entry<V>>,
    by_use: BTreeMap<u64, K>,
}

#[derive(Debug)]
struct Entry<V> {
    value: V,
    cost: u64,
    used: u64,
}

impl<K: Copy + Eq + std::hash::Hash, V: Clone> Lru<K, V> {
    pub(super) fn new(limit: u64) -> Self {
        Self { limit, held: 0, clock: 0, entries: HashMap::new(), by_use: BTreeMap::new() }
    }

    pub(super) fn get(&mut self, key: &K) -> Option<V> {
        self.clock += 1;
        let entry = self.entries.get_mut(key)?;
        self.by_use.remove(&entry.used);
        entry.used = self.clock;
        self.by_use.insert(self.clock, *key);
        Some(entry.value.clone())
    }

    /// Keeps a value, unless it alone exceeds the limit.
    pub(super) fn insert(&mut self, key: K, value: V, cost: u64) {
        if cost > self.limit {
            return;
        }
        self.remove(&key);
        while self.held + cost > self.limit {
            let Some((_, oldest)) = self.by_use.pop_first() else { break };
            if let Some(entry) = self.entries.remove(&oldest) {
                self.held -= entry.cost;
            }
        }
        self.clock += 1;
        self.held += cost;
        self.entries.insert(key, Entry { value, cost, used: self.clock });
        self.by_use.insert(self.clock, key);
    }

    pub(super) fn remove(&mut self, key: &K) {
        if let Some(entry) = self.entries.remove(key) {
            self.by_use.remove(&entry.used);
            self.held -= entry.cost;
        }
    }

    /// How many values are kept.
    pub(super) fn len(&self) -> usize {
        self.entries.len()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_least_recently_used_leaves_first() {
        let mut lru = Lru::new(300);
        for key in 0..3 {
            lru.insert(key, key, 100);
        }
        assert!(lru.get(&0).is_some());
        lru.insert(3, 3, 100);
        assert!(lru.get(&1).is_none());
        assert!([0, 2, 3].iter().all(|&key| lru.get(&key) == Some(key)));
    }

    #[test]
    fn cost_stays_bounded_whatever_comes() {
        let mut lru = Lru::new(10_000);
        for i in 0..1000_u64 {
            lru.insert(i % 37, i, (i * 7919) % 5000);
            let held: u64 = lru.entries.values().map(|entry| entry.cost).sum();
            assert_eq!(held, lru.held);
            assert_eq!(lru.entries.len(), lru.by_use.len());
            assert!(held <= 10_000);
        }
        lru.insert(99, 0, 20_000);
        assert!(lru.get(&99).is_none());
    }
}
