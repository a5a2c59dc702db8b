//! Where a server session finds scenes and blobs.

use std::future::Future;
use std::pin::Pin;
use std::sync::Arc;

use bytes::Bytes;

use lodestream_scene::blob::BlobId;
use lodestream_scene::description::{SceneHeader, ScenePage};
use lodestream_scene::punctual_lights::PunctualLights;
use lodestream_select::Occluder;

/// Why a blob cannot be had.
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
        /// What the store said.
        why: String,
    },
}

/// What a store has of a blob at hand.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Reading {
    /// The bytes.
    Ready(Bytes),
    /// Not yet: [`SceneSource::read`] gets them, and may take its time.
    Pending,
}

/// How often blobs were at hand when they were to be sent, since the start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct CacheUse {
    /// At hand.
    pub hits: u64,
    /// To be read first.
    pub misses: u64,
}

/// A read that is under way, and holds no thread.
pub type BlobFuture = Pin<Box<dyn Future<Output = Result<Bytes, SourceError>> + Send>>;

/// One scene with its blobs. Shared by all sessions.
pub trait SceneSource: Send + Sync {
    /// What holds for the whole scene.
    fn header(&self) -> &SceneHeader;

    /// A page of the description; `None` beyond the last.
    fn page(&self, page: u32) -> Option<Arc<ScenePage>>;

    /// What the scene says of its punctual lights; `None` where it has none.
    fn punctual_lights(&self) -> Option<&PunctualLights> {
        None
    }

    /// Length of a blob in bytes, or `None` where there is no such blob. Must not read the blob.
    fn blob_len(&self, id: &BlobId) -> Option<u32>;

    /// The blob's bytes, as long as [`SceneSource::blob_len`] says. May take as long as a disk or a store of objects
    /// does; where it does, [`SceneSource::try_read`] says so, and drivers call this elsewhere than on the thread that
    /// serves the network.
    ///
    /// # Errors
    /// Fails where the blob is missing or damaged, or the store does not answer in the time that it allows itself.
    fn read(&self, id: &BlobId) -> Result<Bytes, SourceError>;

    /// What [`SceneSource::read`] does, as a future that holds no thread, for stores that have one: drivers then use it in
    /// place of a thread. May be dropped before it resolves.
    fn fetch(&self, id: &BlobId) -> Option<BlobFuture> {
        let _ = id;
        None
    }

    /// How a cache of blobs has done; `None` where there is none.
    fn cache_use(&self) -> Option<CacheUse> {
        None
    }

    /// A coarse surface of an asset, by which is judged what hides what; `None` where there is none at hand.
    fn occluder(&self, asset: u32) -> Option<Arc<Occluder>> {
        let _ = asset;
        None
    }

    /// The blob's bytes if they are at hand, without waiting for anything. As it stands, for stores in memory, it reads.
    ///
    /// # Errors
    /// As [`SceneSource::read`].
    fn try_read(&self, id: &BlobId) -> Result<Reading, SourceError> {
        self.read(id).map(Reading::Ready)
    }
}

/// A source that reads everything at once, on the thread that asks: for virtual time, in which a disk takes none.
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
