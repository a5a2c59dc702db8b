//! A scene over opened packs: what the sessions of a server share.

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};

use bytes::Bytes;
use lodestream_compress::decode_base;
use lodestream_geometry::refine::ActiveMesh;
use lodestream_protocol::lamps::Lamps;
use lodestream_protocol::scene::{SceneHeader, ScenePage};
use lodestream_protocol::select::Occluder;
use lodestream_protocol::source::{CacheUse, Reading, SceneSource, SourceError};
use lodestream_protocol::{BlobId, BlobPart};

use super::error::StoreError;
use super::file::PackFile;
use super::lru::Lru;
use crate::compose::{Composed, LampBlobs, TerrainBlobs, compose};
use crate::scene::Scene;

/// Memory that a scene's blobs may take, by default: a demo scene fits whole, and a large one falls
/// back on the system's page cache.
pub const DEFAULT_CACHE_BYTES: u64 = 256 << 20;

/// Cost of a blob in memory beside its bytes, so that many tiny ones are bounded too.
const ENTRY_BYTES: u64 = 128;

/// Longest base mesh that is decoded to learn what it hides, in bytes: some milliseconds, once, on the thread that asks.
const MAX_OCCLUDER_BYTES: usize = 64 << 10;

/// See the module.
#[derive(Debug)]
pub struct SceneStore {
    header: SceneHeader,
    pages: Vec<Arc<ScenePage>>,
    /// By asset number.
    packs: Vec<PackFile>,
    /// By asset number: what hides other things, once somebody asked.
    occluders: Vec<OnceLock<Option<Arc<Occluder>>>>,
    terrain: TerrainBlobs,
    lamps: LampBlobs,
    cache: Mutex<Lru<BlobId, Bytes>>,
    hits: AtomicU64,
    misses: AtomicU64,
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
        let textures: Vec<_> = packs.iter().map(PackFile::textures).collect();
        let Composed { header, pages, asset_order, terrain, lamps } = compose(scene, &entries, &textures)?;
        let mut packs: Vec<Option<PackFile>> = packs.into_iter().map(Some).collect();
        let packs: Vec<PackFile> =
            asset_order.iter().filter_map(|&i| packs.get_mut(i).and_then(Option::take)).collect();
        let store = Self {
            header,
            pages: pages.into_iter().map(Arc::new).collect(),
            occluders: packs.iter().map(|_| OnceLock::new()).collect(),
            packs,
            terrain,
            lamps,
            cache: Mutex::new(Lru::new(cache_bytes)),
            hits: AtomicU64::new(0),
            misses: AtomicU64::new(0),
        };
        store.read_bases(cache_bytes)?;
        Ok(store)
    }

    /// Reads as many base meshes as there is room for: a first flight should wait for no disk.
    fn read_bases(&self, mut room: u64) -> Result<(), StoreError> {
        for (asset, pack) in (0..).zip(&self.packs) {
            let bytes = pack.read(BlobPart::Base)?;
            let Some(left) = room.checked_sub(bytes.len() as u64) else { break };
            room = left;
            self.keep(BlobId::base(asset), bytes);
        }
        Ok(())
    }

    fn keep(&self, id: BlobId, bytes: Bytes) {
        let cost = bytes.len() as u64 + ENTRY_BYTES;
        self.cache().insert(id, bytes, cost);
    }

    /// A blob that is in no pack, if there is such a one.
    fn own(&self, id: &BlobId) -> Option<&Bytes> {
        match *id {
            BlobId::Asset { .. } => None,
            BlobId::Terrain(blob) => self.terrain.get(blob),
            BlobId::Lamps(blob) => self.lamps.get(blob),
        }
    }

    fn cache(&self) -> MutexGuard<'_, Lru<BlobId, Bytes>> {
        // A thread that panicked while it held the lock left the cache usable: entries are whole.
        self.cache.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl SceneSource for SceneStore {
    fn header(&self) -> &SceneHeader {
        &self.header
    }

    fn page(&self, page: u32) -> Option<Arc<ScenePage>> {
        self.pages.get(page as usize).cloned()
    }

    fn lamps(&self) -> Option<&Lamps> {
        self.lamps.lamps()
    }

    fn blob_len(&self, id: &BlobId) -> Option<u32> {
        match *id {
            BlobId::Asset { asset, part } => self.packs.get(asset as usize)?.blob_len(part),
            BlobId::Terrain(_) | BlobId::Lamps(_) => u32::try_from(self.own(id)?.len()).ok(),
        }
    }

    fn occluder(&self, asset: u32) -> Option<Arc<Occluder>> {
        let slot = self.occluders.get(asset as usize)?;
        if let Some(known) = slot.get() {
            return known.clone();
        }
        let id = BlobId::base(asset);
        // Where it is not in memory, the disk is not waited for: later it may be.
        let base = self.cache().get(&id)?;
        let decoded = (base.len() <= MAX_OCCLUDER_BYTES).then(|| decode_base(&base)).and_then(Result::ok);
        let occluder = decoded.map(|base| {
            let (positions, faces) = ActiveMesh::growing(&base).surface();
            Arc::new(Occluder::new(positions, faces))
        });
        slot.get_or_init(|| occluder).clone()
    }

    fn try_read(&self, id: &BlobId) -> Result<Reading, SourceError> {
        match id {
            BlobId::Terrain(_) | BlobId::Lamps(_) => self.read(id).map(Reading::Ready),
            _ if self.blob_len(id).is_none() => Err(SourceError::NotFound(*id)),
            BlobId::Asset { .. } => {
                let found = self.cache().get(id);
                // What is read then is looked for again, and counted once.
                let count = if found.is_some() { &self.hits } else { &self.misses };
                count.fetch_add(1, Ordering::Relaxed);
                Ok(found.map_or(Reading::Pending, Reading::Ready))
            }
        }
    }

    fn cache_use(&self) -> Option<CacheUse> {
        let [hits, misses] = [&self.hits, &self.misses].map(|count| count.load(Ordering::Relaxed));
        Some(CacheUse { hits, misses })
    }

    fn read(&self, id: &BlobId) -> Result<Bytes, SourceError> {
        let BlobId::Asset { asset, part } = *id else {
            return self.own(id).cloned().ok_or(SourceError::NotFound(*id));
        };
        let pack = self.packs.get(asset as usize).ok_or(SourceError::NotFound(*id))?;
        if let Some(bytes) = self.cache().get(id) {
            return Ok(bytes);
        }
        // Read without the lock: two sessions may read the same blob, none waits for the disk of
        // another.
        let bytes = pack.read(part).map_err(|error| match error {
            StoreError::NoSuchBlob { .. } => SourceError::NotFound(*id),
            other => SourceError::Unreadable { id: *id, why: other.to_string() },
        })?;
        self.keep(*id, bytes.clone());
        Ok(bytes)
    }
}
