//! A synthetic scene in memory, for tests and simulations of bytes and times, not shapes.

use std::sync::Arc;

use bytes::Bytes;
use lodestream_geometry::index::Sphere;
use lodestream_protocol::source::{SceneSource, SourceError};
use lodestream_scene::description::{AssetEntry, Camera, Instance, SceneHeader, SceneLighting, ScenePage};
use lodestream_scene::{BlobId, BlobPart};

/// Mip levels of each asset's only texture.
pub const TEXTURE_LEVELS: u8 = 8;

/// Assets in a row across the start view, each with one instance, a base mesh and one texture whose levels are blobs of
/// a given length. The blobs cannot be decoded; their bytes are derived from their names ([`MemoryScene::contents`]).
#[derive(Debug)]
pub struct MemoryScene {
    header: SceneHeader,
    page: Arc<ScenePage>,
    base_bytes: u32,
    texture_bytes: u32,
}

impl MemoryScene {
    /// A scene of at most 64 assets.
    #[must_use]
    pub fn new(assets: u32, base_bytes: u32, texture_bytes: u32) -> Self {
        Self::named("memory", assets, base_bytes, texture_bytes)
    }

    /// A scene with a name; the fingerprint covers the name and the sizes.
    #[must_use]
    pub fn named(name: &str, assets: u32, base_bytes: u32, texture_bytes: u32) -> Self {
        let assets = assets.min(64);
        let entries = (0..assets).map(|n| AssetEntry {
            name: format!("asset {n}"),
            fingerprint: [1; 16],
            origin: [0.0; 3],
            sphere: Sphere { center: [0.0; 3], radius: 0.5 },
            root_error: 0.01,
            base_bytes,
            chunk_count: 0,
            shared: Vec::new(),
        });
        let instances =
            (0..assets).map(|n| Instance::at(n, [f64::from(n) - f64::from(assets) / 2.0 + 0.5, 0.0, 0.0]));
        let page = ScenePage {
            page: 0,
            first_asset: 0,
            first_instance: 0,
            assets: entries.collect(),
            instances: instances.collect(),
            ..ScenePage::default()
        };
        let header = SceneHeader {
            name: name.into(),
            fingerprint: fingerprint(name, [assets, base_bytes, texture_bytes]),
            asset_count: assets,
            instance_count: assets,
            page_count: 1,
            light: SceneLighting { direction: [0.0, 1.0, 0.0], color: [1.0; 3], ambient: [0.1; 3] },
            background: [0.0; 3],
            terrain: None,
            camera: Camera {
                eye: [0.0, 0.0, f64::from(assets) + 2.0],
                target: [0.0; 3],
                up: [0.0, 1.0, 0.0],
                fov_y: 1.0,
            },
            root_slope: 0.0,
        };
        Self { header, page: Arc::new(page), base_bytes, texture_bytes }
    }

    /// The bytes of a blob of `length` bytes.
    #[must_use]
    pub fn contents(id: &BlobId, length: u32) -> Bytes {
        let seed = id.to_string().bytes().fold(17_u32, |h, b| h.wrapping_mul(31) ^ u32::from(b));
        (0..length).map(|i| seed.wrapping_add(i).wrapping_mul(0x9E37_79B1).to_be_bytes()[0]).collect()
    }
}

fn fingerprint(name: &str, numbers: [u32; 3]) -> [u8; 16] {
    let mut hasher = blake3::Hasher::new();
    for number in numbers {
        hasher.update(&number.to_le_bytes());
    }
    let hash = hasher.update(name.as_bytes()).finalize();
    let mut fingerprint = [0; 16];
    fingerprint.copy_from_slice(&hash.as_bytes()[..16]);
    fingerprint
}

impl SceneSource for MemoryScene {
    fn header(&self) -> &SceneHeader {
        &self.header
    }

    fn page(&self, page: u32) -> Option<Arc<ScenePage>> {
        (page == 0).then(|| Arc::clone(&self.page))
    }

    fn blob_len(&self, id: &BlobId) -> Option<u32> {
        let BlobId::Asset { asset, part } = *id else { return None };
        let known = asset < self.header.asset_count;
        match part {
            BlobPart::Base if known => Some(self.base_bytes),
            BlobPart::Texture { texture: 0, level } if known && level < TEXTURE_LEVELS => {
                Some(self.texture_bytes)
            }
            _ => None,
        }
    }

    fn read(&self, id: &BlobId) -> Result<Bytes, SourceError> {
        let length = self.blob_len(id).ok_or(SourceError::NotFound(*id))?;
        Ok(Self::contents(id, length))
    }
}
