//! What a published scene consists of, as its writer takes it and its reader gives it.

use bytes::Bytes;

use super::records::TexturePlace;
use super::tables::{ChunkTable, TileTable};
use crate::description::{SceneHeader, ScenePage};
use crate::parts::PartTable;
use crate::punctual_lights::PunctualLights;

/// A whole published scene.
#[derive(Clone, Debug, PartialEq)]
pub struct Contents {
    /// Header.
    pub header: SceneHeader,
    /// Scene pages, in order.
    pub pages: Vec<ScenePage>,
    /// Pages of the directory of height overrides.
    pub terrain_directory: Vec<Bytes>,
    /// Height overrides, in the directory's order.
    pub height_overrides: Vec<Bytes>,
    /// The message about punctual lights, if there are any.
    pub punctual_lights: Option<PunctualLights>,
    /// Pages of the directory of punctual lights.
    pub light_directory: Vec<Bytes>,
    /// Pages of punctual lights.
    pub light_pages: Vec<Bytes>,
    /// Number of records of the scene's parts, if it has a table of them.
    pub parts: Option<PartTable>,
    /// Pages of the directory of parts.
    pub part_directory: Vec<Bytes>,
    /// Pages of records of parts.
    pub part_pages: Vec<Bytes>,
    /// Animated models.
    pub animations: Vec<Bytes>,
    /// Packs, by asset number.
    pub packs: Vec<PackContents>,
}

/// What the published scene holds of a pack.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct PackContents {
    /// Key in the pack's name.
    pub key: [u8; 32],
    /// Length of the pack.
    pub bytes: u64,
    /// The base mesh.
    pub base: Bytes,
    /// Index pages.
    pub index: Vec<IndexPage>,
    /// Where the first level of a texture begins in the pack; the others follow.
    pub textures_offset: u64,
    /// Levels of textures, in the pack's order.
    pub textures: Vec<Texture>,
    /// Texture regions and tiles, if a level is cut.
    pub tiles: Option<Tiles>,
}

/// Texture regions, and where the tiles lie in the pack.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Tiles {
    /// The regions.
    pub regions: Bytes,
    /// The tiles.
    pub table: TileTable,
}

/// An index page, and where its chunks lie in the pack.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct IndexPage {
    /// The page.
    pub bytes: Bytes,
    /// Its chunks.
    pub chunks: ChunkTable,
}

/// A level of a texture.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Texture {
    /// Its number, length and hash.
    pub place: TexturePlace,
    /// Its bytes, if the published scene has a copy.
    pub copy: Option<Bytes>,
}
