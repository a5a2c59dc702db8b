//! LRU cache of received blobs, bounded in bytes.
//!
//! An applied chunk does not need its bytes any more, but after it is undone it can be applied again from here without
//! fetching it a second time.

use std::collections::{BTreeMap, HashMap};

use bytes::Bytes;
use lodestream_scene::BlobId;

#[derive(Debug)]
struct Entry {
    bytes: Bytes,
    last_use: u64,
}

/// LRU cache of blobs or their beginnings.
#[derive(Debug)]
pub(crate) struct BlobCache {
    capacity_bytes: u64,
    held_bytes: u64,
    entries: HashMap<BlobId, Entry>,
    /// Blobs by the value of `clock` at their last use, which is unique.
    order: BTreeMap<u64, BlobId>,
    clock: u64,
}

impl BlobCache {
    pub(crate) fn new(capacity_bytes: u64) -> Self {
        Self { capacity_bytes, held_bytes: 0, entries: HashMap::new(), order: BTreeMap::new(), clock: 0 }
    }

    /// Sets the capacity; the next [`BlobCache::trim`] evicts what is too much.
    pub(crate) const fn set_capacity(&mut self, capacity_bytes: u64) {
        self.capacity_bytes = capacity_bytes;
    }

    /// Bytes held.
    pub(crate) const fn bytes(&self) -> u64 {
        self.held_bytes
    }

    /// Inserts a blob. The cache may exceed its capacity until [`BlobCache::trim`].
    pub(crate) fn insert(&mut self, id: BlobId, bytes: Bytes) {
        self.remove(id);
        self.clock += 1;
        self.held_bytes += bytes.len() as u64;
        self.order.insert(self.clock, id);
        self.entries.insert(id, Entry { bytes, last_use: self.clock });
    }

    /// Appends bytes that begin at `offset` of a blob. Returns how many leading bytes the cache then holds, or `None`,
    /// without a change, if bytes before `offset` are missing.
    pub(crate) fn extend(&mut self, id: BlobId, offset: u32, bytes: Bytes) -> Option<u32> {
        let held = self.held_bytes(id);
        if offset > held {
            return None;
        }
        let new = bytes.slice((held - offset).min(u32::try_from(bytes.len()).ok()?) as usize..);
        if held == 0 {
            self.insert(id, new);
        } else if !new.is_empty() {
            let held = self.entries.get(&id).map(|entry| entry.bytes.clone()).unwrap_or_default();
            self.insert(id, [held, new].concat().into());
        }
        Some(self.held_bytes(id))
    }

    /// Number of leading bytes of a blob in the cache.
    pub(crate) fn held_bytes(&self, id: BlobId) -> u32 {
        self.entries.get(&id).map_or(0, |entry| u32::try_from(entry.bytes.len()).unwrap_or(u32::MAX))
    }

    /// Evicts least recently used blobs until the rest fits, and returns their ids. Blobs that are `needed` stay even
    /// if the capacity is exceeded: they are about to be applied and would have to be fetched again.
    pub(crate) fn trim(&mut self, needed: impl Fn(BlobId) -> bool) -> Vec<BlobId> {
        let mut excess = self.held_bytes.saturating_sub(self.capacity_bytes);
        let mut evicted = Vec::new();
        for &old in self.order.values() {
            if excess == 0 {
                break;
            }
            if !needed(old) {
                excess = excess.saturating_sub(self.entries.get(&old).map_or(0, |e| e.bytes.len() as u64));
                evicted.push(old);
            }
        }
        for &old in &evicted {
            self.remove(old);
        }
        evicted
    }

    /// A blob's bytes; updates its last use.
    pub(crate) fn get(&mut self, id: BlobId) -> Option<Bytes> {
        let entry = self.entries.get_mut(&id)?;
        self.clock += 1;
        self.order.remove(&entry.last_use);
        self.order.insert(self.clock, id);
        entry.last_use = self.clock;
        Some(entry.bytes.clone())
    }

    pub(crate) fn contains(&self, id: BlobId) -> bool {
        self.entries.contains_key(&id)
    }

    pub(crate) fn remove(&mut self, id: BlobId) {
        if let Some(entry) = self.entries.remove(&id) {
            self.order.remove(&entry.last_use);
            self.held_bytes -= entry.bytes.len() as u64;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn blob(length: usize) -> Bytes {
        Bytes::from(vec![7; length])
    }

    #[test]
    fn least_recently_used_goes_first_and_the_bound_holds() {
        let mut cache = BlobCache::new(100);
        let [a, b, c] = [0, 1, 2].map(|n| BlobId::chunk(0, n));
        cache.insert(a, blob(40));
        cache.insert(b, blob(40));
        assert!(cache.trim(|_| false).is_empty());
        assert!(cache.get(a).is_some());
        cache.insert(c, blob(40));
        assert_eq!(cache.trim(|_| false), [b]);
        assert_eq!(cache.bytes(), 80);
        assert!(cache.contains(a) && cache.contains(c) && !cache.contains(b));
    }

    #[test]
    fn a_blob_grows_only_by_bytes_that_follow_without_a_gap() {
        let mut cache = BlobCache::new(100);
        let a = BlobId::chunk(0, 1);
        assert_eq!(cache.extend(a, 10, blob(5)), None);
        assert_eq!(cache.extend(a, 0, Bytes::from_static(b"abcd")), Some(4));
        assert_eq!(cache.extend(a, 5, Bytes::from_static(b"fg")), None);
        assert_eq!(cache.extend(a, 4, Bytes::from_static(b"ef")), Some(6));
        assert_eq!(cache.extend(a, 3, Bytes::from_static(b"defgh")), Some(8));
        assert_eq!(cache.extend(a, 0, Bytes::from_static(b"ab")), Some(8));
        assert_eq!((cache.get(a).unwrap().as_ref(), cache.bytes()), (&b"abcdefgh"[..], 8));
    }

    #[test]
    fn inserting_twice_and_removing_keeps_the_count_right() {
        let mut cache = BlobCache::new(100);
        let a = BlobId::base(1);
        cache.insert(a, blob(30));
        cache.insert(a, blob(50));
        assert_eq!(cache.bytes(), 50);
        cache.remove(a);
        cache.remove(a);
        assert_eq!(cache.bytes(), 0);
        assert!(cache.get(a).is_none());
    }

    #[test]
    fn needed_blobs_are_not_evicted() {
        let mut cache = BlobCache::new(100);
        let [a, b, c] = [0, 1, 2].map(|n| BlobId::chunk(0, n));
        for (id, length) in [(a, 60), (b, 30), (c, 60)] {
            cache.insert(id, blob(length));
        }
        assert_eq!(cache.trim(|id| id != b), [b]);
        assert_eq!(cache.bytes(), 120);
        assert_eq!(cache.trim(|_| false), [a]);
        assert_eq!(cache.bytes(), 60);
    }
}
