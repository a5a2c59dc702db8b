//! A published scene as a plan's scene. It is read whole: in virtual time no disk and no web server may be waited for.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

use anyhow::Context as _;
use bytes::Bytes;
use lodestream_protocol::source::{SceneSource, SourceError};
use lodestream_scene::animation::AnimationTable;
use lodestream_scene::blob::{BlobId, BlobPart};
use lodestream_scene::description::{SceneHeader, ScenePage};
use lodestream_scene::parts::PartTable;
use lodestream_scene::punctual_lights::PunctualLights;
use lodestream_select::Occluder;
use lodestream_store::{BlobCache, DEFAULT_CACHE_BYTES, Objects, SceneStore};

/// Ending of the names of published scenes.
pub(crate) const ENDING: &str = ".lss";

struct PublishedScene {
    store: SceneStore,
    blobs: BTreeMap<BlobId, Bytes>,
}

/// Reads a published scene by path or URL (file, s3, gs, az, https), as `serve` takes it.
///
/// # Errors
/// A scene or pack that is not there, damaged or of another version, a store that does not answer.
pub(crate) fn open(place: &str) -> anyhow::Result<Arc<dyn SceneSource>> {
    // The caller's thread may have a runtime already, in which another cannot run.
    let read = || {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
        runtime.block_on(read(place))
    };
    let scene = std::thread::scope(|scope| scope.spawn(read).join());
    let scene = scene.map_err(|_| anyhow::anyhow!("reading {place} panicked"))?;
    Ok(Arc::new(scene.with_context(|| format!("{place} cannot be read"))?))
}

async fn read(place: &str) -> anyhow::Result<PublishedScene> {
    let (folder, name) = place.rsplit_once('/').unwrap_or((".", place));
    let objects = if Objects::is_url(Path::new(folder)) {
        Objects::of_url(folder)?
    } else {
        let folder = folder.strip_prefix("file:").unwrap_or(folder);
        Objects::of_folder(Path::new(if folder.is_empty() { "/" } else { folder }))?
    };
    let store = SceneStore::open(&objects, name, &BlobCache::new(DEFAULT_CACHE_BYTES)).await?;
    let mut blobs = BTreeMap::new();
    for id in listed(&store) {
        let bytes = match store.fetch(&id) {
            Some(reading) => reading.await,
            None => store.read(&id),
        };
        blobs.insert(id, bytes?);
    }
    Ok(PublishedScene { store, blobs })
}

/// The blobs of a scene.
fn listed(scene: &impl SceneSource) -> Vec<BlobId> {
    let exists = |id: &BlobId| scene.blob_len(id).is_some();
    let mut ids = Vec::new();
    for page in (0..scene.header().page_count).map_while(|page| scene.page(page)) {
        for (asset, entry) in (page.first_asset..).zip(&page.assets) {
            ids.push(BlobId::base(asset));
            let of = |part| BlobId::Asset { asset, part };
            ids.extend((0..entry.index_pages()).map(|page| of(BlobPart::IndexPage(page))));
            ids.extend((0..entry.chunk_count).map(|chunk| BlobId::chunk(asset, chunk)));
            for texture in (0..).take_while(|texture| exists(&BlobId::texture(asset, *texture, 0))) {
                ids.extend((0..).map(|level| BlobId::texture(asset, texture, level)).take_while(exists));
            }
        }
    }
    let of_scene: [fn(u32) -> BlobId; 7] = [
        BlobId::terrain_page,
        BlobId::height_overrides,
        BlobId::punctual_light_directory,
        BlobId::punctual_light_page,
        BlobId::part_directory,
        BlobId::part_page,
        BlobId::Animation,
    ];
    for id in of_scene {
        ids.extend((0..).map(id).take_while(exists));
    }
    ids
}

impl SceneSource for PublishedScene {
    fn header(&self) -> &SceneHeader {
        self.store.header()
    }

    fn page(&self, page: u32) -> Option<Arc<ScenePage>> {
        self.store.page(page)
    }

    fn punctual_lights(&self) -> Option<&PunctualLights> {
        self.store.punctual_lights()
    }

    fn parts(&self) -> Option<PartTable> {
        self.store.parts()
    }

    fn animations(&self) -> Option<AnimationTable> {
        self.store.animations()
    }

    fn blob_len(&self, id: &BlobId) -> Option<u32> {
        self.store.blob_len(id)
    }

    fn read(&self, id: &BlobId) -> Result<Bytes, SourceError> {
        self.blobs.get(id).cloned().map_or_else(|| self.store.read(id), Ok)
    }

    fn occluder(&self, asset: u32) -> Option<Arc<Occluder>> {
        self.store.occluder(asset)
    }
}
