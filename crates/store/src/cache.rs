//! The cache of blobs in memory, bounded in bytes and shared by all scenes of a process. Keys are content fingerprints.

use std::future::Future;
use std::sync::Arc;

use bytes::Bytes;
use futures_util::FutureExt as _;
use lodestream_scene::description::Fingerprint;
use moka::future::Cache;

use super::error::StoreError;

/// Overhead of an entry in bytes, so that many tiny entries are bounded too.
const ENTRY_BYTES: u32 = 128;

/// Adjacent blobs of a pack: the pack's fingerprint, and the entry number of the first blob.
pub(super) type CacheKey = (Fingerprint, u32);

/// A cache of blobs. Evicts rarely and least recently used entries first (TinyLFU: Einziger, Friedman and Manes, ACM
/// Transactions on Storage 13.4, 2017).
#[derive(Clone, Debug)]
pub struct BlobCache {
    cache: Cache<CacheKey, Bytes>,
    capacity: u64,
}

impl BlobCache {
    /// A cache of about this many bytes.
    #[must_use]
    pub fn new(bytes: u64) -> Self {
        let weigh = |_: &CacheKey, bytes: &Bytes| {
            u32::try_from(bytes.len()).unwrap_or(u32::MAX).saturating_add(ENTRY_BYTES)
        };
        Self { cache: Cache::builder().max_capacity(bytes).weigher(weigh).build(), capacity: bytes }
    }

    /// The cached bytes, without waiting.
    pub(super) fn get(&self, key: CacheKey) -> Option<Bytes> {
        // The future could only wait for housekeeping, which then counts as a miss.
        self.cache.get(&key).now_or_never().flatten()
    }

    /// The cached bytes, else those of `read`, which runs once for all concurrent callers.
    pub(super) async fn get_or(
        &self,
        key: CacheKey,
        read: impl Future<Output = Result<Bytes, StoreError>>,
    ) -> Result<Bytes, Arc<StoreError>> {
        self.cache.try_get_with(key, read).await
    }

    /// Inserts an entry. May block for housekeeping, so not for threads that serve the network.
    pub(super) fn insert(&self, key: CacheKey, bytes: Bytes) {
        pollster::block_on(self.cache.insert(key, bytes));
    }

    /// Inserts an entry, asynchronously.
    pub(super) async fn keep(&self, key: CacheKey, bytes: Bytes) {
        self.cache.insert(key, bytes).await;
    }

    /// Free bytes before anything is evicted.
    pub(super) fn room(&self) -> u64 {
        self.capacity.saturating_sub(self.cache.weighted_size())
    }
}
