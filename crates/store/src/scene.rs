//! A scene with its packs, shared by sessions.

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, OnceLock};

use bytes::Bytes;
use futures_util::{StreamExt as _, TryStreamExt as _};
use lodestream_compress::decode_base;
use lodestream_geometry::refine::ActiveMesh;
use lodestream_protocol::source::{BlobFuture, CacheUse, Reading, SceneSource, SourceError};
use lodestream_scene::animation::AnimationTable;
use lodestream_scene::description::{SceneHeader, ScenePage};
use lodestream_scene::parts::PartTable;
use lodestream_scene::published::pack_name;
use lodestream_scene::punctual_lights::PunctualLights;
use lodestream_scene::{BlobId, BlobPart};
use lodestream_select::Occluder;
use tokio::runtime::Handle;

use super::cache::BlobCache;
use super::error::StoreError;
use super::file::PackFile;
use super::object_pack::ObjectPack;
use super::objects::Objects;
use super::pack::Pack;
use super::scene_object::{MAX_SCENE_OBJECT_BYTES, SceneObject};
use crate::{PartBlobs, PunctualLightBlobs, SceneDescription, TerrainBlobs};

/// Default memory for blobs of all scenes: the whole demo scene fits; large scenes rely on the system's page cache.
pub const DEFAULT_CACHE_BYTES: u64 = 256 << 20;

/// Packs that are opened at once.
const OPENED_AT_ONCE: usize = 16;

/// Longest base mesh that is decoded as an occluder, in bytes: some milliseconds, once, on the calling thread.
const MAX_OCCLUDER_BYTES: usize = 64 << 10;

/// A scene over opened packs.
#[derive(Debug)]
pub struct SceneStore {
    header: SceneHeader,
    pages: Vec<Arc<ScenePage>>,
    /// By asset number.
    packs: Vec<Pack>,
    /// Occluders by asset number, made on first use.
    occluders: Vec<OnceLock<Option<Arc<Occluder>>>>,
    terrain: TerrainBlobs,
    punctual_lights: PunctualLightBlobs,
    parts: PartBlobs,
    animations: Vec<Bytes>,
    cache: BlobCache,
    /// Runtime for blocking reads from object stores.
    runtime: Option<Handle>,
    hits: AtomicU64,
    misses: AtomicU64,
}

impl SceneStore {
    /// A scene from its description and packs by asset number, with blobs in a cache that other scenes may share.
    ///
    /// # Errors
    /// Packs whose base mesh is damaged.
    pub fn new(
        description: SceneDescription,
        packs: Vec<PackFile>,
        cache: &BlobCache,
    ) -> Result<Self, StoreError> {
        let packs = packs.into_iter().map(|pack| Pack::File(Arc::new(pack))).collect();
        let store = Self::of(description, packs, cache);
        store.read_bases()?;
        Ok(store)
    }

    /// Opens a published scene: reads the object of this name and the table of each pack.
    ///
    /// # Errors
    /// A store that does not answer, a scene or a pack that is not there, damaged, or another one.
    pub async fn open(objects: &Objects, name: &str, cache: &BlobCache) -> Result<Self, StoreError> {
        let bytes = objects.whole(name, MAX_SCENE_OBJECT_BYTES).await?;
        let wrong = |what| StoreError::Scene { path: objects.path(name), what };
        let SceneObject { description, packs } = SceneObject::decode(&bytes).map_err(wrong)?;
        let entries = description.pages.iter().flat_map(|page| &page.assets);
        let names: Vec<_> = packs
            .iter()
            .zip(entries)
            .map(|(pack, entry)| (pack_name(&pack.key), entry.fingerprint))
            .collect();
        drop((bytes, packs));
        let opened = names.into_iter().map(|(name, fingerprint)| {
            let (objects, cache) = (objects.clone(), cache.clone());
            async move { ObjectPack::open(&objects, &name, fingerprint, &cache).await }
        });
        let opened: Vec<ObjectPack> =
            futures_util::stream::iter(opened).buffered(OPENED_AT_ONCE).try_collect().await?;
        let packs = opened.into_iter().map(|pack| Pack::Object(Arc::new(pack))).collect();
        Ok(Self { runtime: Some(Handle::current()), ..Self::of(description, packs, cache) })
    }

    fn of(description: SceneDescription, packs: Vec<Pack>, cache: &BlobCache) -> Self {
        let SceneDescription { header, pages, asset_order: _, terrain, punctual_lights, parts, animations } =
            description;
        Self {
            header,
            pages: pages.into_iter().map(Arc::new).collect(),
            occluders: packs.iter().map(|_| OnceLock::new()).collect(),
            packs,
            terrain,
            punctual_lights,
            parts,
            animations,
            cache: cache.clone(),
            runtime: None,
            hits: AtomicU64::new(0),
            misses: AtomicU64::new(0),
        }
    }

    /// Reads base meshes into the cache until it is full, so that first flights do not wait for the disk.
    fn read_bases(&self) -> Result<(), StoreError> {
        let mut room = self.cache.room();
        for pack in &self.packs {
            let Pack::File(file) = pack else { continue };
            let Some(key) = pack.key(BlobPart::Base) else { continue };
            let bytes = file.read(BlobPart::Base)?;
            let Some(left) = room.checked_sub(bytes.len() as u64) else { break };
            room = left;
            self.cache.insert(key, bytes);
        }
        Ok(())
    }

    /// A blob of the terrain, the lights, the names of parts or animations, which no pack holds.
    fn own(&self, id: &BlobId) -> Option<&Bytes> {
        match *id {
            BlobId::Asset { .. } => None,
            BlobId::Terrain(blob) => self.terrain.get(blob),
            BlobId::PunctualLights(blob) => self.punctual_lights.get(blob),
            BlobId::Parts(blob) => self.parts.get(blob),
            BlobId::Animation(model) => self.animations.get(model as usize),
        }
    }

    fn pack(&self, id: &BlobId) -> Option<(&Pack, BlobPart)> {
        let BlobId::Asset { asset, part } = *id else { return None };
        Some((self.packs.get(asset as usize)?, part))
    }
}

/// Converts an error of a blob to the one that sessions see.
fn source_error(id: BlobId, error: &StoreError) -> SourceError {
    match error {
        StoreError::NoSuchBlob { .. } => SourceError::NotFound(id),
        other => SourceError::Unreadable { id, why: other.to_string() },
    }
}

impl SceneSource for SceneStore {
    fn header(&self) -> &SceneHeader {
        &self.header
    }

    fn page(&self, page: u32) -> Option<Arc<ScenePage>> {
        self.pages.get(page as usize).cloned()
    }

    fn punctual_lights(&self) -> Option<&PunctualLights> {
        self.punctual_lights.punctual_lights()
    }

    fn parts(&self) -> Option<PartTable> {
        self.parts.table()
    }

    fn animations(&self) -> Option<AnimationTable> {
        let models = u32::try_from(self.animations.len()).ok().filter(|models| *models > 0)?;
        Some(AnimationTable { models })
    }

    fn blob_len(&self, id: &BlobId) -> Option<u32> {
        match *id {
            BlobId::Asset { .. } => self.pack(id).and_then(|(pack, part)| pack.blob_len(part)),
            BlobId::Terrain(_) | BlobId::PunctualLights(_) | BlobId::Parts(_) | BlobId::Animation(_) => {
                u32::try_from(self.own(id)?.len()).ok()
            }
        }
    }

    fn occluder(&self, asset: u32) -> Option<Arc<Occluder>> {
        let slot = self.occluders.get(asset as usize)?;
        if let Some(known) = slot.get() {
            return known.clone();
        }
        // A base mesh that is not in memory is not read now; a later call may find it.
        let base = self.packs.get(asset as usize)?.cached(BlobPart::Base, &self.cache)?;
        let decoded = (base.len() <= MAX_OCCLUDER_BYTES).then(|| decode_base(&base)).and_then(Result::ok);
        let occluder = decoded.map(|base| {
            let (positions, faces) = ActiveMesh::growing(&base).surface();
            Arc::new(Occluder::new(positions, faces))
        });
        slot.get_or_init(|| occluder).clone()
    }

    fn try_read(&self, id: &BlobId) -> Result<Reading, SourceError> {
        match id {
            BlobId::Terrain(_) | BlobId::PunctualLights(_) | BlobId::Parts(_) | BlobId::Animation(_) => {
                self.read(id).map(Reading::Ready)
            }
            _ if self.blob_len(id).is_none() => Err(SourceError::NotFound(*id)),
            BlobId::Asset { .. } => {
                let found = self.pack(id).and_then(|(pack, part)| pack.cached(part, &self.cache));
                // The later `read` looks it up again, but only this counts.
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

    fn fetch(&self, id: &BlobId) -> Option<BlobFuture> {
        let ((pack, part), id) = (self.pack(id)?, *id);
        let (pack, cache) = (pack.clone(), self.cache.clone());
        Some(Box::pin(async move { pack.fetch(part, &cache).await.map_err(|why| source_error(id, &why)) }))
    }

    fn read(&self, id: &BlobId) -> Result<Bytes, SourceError> {
        let Some((pack, part)) = self.pack(id) else {
            return self.own(id).cloned().ok_or(SourceError::NotFound(*id));
        };
        if let Some(bytes) = pack.cached(part, &self.cache) {
            return Ok(bytes);
        }
        match (pack, &self.runtime) {
            // Not coordinated: two sessions may read the same blob.
            (Pack::File(file), _) => {
                let bytes = file.read(part).map_err(|why| source_error(*id, &why))?;
                if let Some(key) = pack.key(part) {
                    self.cache.insert(key, bytes.clone());
                }
                Ok(bytes)
            }
            (Pack::Object(object), Some(runtime)) => {
                runtime.block_on(object.fetch(part, &self.cache)).map_err(|why| source_error(*id, &why))
            }
            (Pack::Object(_), None) => Err(SourceError::NotFound(*id)),
        }
    }
}
