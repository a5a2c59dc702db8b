//! Names of the blobs that travel from server to client.

use crate::encoding::{CodingError, Decode, Encode, Reader, Writer};

/// A part of an asset that is sent as one blob.
///
/// The order of the variants is the order in which a client can use them: it draws nothing without the base mesh and
/// requests no chunk without its index page.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum BlobPart {
    /// The base mesh with grids and description.
    Base,
    /// A page of the chunk index, `geometry::index::CHUNKS_PER_PAGE` chunks.
    IndexPage(u32),
    /// The vertex splits of one chunk.
    Chunk(u32),
    /// One level of a texture or height map that is one image; level 0 is the coarsest.
    Texture {
        /// Index into [`crate::asset::AssetDescription::textures`].
        texture: u16,
        /// Index into [`crate::asset::TextureInfo::levels`].
        level: u8,
    },
    /// Where the asset's surface is in its textures ([`crate::asset::TextureRegions`]).
    TextureRegions,
    /// One tile of a level of a texture that is cut ([`crate::asset::is_tiled`]).
    Tile(Tile),
}

/// A tile of a texture.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Tile {
    /// Index into [`crate::asset::AssetDescription::textures`].
    pub texture: u16,
    /// Index into [`crate::asset::TextureInfo::levels`].
    pub level: u8,
    /// Number of the tile in the level, row by row.
    pub tile: u16,
}

impl BlobPart {
    /// The texture of which it is an image.
    #[must_use]
    pub const fn texture(&self) -> Option<u16> {
        match *self {
            Self::Texture { texture, .. } | Self::Tile(Tile { texture, .. }) => Some(texture),
            Self::Base | Self::IndexPage(_) | Self::Chunk(_) | Self::TextureRegions => None,
        }
    }

    /// The same image of another texture.
    #[must_use]
    pub const fn with_texture(self, of: u16) -> Self {
        match self {
            Self::Texture { level, .. } => Self::Texture { texture: of, level },
            Self::Tile(tile) => Self::Tile(Tile { texture: of, ..tile }),
            Self::Base | Self::IndexPage(_) | Self::Chunk(_) | Self::TextureRegions => self,
        }
    }
}

/// A part of a scene's terrain that is sent as one blob.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum TerrainBlob {
    /// A page of the directory of patches with height overrides ([`crate::terrain::decode_directory`]).
    DirectoryPage(u32),
    /// The height overrides of one patch, by its index in the directory.
    HeightOverrides(u32),
}

/// A part of a scene's punctual lights that is sent as one blob.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum PunctualLightBlob {
    /// A page of the directory of pages ([`crate::punctual_lights::decode_directory`]).
    DirectoryPage(u32),
    /// A page of punctual lights ([`crate::punctual_lights::decode_page`]).
    Page(u32),
}

/// A part of the table of a scene's parts that is sent as one blob.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum PartBlob {
    /// A page of the directory of records ([`crate::parts::decode_directory`]).
    DirectoryPage(u32),
    /// A page of records ([`crate::parts::decode_record`]).
    Page(u32),
}

/// Name of one blob within a scene.
///
/// Two to fourteen bytes on the wire: a number, then the kind. The number is the asset's index where the kind is a part
/// of an asset, and the index of the page, patch or model for terrain, punctual lights, parts and animations.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum BlobId {
    /// Part of an asset.
    Asset {
        /// The asset: index of its entry, counted over all scene pages in order.
        asset: u32,
        /// Part of the asset.
        part: BlobPart,
    },
    /// Part of the scene's terrain.
    Terrain(TerrainBlob),
    /// Part of the scene's punctual lights.
    PunctualLights(PunctualLightBlob),
    /// What the scene's parts are called.
    Parts(PartBlob),
    /// An animated model ([`crate::animation::AnimatedModel`]), by its number.
    Animation(u32),
}

/// Numbers of the kinds of blobs, the second field of a [`BlobId`] on the wire.
mod kind {
    pub(super) const BASE: u32 = 0;
    pub(super) const INDEX_PAGE: u32 = 1;
    pub(super) const CHUNK: u32 = 2;
    pub(super) const TEXTURE: u32 = 3;
    pub(super) const TERRAIN_DIRECTORY_PAGE: u32 = 4;
    pub(super) const HEIGHT_OVERRIDES: u32 = 5;
    pub(super) const PUNCTUAL_LIGHT_DIRECTORY_PAGE: u32 = 6;
    pub(super) const PUNCTUAL_LIGHT_PAGE: u32 = 7;
    pub(super) const PART_DIRECTORY_PAGE: u32 = 8;
    pub(super) const PART_PAGE: u32 = 9;
    pub(super) const TEXTURE_REGIONS: u32 = 10;
    pub(super) const TILE: u32 = 11;
    pub(super) const ANIMATION: u32 = 12;
}

impl BlobId {
    /// The base mesh of an asset.
    #[must_use]
    pub const fn base(asset: u32) -> Self {
        Self::Asset { asset, part: BlobPart::Base }
    }

    /// A page of an asset's chunk index.
    #[must_use]
    pub const fn index_page(asset: u32, page: u32) -> Self {
        Self::Asset { asset, part: BlobPart::IndexPage(page) }
    }

    /// A chunk of an asset.
    #[must_use]
    pub const fn chunk(asset: u32, chunk: u32) -> Self {
        Self::Asset { asset, part: BlobPart::Chunk(chunk) }
    }

    /// A level of an asset's texture.
    #[must_use]
    pub const fn texture(asset: u32, texture: u16, level: u8) -> Self {
        Self::Asset { asset, part: BlobPart::Texture { texture, level } }
    }

    /// The texture regions of an asset.
    #[must_use]
    pub const fn texture_regions(asset: u32) -> Self {
        Self::Asset { asset, part: BlobPart::TextureRegions }
    }

    /// A tile of an asset's texture.
    #[must_use]
    pub const fn tile(asset: u32, tile: Tile) -> Self {
        Self::Asset { asset, part: BlobPart::Tile(tile) }
    }

    /// A page of the terrain's directory of patches with height overrides.
    #[must_use]
    pub const fn terrain_page(page: u32) -> Self {
        Self::Terrain(TerrainBlob::DirectoryPage(page))
    }

    /// The height overrides of the `patch`-th patch of the terrain's directory.
    #[must_use]
    pub const fn height_overrides(patch: u32) -> Self {
        Self::Terrain(TerrainBlob::HeightOverrides(patch))
    }

    /// A page of the directory of the scene's punctual lights.
    #[must_use]
    pub const fn punctual_light_directory(page: u32) -> Self {
        Self::PunctualLights(PunctualLightBlob::DirectoryPage(page))
    }

    /// A page of the scene's punctual lights.
    #[must_use]
    pub const fn punctual_light_page(page: u32) -> Self {
        Self::PunctualLights(PunctualLightBlob::Page(page))
    }

    /// A page of the directory of the scene's parts.
    #[must_use]
    pub const fn part_directory(page: u32) -> Self {
        Self::Parts(PartBlob::DirectoryPage(page))
    }

    /// A page of records of the scene's parts.
    #[must_use]
    pub const fn part_page(page: u32) -> Self {
        Self::Parts(PartBlob::Page(page))
    }

    /// The asset that the blob is a part of; `None` for terrain, lights, parts and animations.
    #[must_use]
    pub const fn asset(&self) -> Option<u32> {
        match *self {
            Self::Asset { asset, .. } => Some(asset),
            Self::Terrain(_) | Self::PunctualLights(_) | Self::Parts(_) | Self::Animation(_) => None,
        }
    }

    /// The part of the asset that the blob is; `None` for terrain, lights, parts and animations.
    #[must_use]
    pub const fn part(&self) -> Option<BlobPart> {
        match *self {
            Self::Asset { part, .. } => Some(part),
            Self::Terrain(_) | Self::PunctualLights(_) | Self::Parts(_) | Self::Animation(_) => None,
        }
    }
}

impl Encode for BlobId {
    fn encode<W: Writer>(&self, writer: &mut W) -> Result<(), CodingError> {
        match *self {
            Self::Asset { asset, part } => match part {
                BlobPart::Base => (asset, kind::BASE).encode(writer),
                BlobPart::IndexPage(page) => (asset, kind::INDEX_PAGE, page).encode(writer),
                BlobPart::Chunk(chunk) => (asset, kind::CHUNK, chunk).encode(writer),
                BlobPart::Texture { texture, level } => (asset, kind::TEXTURE, texture, level).encode(writer),
                BlobPart::TextureRegions => (asset, kind::TEXTURE_REGIONS).encode(writer),
                BlobPart::Tile(Tile { texture, level, tile }) => {
                    (asset, kind::TILE, texture, level).encode(writer)?;
                    tile.encode(writer)
                }
            },
            Self::Terrain(TerrainBlob::DirectoryPage(page)) => {
                (page, kind::TERRAIN_DIRECTORY_PAGE).encode(writer)
            }
            Self::Terrain(TerrainBlob::HeightOverrides(patch)) => {
                (patch, kind::HEIGHT_OVERRIDES).encode(writer)
            }
            Self::PunctualLights(PunctualLightBlob::DirectoryPage(page)) => {
                (page, kind::PUNCTUAL_LIGHT_DIRECTORY_PAGE).encode(writer)
            }
            Self::PunctualLights(PunctualLightBlob::Page(page)) => {
                (page, kind::PUNCTUAL_LIGHT_PAGE).encode(writer)
            }
            Self::Parts(PartBlob::DirectoryPage(page)) => (page, kind::PART_DIRECTORY_PAGE).encode(writer),
            Self::Parts(PartBlob::Page(page)) => (page, kind::PART_PAGE).encode(writer),
            Self::Animation(model) => (model, kind::ANIMATION).encode(writer),
        }
    }
}

impl Decode for BlobId {
    fn decode<R: Reader>(reader: &mut R) -> Result<Self, CodingError> {
        let number = u32::decode(reader)?;
        Ok(match u32::decode(reader)? {
            kind::BASE => Self::base(number),
            kind::INDEX_PAGE => Self::index_page(number, u32::decode(reader)?),
            kind::CHUNK => Self::chunk(number, u32::decode(reader)?),
            kind::TEXTURE => Self::texture(number, u16::decode(reader)?, u8::decode(reader)?),
            kind::TERRAIN_DIRECTORY_PAGE => Self::terrain_page(number),
            kind::HEIGHT_OVERRIDES => Self::height_overrides(number),
            kind::PUNCTUAL_LIGHT_DIRECTORY_PAGE => Self::punctual_light_directory(number),
            kind::PUNCTUAL_LIGHT_PAGE => Self::punctual_light_page(number),
            kind::PART_DIRECTORY_PAGE => Self::part_directory(number),
            kind::PART_PAGE => Self::part_page(number),
            kind::ANIMATION => Self::Animation(number),
            kind::TEXTURE_REGIONS => Self::Asset { asset: number, part: BlobPart::TextureRegions },
            kind::TILE => {
                let (texture, level, tile) =
                    (u16::decode(reader)?, u8::decode(reader)?, u16::decode(reader)?);
                Self::tile(number, Tile { texture, level, tile })
            }
            _ => return Err(CodingError::UnknownVariant("BlobId")),
        })
    }
}

impl std::fmt::Display for BlobId {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match *self {
            Self::Asset { asset, part } => match part {
                BlobPart::Base => write!(f, "asset {asset} base"),
                BlobPart::IndexPage(page) => write!(f, "asset {asset} index page {page}"),
                BlobPart::Chunk(chunk) => write!(f, "asset {asset} chunk {chunk}"),
                BlobPart::Texture { texture, level } => {
                    write!(f, "asset {asset} texture {texture} level {level}")
                }
                BlobPart::TextureRegions => write!(f, "asset {asset} texture regions"),
                BlobPart::Tile(Tile { texture, level, tile }) => {
                    write!(f, "asset {asset} texture {texture} level {level} tile {tile}")
                }
            },
            Self::Terrain(TerrainBlob::DirectoryPage(page)) => write!(f, "terrain directory page {page}"),
            Self::Terrain(TerrainBlob::HeightOverrides(patch)) => {
                write!(f, "height overrides of terrain patch {patch}")
            }
            Self::PunctualLights(PunctualLightBlob::DirectoryPage(page)) => {
                write!(f, "punctual light directory page {page}")
            }
            Self::PunctualLights(PunctualLightBlob::Page(page)) => write!(f, "punctual light page {page}"),
            Self::Parts(PartBlob::DirectoryPage(page)) => write!(f, "part directory page {page}"),
            Self::Parts(PartBlob::Page(page)) => write!(f, "part page {page}"),
            Self::Animation(model) => write!(f, "animation {model}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::encoding;

    fn encoded(value: &impl Encode) -> Vec<u8> {
        encoding::encode(value).unwrap()
    }

    fn decoded(bytes: &[u8]) -> Result<BlobId, CodingError> {
        encoding::decode(bytes, 0)
    }

    #[test]
    fn ids_are_a_number_and_a_kind_on_the_wire() {
        for (id, bytes) in [
            (BlobId::base(0), &[0, 0][..]),
            (BlobId::index_page(5, 6), &[5, 1, 6]),
            (BlobId::chunk(7, 300), &[7, 2, 251, 44, 1]),
            (BlobId::texture(70_000, 3, 2), &[252, 112, 17, 1, 0, 3, 3, 2]),
            (BlobId::base(u32::MAX), &[252, 255, 255, 255, 255, 0]),
            (BlobId::terrain_page(1), &[1, 4]),
            (BlobId::height_overrides(2000), &[251, 208, 7, 5]),
            (BlobId::punctual_light_directory(3), &[3, 6]),
            (BlobId::punctual_light_page(4000), &[251, 160, 15, 7]),
            (BlobId::part_directory(5), &[5, 8]),
            (BlobId::part_page(300), &[251, 44, 1, 9]),
            (BlobId::Animation(5), &[5, 12]),
            (BlobId::texture_regions(6), &[6, 10]),
            (BlobId::tile(7, Tile { texture: 3, level: 11, tile: 300 }), &[7, 11, 3, 11, 251, 44, 1]),
        ] {
            assert_eq!(encoded(&id), bytes, "{id}");
            assert_eq!(decoded(bytes).unwrap(), id);
        }
    }

    #[test]
    fn unknown_kinds_are_refused() {
        for kind in [13, 250] {
            assert!(decoded(&[0, kind, 0, 0]).is_err());
        }
    }

    #[test]
    fn terrain_lights_and_parts_sort_after_assets_and_directories_first() {
        let order = [
            BlobId::base(0),
            BlobId::chunk(0, 9),
            BlobId::base(1),
            BlobId::terrain_page(7),
            BlobId::height_overrides(0),
            BlobId::punctual_light_directory(9),
            BlobId::punctual_light_page(0),
            BlobId::part_directory(9),
            BlobId::part_page(0),
            BlobId::Animation(0),
        ];
        assert!(order.is_sorted());
    }
}
