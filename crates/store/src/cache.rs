//! Blobs in memory, bounded in bytes, that all scenes of a process share: what they are called is their contents.

use std::future::Future;
use std::sync::Arc;

use bytes::Bytes;
use futures_util::FutureExt as _;
use lodestream_scene::description::Fingerprint;
use moka::future::Cache;

use super::error::StoreError;

/// Cost of an entry in memory beside its bytes, so that many tiny ones are bounded too.
const ENTRY_BYTES: u32 = 128;

/// Blobs that lie together in a pack: its fingerprint, and the number of the first one's entry.
pub(super) type CacheKey = (Fingerprint, u32);

/// See the module. What was not used lately, and seldom before, leaves first (TinyLFU: Einziger, Friedman and Manes, ACM
/// Transactions on Storage 13.4, 2017).
#[derive(Clone, Debug)]
pub struct BlobCache {
    cache: Cache<CacheKey, Bytes>,
    capacity: u64,
}

impl BlobCache {
    /// One that holds about so many bytes.
    #[must_use]
    pub fn new(bytes: u64) -> Self {
        let weigh = |_: &CacheKey, bytes: &Bytes| {
            u32::try_from(bytes.len()).unwrap_or(u32::MAX).saturating_add(ENTRY_BYTES)
        };
        Self { cache: Cache::builder().max_capacity(bytes).weigher(weigh).build(), capacity: bytes }
    }

    /// What is at hand, without waiting for anything.
    pub(super) fn get(&self, key: CacheKey) -> Option<Bytes> {
        // What the future might wait for is housekeeping, and then this counts as not at hand.
        self.cache.get(&key).now_or_never().flatten()
    }

    /// What is at hand, or else what `read` brings: asked once for all who wait for it.
    pub(super) async fn get_or(
        &self,
        key: CacheKey,
        read: impl Future<Output = Result<Bytes, StoreError>>,
    ) -> Result<Bytes, Arc<StoreError>> {
        self.cache.try_get_with(key, read).await
    }

    /// Keeps what was read. May wait for housekeeping: not on a thread that serves the network.
    pub(super) fn insert(&self, key: CacheKey, bytes: Bytes) {
        pollster::block_on(self.cache.insert(key, bytes));
    }

    /// The same from a future.
    pub(super) async fn keep(&self, key: CacheKey, bytes: Bytes) {
        self.cache.insert(key, bytes).await;
    }

    /// Bytes that there is room for before anything leaves.
    pub(super) fn room(&self) -> u64 {
        self.capacity.saturating_sub(self.cache.weighted_size())
    }
}
