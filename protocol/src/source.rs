//! `SceneSource`: the interface through which server sessions read scenes and blobs.

use std::future::Future;
use std::pin::Pin;
use std::sync::Arc;

use bytes::Bytes;

use lodestream_scene::animation::AnimationTable;
use lodestream_scene::blob::BlobId;
use lodestream_scene::description::{SceneHeader, ScenePage};
use lodestream_scene::parts::PartTable;
use lodestream_scene::punctual_lights::PunctualLights;
use lodestream_select::Occluder;

/// A blob that cannot be read.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum SourceError {
    /// No such blob in this scene.
    #[error("{0} does not exist")]
    NotFound(BlobId),
    /// The blob's bytes are damaged or cannot be read.
    #[error("{id} cannot be read: {why}")]
    Unreadable {
        /// The blob.
        id: BlobId,
        /// The store's error.
        why: String,
    },
}

/// Result of a read without waiting.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Reading {
    /// The bytes.
    Ready(Bytes),
    /// The blob must be read by [`SceneSource::read`], which may block.
    Pending,
}

/// Hits and misses of a blob cache since the start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct CacheUse {
    /// Blobs found in the cache.
    pub hits: u64,
    /// Blobs that had to be read.
    pub misses: u64,
}

/// An outstanding read that holds no thread.
pub type BlobFuture = Pin<Box<dyn Future<Output = Result<Bytes, SourceError>> + Send>>;

/// One scene with its blobs. Shared by all sessions.
pub trait SceneSource: Send + Sync {
    /// The scene's header.
    fn header(&self) -> &SceneHeader;

    /// A page of the description; `None` beyond the last.
    fn page(&self, page: u32) -> Option<Arc<ScenePage>>;

    /// Count and first page of the scene's punctual lights; `None` if it has none.
    fn punctual_lights(&self) -> Option<&PunctualLights> {
        None
    }

    /// The table of what the scene's parts are called; `None` if it has none.
    fn parts(&self) -> Option<PartTable> {
        None
    }

    /// The number of the scene's animated models; `None` if it has none.
    fn animations(&self) -> Option<AnimationTable> {
        None
    }

    /// Length of a blob in bytes; `None` if there is no such blob. Must not read the blob.
    fn blob_len(&self, id: &BlobId) -> Option<u32>;

    /// Reads a blob, of [`SceneSource::blob_len`] bytes. May block on a disk or an object store; then
    /// [`SceneSource::try_read`] returns [`Reading::Pending`], and drivers call this outside the network's thread.
    ///
    /// # Errors
    /// If the blob is missing or damaged, or the store does not answer within its timeout.
    fn read(&self, id: &BlobId) -> Result<Bytes, SourceError>;

    /// [`SceneSource::read`] as a future that holds no thread, for stores that offer one; drivers prefer it. May be
    /// dropped before it resolves.
    fn fetch(&self, id: &BlobId) -> Option<BlobFuture> {
        let _ = id;
        None
    }

    /// Counters of the blob cache; `None` if there is none.
    fn cache_use(&self) -> Option<CacheUse> {
        None
    }

    /// A coarse surface of an asset for the occlusion test; `None` if none is in memory.
    fn occluder(&self, asset: u32) -> Option<Arc<Occluder>> {
        let _ = asset;
        None
    }

    /// Reads a blob if that needs no waiting. The default is for stores in memory: it calls [`SceneSource::read`].
    ///
    /// # Errors
    /// As [`SceneSource::read`].
    fn try_read(&self, id: &BlobId) -> Result<Reading, SourceError> {
        self.read(id).map(Reading::Ready)
    }
}

/// A source whose reads never pend: for virtual time, in which a disk takes none.
#[derive(Clone, Copy, Debug)]
pub struct Immediate<S>(pub S);

impl<S: SceneSource> SceneSource for Immediate<S> {
    fn header(&self) -> &SceneHeader {
        self.0.header()
    }

    fn page(&self, page: u32) -> Option<Arc<ScenePage>> {
        self.0.page(page)
    }

    fn punctual_lights(&self) -> Option<&PunctualLights> {
        self.0.punctual_lights()
    }

    fn parts(&self) -> Option<PartTable> {
        self.0.parts()
    }

    fn animations(&self) -> Option<AnimationTable> {
        self.0.animations()
    }

    fn blob_len(&self, id: &BlobId) -> Option<u32> {
        self.0.blob_len(id)
    }

    fn read(&self, id: &BlobId) -> Result<Bytes, SourceError> {
        self.0.read(id)
    }

    fn cache_use(&self) -> Option<CacheUse> {
        self.0.cache_use()
    }

    fn occluder(&self, asset: u32) -> Option<Arc<Occluder>> {
        self.0.occluder(asset)
    }
}
