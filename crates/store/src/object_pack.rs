//! A pack in an object store: its table in memory, its blobs fetched in ranges of adjacent blobs.

use std::sync::Arc;
use std::time::Duration;

use bytes::Bytes;
use lodestream_geometry::DecodeError;
use lodestream_geometry::pack::{HEAD_BYTES, Head};
use lodestream_scene::BlobPart;
use lodestream_scene::description::Fingerprint;
use tokio::time::sleep;

use super::cache::{BlobCache, CacheKey};
use super::error::StoreError;
use super::objects::Objects;
use super::table::{Table, blob_name, kind};

/// Bytes of the first request for a pack: usually table, base mesh and index; all of a small pack.
const FIRST_BYTES: u64 = 64 << 10;
/// Most bytes of a range. Time (some ten milliseconds) and price of a request hardly depend on it.
const RANGE_BYTES: u64 = 128 << 10;
/// Attempts at a range whose bytes do not match their hashes.
const ATTEMPTS: u32 = 3;
/// Pause before the second attempt; doubled for each after it.
const PAUSE: Duration = Duration::from_millis(100);

/// Adjacent blobs that are fetched together.
#[derive(Clone, Copy, Debug)]
struct Extent {
    /// Number of the first entry; the next extent's is the end.
    first: u32,
    offset: u64,
    length: u64,
}

/// Check of fetched bytes.
#[derive(Clone, Copy, Debug)]
enum Check {
    /// Hashes of all blobs of this extent.
    Extent(usize),
    /// Hash of this entry's blob.
    Entry(usize),
}

/// A pack in an object store.
#[derive(Debug)]
pub(super) struct ObjectPack {
    objects: Objects,
    name: String,
    table: Table,
    extents: Vec<Extent>,
}

impl ObjectPack {
    /// Opens the pack of this fingerprint, and caches the extents that the first request brings.
    pub(super) async fn open(
        objects: &Objects,
        name: &str,
        fingerprint: Fingerprint,
        cache: &BlobCache,
    ) -> Result<Self, StoreError> {
        let format = |source| StoreError::Format { path: objects.path(name), source };
        let (mut start, length) = objects.range(name, 0..FIRST_BYTES).await?;
        let head = Head::parse(&start[..start.len().min(HEAD_BYTES)]).map_err(format)?;
        let range = Table::range(&head, length).map_err(format)?;
        if range.end > start.len() as u64 {
            start = objects.range(name, 0..range.end).await?.0;
        }
        let table =
            usize::try_from(range.end).ok().and_then(|end| start.get(HEAD_BYTES..end)).unwrap_or_default();
        let table = Table::parse(head, table, length).map_err(format)?;
        if table.fingerprint != fingerprint {
            return Err(StoreError::OtherPack { path: objects.path(name) });
        }
        let extents = extents(&table);
        let pack = Self { objects: objects.clone(), name: name.to_owned(), table, extents };
        for (number, extent) in (0..).zip(&pack.extents) {
            let Some(bytes) = cut(&start, extent.offset, extent.length) else { break };
            if pack.verify(number, &bytes).is_ok() {
                cache.keep(pack.key(extent.first), bytes).await;
            }
        }
        Ok(pack)
    }

    pub(super) fn blob_len(&self, part: BlobPart) -> Option<u32> {
        self.table.find(part).map(|entry| entry.length)
    }

    fn key(&self, first: u32) -> CacheKey {
        (self.table.fingerprint, first)
    }

    /// The blob's entry, and the extent that it lies in.
    fn place(&self, part: BlobPart) -> Option<(usize, usize)> {
        let wanted = kind(part);
        let entry = self.table.entries.binary_search_by_key(&wanted, |entry| entry.kind).ok()?;
        let after = self.extents.partition_point(|extent| extent.first as usize <= entry);
        Some((entry, after.checked_sub(1)?))
    }

    /// The blob, if its extent is cached.
    pub(super) fn cached(&self, part: BlobPart, cache: &BlobCache) -> Option<Bytes> {
        let (entry, extent) = self.place(part)?;
        let bytes = cache.get(self.key(self.extents[extent].first))?;
        self.within(entry, extent, &bytes)
    }

    fn within(&self, entry: usize, extent: usize, bytes: &Bytes) -> Option<Bytes> {
        let entry = self.table.entries.get(entry)?;
        cut(bytes, entry.offset - self.extents.get(extent)?.offset, u64::from(entry.length))
    }

    /// The blob, cached or fetched with its extent; one request serves all concurrent callers.
    pub(super) async fn fetch(&self, part: BlobPart, cache: &BlobCache) -> Result<Bytes, Arc<StoreError>> {
        let missing = || StoreError::NoSuchBlob { path: self.path(), what: blob_name(part) };
        let (entry, extent) = self.place(part).ok_or_else(missing)?;
        match cache.get_or(self.key(self.extents[extent].first), self.extent(extent)).await {
            Ok(bytes) => self.within(entry, extent, &bytes).ok_or_else(|| Arc::new(missing())),
            // One blob of the extent is damaged; others may be intact.
            Err(why) if matches!(*why, StoreError::Format { .. }) => Ok(self.alone(entry).await?),
            Err(why) => Err(why),
        }
    }

    fn path(&self) -> std::path::PathBuf {
        self.objects.path(&self.name)
    }

    /// All blobs of an extent, each checked against its hash.
    async fn extent(&self, number: usize) -> Result<Bytes, StoreError> {
        let Extent { offset, length, .. } = self.extents[number];
        self.fetch_checked(offset, length, Check::Extent(number)).await
    }

    /// One blob by itself, checked against its hash.
    async fn alone(&self, number: usize) -> Result<Bytes, StoreError> {
        let entry = &self.table.entries[number];
        self.fetch_checked(entry.offset, u64::from(entry.length), Check::Entry(number)).await
    }

    /// Fetches a range until its check passes, at most [`ATTEMPTS`] times. (The client already retries errors of the store.)
    async fn fetch_checked(&self, offset: u64, length: u64, check: Check) -> Result<Bytes, StoreError> {
        let mut pause = PAUSE;
        let mut attempt = 1;
        loop {
            let (bytes, total) = self.objects.range(&self.name, offset..offset + length).await?;
            if total != self.table.total_bytes {
                return Err(StoreError::Replaced { path: self.path() });
            }
            let checked = match check {
                Check::Extent(number) => self.verify(number, &bytes),
                Check::Entry(number) => {
                    self.table.entries[number].verify(&bytes).map_err(|source| self.damaged(source))
                }
            };
            match checked {
                Ok(()) => return Ok(bytes),
                Err(why) if attempt < ATTEMPTS => tracing::warn!("retrying: {why}"),
                Err(why) => return Err(why),
            }
            sleep(pause).await;
            pause *= 2;
            attempt += 1;
        }
    }

    fn verify(&self, number: usize, bytes: &Bytes) -> Result<(), StoreError> {
        let extent = &self.extents[number];
        let end = self.extents.get(number + 1).map_or(self.table.entries.len(), |next| next.first as usize);
        for entry in &self.table.entries[extent.first as usize..end] {
            let blob = cut(bytes, entry.offset - extent.offset, u64::from(entry.length));
            let blob = blob.ok_or_else(|| self.damaged(DecodeError::new("pack", "a range is too short")))?;
            entry.verify(&blob).map_err(|source| self.damaged(source))?;
        }
        Ok(())
    }

    fn damaged(&self, source: DecodeError) -> StoreError {
        StoreError::Format { path: self.path(), source }
    }
}

fn cut(bytes: &Bytes, offset: u64, length: u64) -> Option<Bytes> {
    let (start, end) = (usize::try_from(offset).ok()?, usize::try_from(offset.checked_add(length)?).ok()?);
    (end <= bytes.len()).then(|| bytes.slice(start..end))
}

/// Splits a pack into ranges of whole blobs. The first range ends within the first request. Blobs that are not adjacent,
/// which does not occur in packs written here, are ranges of their own.
fn extents(table: &Table) -> Vec<Extent> {
    let mut extents: Vec<Extent> = Vec::new();
    for (number, entry) in (0..).zip(&table.entries) {
        let end = entry.offset + u64::from(entry.length);
        if let Some(last) = extents.last_mut() {
            let most = if last.offset < FIRST_BYTES { FIRST_BYTES } else { last.offset + RANGE_BYTES };
            if entry.offset == last.offset + last.length && end <= most {
                last.length = end - last.offset;
                continue;
            }
        }
        extents.push(Extent { first: number, offset: entry.offset, length: u64::from(entry.length) });
    }
    extents
}
