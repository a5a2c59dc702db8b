//! Names of the blobs that travel from server to client.

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

/// Name of one blob within a scene. Two to eleven bytes on the wire.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Encode, Decode)]
pub struct BlobId {
    /// Number of the asset: the index of its entry, counted over all scene pages in order.
    pub asset: u32,
    /// Part of the asset.
    pub part: BlobPart,
}

impl BlobId {
    /// The base mesh of an asset.
    #[must_use]
    pub const fn base(asset: u32) -> Self {
        Self { asset, part: BlobPart::Base }
    }

    /// A page of an asset's chunk index.
    #[must_use]
    pub const fn index_page(asset: u32, page: u32) -> Self {
        Self { asset, part: BlobPart::IndexPage(page) }
    }

    /// A chunk of an asset.
    #[must_use]
    pub const fn chunk(asset: u32, chunk: u32) -> Self {
        Self { asset, part: BlobPart::Chunk(chunk) }
    }

    /// A level of an asset's texture.
    #[must_use]
    pub const fn texture(asset: u32, texture: u16, level: u8) -> Self {
        Self { asset, part: BlobPart::Texture { texture, level } }
    }
}

impl std::fmt::Display for BlobId {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self.part {
            BlobPart::Base => write!(f, "asset {} base", self.asset),
            BlobPart::IndexPage(page) => write!(f, "asset {} index page {page}", self.asset),
            BlobPart::Chunk(chunk) => write!(f, "asset {} chunk {chunk}", self.asset),
            BlobPart::Texture { texture, level } => {
                write!(f, "asset {} texture {texture} level {level}", self.asset)
            }
        }
    }
}
