//! Why a received blob cannot be used.

use lodestream_geometry::DecodeError;
use lodestream_scene::encoding::CodingError;
use lodestream_select::PageError;

use crate::core::animated_models::AnimationBlobError;
use crate::core::asset::AssetError;
use crate::core::height_overrides::HeightOverrideBlobError;
use crate::core::parts::PartBlobError;
use crate::core::punctual_light_pages::PunctualLightBlobError;
use crate::core::texture_file::TextureFileError;

/// A received blob that cannot be used: it is damaged, incomplete, or does not fit the scene.
#[derive(Debug, thiserror::Error)]
pub(super) enum BlobError {
    #[error("it is empty")]
    Empty,
    #[error("only a part of it has arrived")]
    Partial,
    #[error("the scene has no such asset")]
    UnknownAsset,
    #[error("the asset has no such chunk, or its base mesh has not arrived")]
    UnknownChunk,
    #[error("no asset has such a texture")]
    UnknownTexture,
    #[error("{got_bytes} bytes have arrived, but the index says {needed_bytes}")]
    Length { got_bytes: usize, needed_bytes: usize },
    #[error(transparent)]
    Index(#[from] DecodeError),
    #[error(transparent)]
    Page(#[from] PageError),
    #[error(transparent)]
    Asset(#[from] AssetError),
    #[error(transparent)]
    Texture(#[from] TextureFileError),
    #[error("its texture regions name a material or a cell that it has not")]
    TextureRegions,
    #[error(transparent)]
    Coding(#[from] CodingError),
    #[error(transparent)]
    HeightOverrides(#[from] HeightOverrideBlobError),
    #[error(transparent)]
    PunctualLights(#[from] PunctualLightBlobError),
    #[error(transparent)]
    Parts(#[from] PartBlobError),
    #[error(transparent)]
    Animation(#[from] AnimationBlobError),
}
