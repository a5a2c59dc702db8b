//! A scene over opened packs: what the sessions of a server share.

use std::sync::{Arc, Mutex};

use bytes::Bytes;
use lodestream_protocol::BlobId;
use lodestream_protocol::scene::{SceneHeader, ScenePage};
use lodestream_protocol::source::{SceneSource, SourceError};

use super::lru::Lru;
use super::{PackFile, StoreError, TerrainBlobs};
use crate::scene::{Composed, Scene, compose};

/// Memory that a scene's blobs may take, by default: a demo scene fits whole, and a large one falls
/// back on the system's page cache.
pub const DEFAULT_CACHE_BYTES: u64 = 256 << 20;

/// See the module.
#[derive(Debug)]
pub struct SceneStore {
    header: SceneHeader,
    pages: Vec<Arc<ScenePage>>,
    /// By asset number.
    packs: Vec<PackFile>,
    terrain: TerrainBlobs,
    cache: Mutex<Lru<BlobId>>,
}

impl SceneStore {
    /// A scene whose asset `i` is `packs[i]`; at most about `cache_bytes` of blobs are kept in memory.
    ///
    /// # Errors
    /// A scene that cannot be described, packs whose base mesh is damaged.
    pub fn new(scene: &Scene, packs: Vec<PackFile>, cache_bytes: u64) -> Result<Self, StoreError> {
        let entries = scene
            .assets
            .iter()
            .zip(&packs)
            .map(|(asset, pack)| pack.entry(&asset.name))
            .collect::<Result<Vec<_>, _>>()?;
        let Composed { header, pages, asset_order, terrain } = compose(scene, &entries)?;
        let mut packs: Vec<Option<PackFile>> = packs.into_iter().map(Some).collect();
        let packs = asset_order.iter().filter_map(|&i| packs.get_mut(i).and_then(Option::take)).collect();
        Ok(Self {
            header,
            pages: pages.into_iter().map(Arc::new).collect(),
            packs,
            terrain,
            cache: Mutex::new(Lru::new(cache_bytes)),
        })
    }
}

impl SceneSource for SceneStore {
    fn header(&self) -> &SceneHeader {
        &self.header
    }

    fn page(&self, page: u32) -> Option<Arc<ScenePage>> {
        self.pages.get(page as usize).cloned()
    }

    fn blob_len(&self, id: &BlobId) -> Option<u32> {
        match *id {
            BlobId::Asset { asset, part } => self.packs.get(asset as usize)?.blob_len(part),
            BlobId::Terrain(blob) => self.terrain.get(blob).and_then(|bytes| u32::try_from(bytes.len()).ok()),
        }
    }

    fn read(&self, id: &BlobId) -> Result<Bytes, SourceError> {
        let (asset, part) = match *id {
            BlobId::Asset { asset, part } => (asset, part),
            BlobId::Terrain(blob) => {
                return self.terrain.get(blob).cloned().ok_or(SourceError::NotFound(*id));
            }
        };
        let pack = self.packs.get(asset as usize).ok_or(SourceError::NotFound(*id))?;
        // A thread that panicked while it held the lock left the cache usable: entries are whole.
        let lock = || self.cache.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        if let Some(bytes) = lock().get(id) {
            return Ok(bytes);
        }
        // Read without the lock: two sessions may read the same blob, none waits for the disk of
        // another.
        let bytes = pack.read(part).map_err(|error| match error {
            StoreError::NoSuchBlob { .. } => SourceError::NotFound(*id),
            other => SourceError::Unreadable { id: *id, why: other.to_string() },
        })?;
        lock().insert(*id, bytes.clone());
        Ok(bytes)
    }
}
