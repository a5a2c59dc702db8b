//! What a server must know of a scene besides its packs.

use lodestream_scene::description::{Fingerprint, SceneHeader, ScenePage};

use crate::{PunctualLightBlobs, TerrainBlobs};

/// A scene description.
#[derive(Clone, Debug)]
pub struct SceneDescription {
    /// What holds for the whole scene.
    pub header: SceneHeader,
    /// Pages in the order in which they are sent.
    pub pages: Vec<ScenePage>,
    /// For each asset number of the description, the index into the assets from which the scene was composed. Assets that are
    /// placed nowhere have no number.
    pub asset_order: Vec<usize>,
    /// Blobs of the scene's terrain.
    pub terrain: TerrainBlobs,
    /// What is said of the scene's punctual lights, and their blobs.
    pub punctual_lights: PunctualLightBlobs,
}

impl SceneDescription {
    /// The name of the contents: equal descriptions over equal packs get equal fingerprints. A BLAKE3 hash over the
    /// header without its own fingerprint and the pages, encoded as in messages (docs/protocol.md), and over the blobs
    /// that are in no pack, each with its length before it.
    #[must_use]
    pub fn fingerprint(&self) -> Fingerprint {
        let bare = SceneHeader { fingerprint: Fingerprint::default(), ..self.header.clone() };
        let mut hasher = blake3::Hasher::new();
        let mut add = |bytes: &[u8]| {
            hasher.update(&(bytes.len() as u64).to_le_bytes());
            hasher.update(bytes);
        };
        // What cannot be encoded is refused by `check`, before it is hashed.
        add(&bincode::encode_to_vec(&bare, bincode::config::standard()).unwrap_or_default());
        for page in &self.pages {
            add(&bincode::encode_to_vec(page, bincode::config::standard()).unwrap_or_default());
        }
        for blob in self.terrain.all().chain(self.punctual_lights.all()) {
            add(blob);
        }
        let mut fingerprint = Fingerprint::default();
        hasher.finalize_xof().fill(&mut fingerprint);
        fingerprint
    }

    /// Whether the header's fingerprint is that of all this.
    pub(crate) fn is_whole(&self) -> bool {
        self.fingerprint() == self.header.fingerprint
    }
}
