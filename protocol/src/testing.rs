//! Synthetic assets and scenes, and a store in memory, for tests.

use std::sync::Arc;

use bytes::Bytes;
use lodestream_geometry::index::{ChunkInfo, encode_pages};

use crate::source::{Reading, SceneSource, SourceError};
use lodestream_scene::blob::{BlobId, BlobPart};
use lodestream_scene::description::{Camera, Instance, SceneHeader, SceneLighting, ScenePage};
use lodestream_scene::proxy::Proxy;
use lodestream_select::Occluder;
use lodestream_select::testing::{plane, plane_entry};

/// A store in memory whose blobs have distinct contents.
pub(crate) struct MemoryScene {
    pub(crate) header: SceneHeader,
    pub(crate) pages: Vec<Arc<ScenePage>>,
    pub(crate) chunks: Vec<Vec<ChunkInfo>>,
    /// Real index pages, per asset.
    index: Vec<Vec<Bytes>>,
    /// Levels of the one texture that each asset has, none if 0.
    pub(crate) texture_levels: u8,
    /// Occluder of every asset.
    pub(crate) occluder: Option<Arc<Occluder>>,
}

impl MemoryScene {
    /// 32 planes behind each other; a root, four children, and four of each.
    pub(crate) fn with_proxies() -> Arc<Self> {
        let mut scene = Self::new(32, 1, 2);
        let of = |parent: u32, first_instance, instance_count, child_count, error| Proxy {
            asset: first_instance / 8,
            parent,
            first_instance,
            instance_count,
            child_count,
            error,
        };
        let root = of(0, 0, 32, 4, 4.0);
        let children = (0..4).map(|n| of(1, 8 * n, 8, 4, 1.0));
        let leaves = (0..16).map(|n| of(2 + n / 4, 2 * n, 2, 0, 0.25));
        let pages = &mut Arc::get_mut(&mut scene).unwrap().pages;
        // Their assets stand in the first page for simplicity: those of the first planes.
        let assets = pages[0].assets.len() as u32;
        let fits = |proxy: Proxy| Proxy { asset: proxy.asset.min(assets - 1), ..proxy };
        Arc::get_mut(&mut pages[0]).unwrap().proxies =
            [root].into_iter().chain(children).chain(leaves).map(fits).collect();
        scene
    }

    /// `assets` planes of the given depth in a row along −z, each with `instances` instances side by side.
    pub(crate) fn new(assets: u32, instances: u32, levels: u8) -> Arc<Self> {
        let chunks: Vec<_> = (0..assets).map(|_| plane(levels)).collect();
        let mut entries = Vec::new();
        for asset in 0..assets {
            let entry = plane_entry(&format!("plane {asset}"), &chunks[asset as usize], 900 + 100 * asset);
            for i in 0..instances {
                let x = (f64::from(i) - f64::from(instances) / 2.0 + 0.5) * 3.0;
                let at = Instance::at(asset, [x, 0.0, -3.0 * f64::from(asset)]);
                entries.push((Some(entry.clone()).filter(|_| i == 0), at));
            }
        }
        let mut pages = Vec::new();
        let (mut first_asset, mut first_instance) = (0, 0);
        for group in entries.chunks(8) {
            let page = ScenePage {
                page: pages.len() as u32,
                first_asset,
                first_instance,
                assets: group.iter().filter_map(|(entry, _)| entry.clone()).collect(),
                instances: group.iter().map(|(_, at)| *at).collect(),
                ..ScenePage::default()
            };
            first_asset += page.assets.len() as u32;
            first_instance += page.instances.len() as u32;
            page.check().unwrap();
            pages.push(Arc::new(page));
        }
        let header = SceneHeader {
            name: "planes".into(),
            fingerprint: [3; 16],
            asset_count: first_asset,
            instance_count: first_instance,
            page_count: pages.len() as u32,
            light: SceneLighting { direction: [0.0, 1.0, 0.0], color: [1.0; 3], ambient: [0.1; 3] },
            background: [0.0; 3],
            terrain: None,
            camera: Camera { eye: [0.0, 1.0, 4.0], target: [0.0, 0.0, 0.0], up: [0.0, 1.0, 0.0], fov_y: 0.9 },
            root_slope: 0.0,
        };
        header.check().unwrap();
        let index = chunks.iter().map(|infos| index_pages(infos)).collect();
        Arc::new(Self { header, pages, chunks, index, texture_levels: 0, occluder: None })
    }
}

impl SceneSource for MemoryScene {
    fn header(&self) -> &SceneHeader {
        &self.header
    }

    fn page(&self, page: u32) -> Option<Arc<ScenePage>> {
        self.pages.get(page as usize).cloned()
    }

    fn blob_len(&self, id: &BlobId) -> Option<u32> {
        let BlobId::Asset { asset, part } = *id else { return None };
        let chunks = self.chunks.get(asset as usize)?;
        match part {
            BlobPart::Base => Some(900 + 100 * asset),
            BlobPart::IndexPage(page) => {
                self.index[asset as usize].get(page as usize).map(|bytes| bytes.len() as u32)
            }
            BlobPart::Chunk(chunk) => chunks.get(chunk as usize).map(|info| info.payload_bytes),
            BlobPart::Texture { texture: 0, level } if level < self.texture_levels => {
                Some(200 << u32::from(level))
            }
            BlobPart::Texture { .. } | BlobPart::TextureRegions | BlobPart::Tile(_) => None,
        }
    }

    fn occluder(&self, _asset: u32) -> Option<Arc<Occluder>> {
        self.occluder.clone()
    }

    fn read(&self, id: &BlobId) -> Result<Bytes, SourceError> {
        let length = self.blob_len(id).ok_or(SourceError::NotFound(*id))?;
        Ok(match *id {
            BlobId::Asset { asset, part: BlobPart::IndexPage(page) } => {
                self.index[asset as usize][page as usize].clone()
            }
            _ => contents(id, length),
        })
    }
}

/// A scene for which reads of some blobs are pending.
pub(crate) struct SlowScene {
    pub(crate) scene: Arc<MemoryScene>,
    pub(crate) is_slow: fn(&BlobId) -> bool,
}

impl SceneSource for SlowScene {
    fn header(&self) -> &SceneHeader {
        self.scene.header()
    }

    fn page(&self, page: u32) -> Option<Arc<ScenePage>> {
        self.scene.page(page)
    }

    fn blob_len(&self, id: &BlobId) -> Option<u32> {
        self.scene.blob_len(id)
    }

    fn read(&self, id: &BlobId) -> Result<Bytes, SourceError> {
        self.scene.read(id)
    }

    fn try_read(&self, id: &BlobId) -> Result<Reading, SourceError> {
        if (self.is_slow)(id) { Ok(Reading::Pending) } else { self.read(id).map(Reading::Ready) }
    }
}

fn index_pages(infos: &[ChunkInfo]) -> Vec<Bytes> {
    let (pages, _) = encode_pages(infos).unwrap();
    pages.into_iter().map(Bytes::from).collect()
}

/// Contents of a blob: bytes that depend on its id and on the offset.
pub(crate) fn contents(id: &BlobId, length: u32) -> Bytes {
    let seed = id.to_string().bytes().fold(17_u32, |h, b| h.wrapping_mul(31) ^ u32::from(b));
    (0..length).map(|i| (seed.wrapping_add(i).wrapping_mul(0x9E37_79B1) >> 24) as u8).collect()
}
