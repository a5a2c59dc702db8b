//! The scene description: everything that a server needs besides the packs.

use bytes::Bytes;
use lodestream_scene::description::{Fingerprint, SceneHeader, ScenePage};
use lodestream_scene::encoding;

use crate::{PartBlobs, PunctualLightBlobs, TerrainBlobs};

/// Header, pages and blobs of a scene.
#[derive(Clone, Debug)]
pub struct SceneDescription {
    /// Header of the scene.
    pub header: SceneHeader,
    /// Pages in the order in which they are sent.
    pub pages: Vec<ScenePage>,
    /// For each asset number of the description, the index into the assets from which the scene was composed. Assets
    /// without an instance have no number.
    pub asset_order: Vec<usize>,
    /// Blobs of the scene's terrain.
    pub terrain: TerrainBlobs,
    /// Punctual lights of the scene, and their blobs.
    pub punctual_lights: PunctualLightBlobs,
    /// What the scene's parts are called.
    pub parts: PartBlobs,
    /// Blobs of its animated models, by number.
    pub animations: Vec<Bytes>,
}

impl SceneDescription {
    /// Fingerprint of the contents: equal for equal descriptions over equal packs. A BLAKE3 hash over the header without
    /// its own fingerprint and the pages, encoded as docs/formats.md says, and over the blobs that are in no
    /// pack, each preceded by its length.
    #[must_use]
    pub fn fingerprint(&self) -> Fingerprint {
        let bare = SceneHeader { fingerprint: Fingerprint::default(), ..self.header.clone() };
        let mut hasher = blake3::Hasher::new();
        let mut add = |bytes: &[u8]| {
            hasher.update(&(bytes.len() as u64).to_le_bytes());
            hasher.update(bytes);
        };
        // `check` refuses what cannot be encoded before it is hashed.
        add(&encoding::encode(&bare).unwrap_or_default());
        for page in &self.pages {
            add(&encoding::encode(page).unwrap_or_default());
        }
        let beside = self.terrain.all().chain(self.punctual_lights.all()).chain(self.parts.all());
        for blob in beside.chain(&self.animations) {
            add(blob);
        }
        let mut fingerprint = Fingerprint::default();
        hasher.finalize_xof().fill(&mut fingerprint);
        fingerprint
    }

    /// Whether the header states the fingerprint of this description.
    pub(crate) fn has_stated_fingerprint(&self) -> bool {
        self.fingerprint() == self.header.fingerprint
    }
}
