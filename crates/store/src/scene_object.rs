//! The published scene of a store: its description, and what it holds of each pack. Servers with the same object and
//! packs serve the same bytes.

use bytes::Bytes;
use lodestream_scene::encoding::{self, CodingError};
use lodestream_scene::limits::MAX_MESSAGE_BYTES;
use lodestream_scene::published::{Contents, MAX_OBJECT_BYTES, PackContents, PublishedError};

use crate::{PartBlobs, PunctualLightBlobs, SceneDescription, TerrainBlobs};

/// Longest scene object, in bytes.
pub const MAX_SCENE_OBJECT_BYTES: u64 = MAX_OBJECT_BYTES;

/// A published scene.
#[derive(Clone, Debug)]
pub struct SceneObject {
    /// The scene.
    pub description: SceneDescription,
    /// Packs, by asset number.
    pub packs: Vec<PackContents>,
}

/// Why bytes are not a scene's object, or a scene cannot be one.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum SceneObjectError {
    /// Its layout.
    #[error(transparent)]
    Published(#[from] PublishedError),
    /// A header or page that no message can carry.
    #[error("its header or page {page}: {why}")]
    TooLong {
        /// Number of the page; 0 for the header too.
        page: usize,
        /// Why.
        why: CodingError,
    },
    /// Pages of lights that contradict their number.
    #[error("its punctual lights are not as many as it states")]
    PunctualLights,
    /// Another fingerprint than that of its description.
    #[error("its fingerprint does not match its description")]
    Fingerprint,
}

impl SceneObject {
    /// Encodes the object. Equal scenes have equal bytes.
    ///
    /// # Errors
    /// A scene longer than [`MAX_SCENE_OBJECT_BYTES`], or one whose header or page is longer than a message.
    pub fn encode(&self) -> Result<Vec<u8>, SceneObjectError> {
        let SceneDescription { header, pages, asset_order: _, terrain, punctual_lights, parts, animations } =
            &self.description;
        check_lengths(&self.description)?;
        let (terrain_directory, height_overrides) = terrain.parts();
        let (light_directory, light_pages) = punctual_lights.parts();
        let (part_directory, part_pages) = parts.parts();
        let contents = Contents {
            header: header.clone(),
            pages: pages.clone(),
            terrain_directory: terrain_directory.to_vec(),
            height_overrides: height_overrides.to_vec(),
            punctual_lights: punctual_lights.punctual_lights().cloned(),
            light_directory: light_directory.to_vec(),
            light_pages: light_pages.to_vec(),
            parts: parts.table(),
            part_directory: part_directory.to_vec(),
            part_pages: part_pages.to_vec(),
            animations: animations.clone(),
            packs: self.packs.clone(),
        };
        Ok(contents.encode()?)
    }

    /// Decodes and checks an object. Reserves no more than its bytes justify.
    ///
    /// # Errors
    /// Bytes that are not a scene object, of another version, damaged, or contradictory.
    pub fn decode(bytes: &Bytes) -> Result<Self, SceneObjectError> {
        let contents = Contents::decode(bytes)?;
        let count = contents.punctual_lights.as_ref().map_or(0, |lights| lights.count);
        let punctual_lights =
            PunctualLightBlobs::of_parts(count, contents.light_directory, contents.light_pages)
                .filter(|blobs| blobs.punctual_lights() == contents.punctual_lights.as_ref())
                .ok_or(SceneObjectError::PunctualLights)?;
        let description = SceneDescription {
            header: contents.header,
            pages: contents.pages,
            asset_order: (0..contents.packs.len()).collect(),
            terrain: TerrainBlobs::of_parts(contents.terrain_directory, contents.height_overrides),
            punctual_lights,
            parts: PartBlobs::of_parts(contents.parts, contents.part_directory, contents.part_pages),
            animations: contents.animations,
        };
        check_lengths(&description)?;
        if !description.has_stated_fingerprint() {
            return Err(SceneObjectError::Fingerprint);
        }
        Ok(Self { description, packs: contents.packs })
    }
}

/// Checks that messages can carry header and pages.
fn check_lengths(description: &SceneDescription) -> Result<(), SceneObjectError> {
    let checked = |page, encoded: Result<Vec<u8>, CodingError>| match encoded {
        Ok(bytes) if bytes.len() <= MAX_MESSAGE_BYTES => Ok(()),
        Ok(bytes) => {
            let why = CodingError::TooLong { bytes: bytes.len(), limit: MAX_MESSAGE_BYTES };
            Err(SceneObjectError::TooLong { page, why })
        }
        Err(why) => Err(SceneObjectError::TooLong { page, why }),
    };
    checked(0, encoding::encode(&description.header))?;
    (0..).zip(&description.pages).try_for_each(|(number, page)| checked(number, encoding::encode(page)))
}
