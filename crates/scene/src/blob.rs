//! Names of the blobs that travel from server to client.

use bincode::de::Decoder;
use bincode::enc::Encoder;
use bincode::error::{DecodeError, EncodeError};
use bincode::{Decode, Encode};

/// Which part of an asset a blob holds.
///
/// The order of the variants is the order in which a client can use them: nothing can be drawn
/// without the base mesh, no chunk asked for without its index page.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Encode, Decode)]
pub enum BlobPart {
    /// The base mesh with grids and description.
    Base,
    /// A page of the chunk index, `geometry::index::CHUNKS_PER_PAGE` chunks.
    IndexPage(u32),
    /// The vertex splits of one chunk.
    Chunk(u32),
    /// One level of a texture or height map; level 0 is the coarsest.
    Texture {
        /// Index into [`crate::asset::AssetDescription::textures`].
        texture: u16,
        /// Index into [`crate::asset::TextureInfo::levels`].
        level: u8,
    },
}

/// Which part of a scene's terrain a blob holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum TerrainBlob {
    /// A page of the directory of patches with listed points ([`crate::terrain::decode_directory`]).
    DirectoryPage(u32),
    /// The listed points of the directory's patch of this number.
    Points(u32),
}

/// Which part of a scene's punctual lights a blob holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum PunctualLightBlob {
    /// A page of the directory of pages ([`crate::punctual_lights::decode_directory`]).
    DirectoryPage(u32),
    /// A page of punctual lights ([`crate::punctual_lights::decode_page`]).
    Page(u32),
}

/// Name of one blob within a scene.
///
/// Two to eleven bytes on the wire: the asset's number, then the part. A terrain's blobs are written as if they were of
/// asset 2³² − 1, which no scene has: a page of its directory as an index page, points as a chunk. So are those of
/// punctual lights, of asset 2³² − 2: a page of their directory as an index page, a page of punctual lights as a chunk.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum BlobId {
    /// Part of an asset.
    Asset {
        /// Number of the asset: the index of its entry, counted over all scene pages in order.
        asset: u32,
        /// Part of the asset.
        part: BlobPart,
    },
    /// Part of the scene's terrain.
    Terrain(TerrainBlob),
    /// Part of the scene's punctual lights.
    PunctualLights(PunctualLightBlob),
}

/// What stands on the wire where an asset's number would, in names of a terrain's blobs.
const TERRAIN: u32 = u32::MAX;
/// The same in names of punctual lights' blobs.
const PUNCTUAL_LIGHTS: u32 = u32::MAX - 1;

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

    /// A page of the terrain's directory of patches with listed points.
    #[must_use]
    pub const fn terrain_page(page: u32) -> Self {
        Self::Terrain(TerrainBlob::DirectoryPage(page))
    }

    /// The listed points of the `patch`-th patch of the terrain's directory.
    #[must_use]
    pub const fn terrain_points(patch: u32) -> Self {
        Self::Terrain(TerrainBlob::Points(patch))
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

    /// The asset that the blob is a part of, if any.
    #[must_use]
    pub const fn asset(&self) -> Option<u32> {
        match *self {
            Self::Asset { asset, .. } => Some(asset),
            Self::Terrain(_) | Self::PunctualLights(_) => None,
        }
    }

    /// Which part of an asset it is, if of one.
    #[must_use]
    pub const fn part(&self) -> Option<BlobPart> {
        match *self {
            Self::Asset { part, .. } => Some(part),
            Self::Terrain(_) | Self::PunctualLights(_) => None,
        }
    }
}

impl Encode for BlobId {
    fn encode<E: Encoder>(&self, e: &mut E) -> Result<(), EncodeError> {
        let (number, part) = match *self {
            Self::Asset { asset: TERRAIN | PUNCTUAL_LIGHTS, .. } => {
                return Err(EncodeError::Other("no asset has the number 2^32 - 1 or 2^32 - 2"));
            }
            Self::Asset { asset, part } => (asset, part),
            Self::Terrain(TerrainBlob::DirectoryPage(page)) => (TERRAIN, BlobPart::IndexPage(page)),
            Self::Terrain(TerrainBlob::Points(patch)) => (TERRAIN, BlobPart::Chunk(patch)),
            Self::PunctualLights(PunctualLightBlob::DirectoryPage(page)) => {
                (PUNCTUAL_LIGHTS, BlobPart::IndexPage(page))
            }
            Self::PunctualLights(PunctualLightBlob::Page(page)) => (PUNCTUAL_LIGHTS, BlobPart::Chunk(page)),
        };
        number.encode(e)?;
        part.encode(e)
    }
}

impl<Context> Decode<Context> for BlobId {
    fn decode<D: Decoder<Context = Context>>(d: &mut D) -> Result<Self, DecodeError> {
        match (u32::decode(d)?, BlobPart::decode(d)?) {
            (TERRAIN, BlobPart::IndexPage(page)) => Ok(Self::terrain_page(page)),
            (TERRAIN, BlobPart::Chunk(patch)) => Ok(Self::terrain_points(patch)),
            (TERRAIN, _) => Err(DecodeError::Other("a terrain has neither base mesh nor textures")),
            (PUNCTUAL_LIGHTS, BlobPart::IndexPage(page)) => Ok(Self::punctual_light_directory(page)),
            (PUNCTUAL_LIGHTS, BlobPart::Chunk(page)) => Ok(Self::punctual_light_page(page)),
            (PUNCTUAL_LIGHTS, _) => {
                Err(DecodeError::Other("punctual lights have neither base mesh nor textures"))
            }
            (asset, part) => Ok(Self::Asset { asset, part }),
        }
    }
}

bincode::impl_borrow_decode!(BlobId);

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
            },
            Self::Terrain(TerrainBlob::DirectoryPage(page)) => write!(f, "terrain directory page {page}"),
            Self::Terrain(TerrainBlob::Points(patch)) => write!(f, "terrain points of patch {patch}"),
            Self::PunctualLights(PunctualLightBlob::DirectoryPage(page)) => {
                write!(f, "punctual light directory page {page}")
            }
            Self::PunctualLights(PunctualLightBlob::Page(page)) => write!(f, "punctual light page {page}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn encoded(value: &impl Encode) -> Vec<u8> {
        bincode::encode_to_vec(value, bincode::config::standard()).unwrap()
    }

    fn decoded(bytes: &[u8]) -> Result<BlobId, DecodeError> {
        Ok(bincode::decode_from_slice(bytes, bincode::config::standard())?.0)
    }

    #[test]
    fn names_are_a_number_and_a_part_on_the_wire() {
        for (id, number, part) in [
            (BlobId::base(0), 0, BlobPart::Base),
            (BlobId::chunk(7, 300), 7, BlobPart::Chunk(300)),
            (BlobId::texture(70_000, 3, 2), 70_000, BlobPart::Texture { texture: 3, level: 2 }),
            (BlobId::terrain_page(1), u32::MAX, BlobPart::IndexPage(1)),
            (BlobId::terrain_points(2000), u32::MAX, BlobPart::Chunk(2000)),
            (BlobId::punctual_light_directory(3), u32::MAX - 1, BlobPart::IndexPage(3)),
            (BlobId::punctual_light_page(4000), u32::MAX - 1, BlobPart::Chunk(4000)),
        ] {
            let bytes = encoded(&id);
            assert_eq!(bytes, encoded(&(number, part)), "{id}");
            assert_eq!(decoded(&bytes).unwrap(), id);
        }
    }

    #[test]
    fn names_of_what_cannot_be_are_refused() {
        for part in [BlobPart::Base, BlobPart::Texture { texture: 0, level: 0 }] {
            for whose in [u32::MAX, u32::MAX - 1] {
                assert!(decoded(&encoded(&(whose, part))).is_err());
            }
        }
        for whose in [u32::MAX, u32::MAX - 1] {
            assert!(bincode::encode_to_vec(BlobId::chunk(whose, 0), bincode::config::standard()).is_err());
        }
    }

    #[test]
    fn blobs_of_terrain_and_punctual_lights_come_after_all_assets_pages_of_directories_first() {
        let order = [
            BlobId::base(0),
            BlobId::chunk(0, 9),
            BlobId::base(1),
            BlobId::terrain_page(7),
            BlobId::terrain_points(0),
            BlobId::punctual_light_directory(9),
            BlobId::punctual_light_page(0),
        ];
        assert!(order.is_sorted());
    }
}
