//! A pack in a local file or in an object store.

use std::sync::Arc;

use bytes::Bytes;
use lodestream_scene::BlobPart;
use tokio::task::spawn_blocking;

use super::cache::{BlobCache, CacheKey};
use super::error::StoreError;
use super::file::PackFile;
use super::object_pack::ObjectPack;

/// A pack of a scene.
#[derive(Clone, Debug)]
pub(super) enum Pack {
    /// Blobs are read one by one: the system's page cache holds adjacent ones.
    File(Arc<PackFile>),
    Object(Arc<ObjectPack>),
}

impl Pack {
    pub(super) fn blob_len(&self, part: BlobPart) -> Option<u32> {
        match self {
            Self::File(file) => file.blob_len(part),
            Self::Object(object) => object.blob_len(part),
        }
    }

    /// Cache key of a file's blob.
    pub(super) fn key(&self, part: BlobPart) -> Option<CacheKey> {
        match self {
            Self::File(file) => Some((file.fingerprint(), file.number(part)?)),
            Self::Object(_) => None,
        }
    }

    /// The blob, if it is cached. Does not wait.
    pub(super) fn cached(&self, part: BlobPart, cache: &BlobCache) -> Option<Bytes> {
        match self {
            Self::File(_) => cache.get(self.key(part)?),
            Self::Object(object) => object.cached(part, cache),
        }
    }

    /// The blob. Files are read on blocking threads, once for all concurrent callers.
    pub(super) async fn fetch(&self, part: BlobPart, cache: &BlobCache) -> Result<Bytes, Arc<StoreError>> {
        let file = match self {
            Self::Object(object) => return object.fetch(part, cache).await,
            Self::File(file) => Arc::clone(file),
        };
        let Some(key) = self.key(part) else { return Ok(file.read(part)?) };
        let path = file.path().to_owned();
        let read = async move {
            let read = spawn_blocking(move || file.read(part)).await;
            read.unwrap_or_else(|why| {
                Err(StoreError::Read { path, source: std::io::Error::other(why.to_string()) })
            })
        };
        cache.get_or(key, read).await
    }
}
