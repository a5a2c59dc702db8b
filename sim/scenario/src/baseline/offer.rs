//! What a technique offers: an asset in pieces, and the error that remains with some of them.

use lodestream_geometry::index::Sphere;
use lodestream_scene::BlobId;
use lodestream_scene::asset::AssetDescription;
use lodestream_scene::description::{AssetEntry, Camera, Instance};

/// One downloadable piece of an asset.
#[derive(Clone, Debug, PartialEq)]
pub struct Piece {
    /// Length of its body.
    pub bytes: u64,
    /// Error of what is drawn while none of its children has arrived, in the asset's units. A piece without children
    /// counts as exact: the technique has nothing finer.
    pub error: f32,
    /// Bounding sphere, relative to the origin of the asset's grid.
    pub sphere: Sphere,
    /// Pieces that it depends on; they come before it in the list.
    pub parents: Vec<u32>,
    /// Whether it has geometry to draw; an index has none.
    pub draws: bool,
}

/// A texture in mip levels, coarse first.
#[derive(Clone, Debug, PartialEq)]
pub struct Texture {
    /// Texture coordinates per unit of the asset.
    pub uv_per_unit: f32,
    /// Of each level: length of the image file, and longer side in texels.
    pub levels: Vec<(u32, u32)>,
}

/// An asset as a technique offers it: pieces, parents first.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Offer {
    /// Pieces, parents first.
    pub pieces: Vec<Piece>,
}

impl Offer {
    /// Levels that replace each other, from lengths and errors, coarse to fine.
    #[must_use]
    pub fn chain(levels: &[(u64, f32)], sphere: Sphere) -> Self {
        let piece = |(i, &(bytes, error)): (u32, &(u64, f32))| Piece {
            bytes,
            error,
            sphere,
            parents: i.checked_sub(1).into_iter().collect(),
            draws: true,
        };
        Self { pieces: (0..).zip(levels).map(piece).collect() }
    }

    /// The pieces required to draw the whole asset: those with geometry that refine no other.
    pub fn roots(&self) -> impl Iterator<Item = u32> {
        (0_u32..).zip(&self.pieces).filter(|(_, piece)| self.is_root(piece)).map(|(number, _)| number)
    }

    /// Whether a piece has geometry and refines no other.
    #[must_use]
    pub fn is_root(&self, piece: &Piece) -> bool {
        let draws = |parent: &u32| self.pieces.get(*parent as usize).is_some_and(|p| p.draws);
        piece.draws && !piece.parents.iter().any(draws)
    }

    /// Total length of all bodies.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        self.pieces.iter().map(|piece| piece.bytes).sum()
    }
}

/// The scene that a viewer draws: instances of assets.
#[derive(Clone, Debug, PartialEq)]
pub struct Stage {
    /// The start view.
    pub camera: Camera,
    /// Assets.
    pub assets: Vec<AssetEntry>,
    /// Textures, by asset.
    pub textures: Vec<Vec<Texture>>,
    /// Instances.
    pub instances: Vec<Instance>,
}

impl Texture {
    /// The textures of an asset. A level that is cut has the bytes of all of its tiles.
    #[must_use]
    pub fn of(description: &AssetDescription) -> Vec<Self> {
        let texture = |info: &lodestream_scene::asset::TextureInfo| {
            let level = |(number, level): (usize, &lodestream_scene::asset::TextureLevel)| {
                (level.bytes.saturating_mul(info.images(number)), level.width.max(level.height))
            };
            Self {
                uv_per_unit: info.uv_per_unit,
                levels: info.levels.iter().enumerate().map(level).collect(),
            }
        };
        description.textures.iter().map(texture).collect()
    }
}

/// A downloadable item.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Item {
    /// A piece of an asset.
    Piece {
        /// The asset.
        asset: u32,
        /// The piece.
        piece: u32,
    },
    /// A level of a texture.
    Texture(BlobId),
}
