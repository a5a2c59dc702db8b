//! Errors of an asset's description.

use std::path::PathBuf;

use lodestream_import::texture::TextureError;
use lodestream_scene::asset::{DescriptionError, MAX_TEXTURES};
use lodestream_scene::limits::MAX_BLOB_BYTES;

/// A description that cannot be made.
#[derive(Debug, thiserror::Error)]
pub enum DescribeError {
    /// A texture of absurd size, or one that cannot be encoded.
    #[error(transparent)]
    Texture(#[from] TextureError),
    /// More textures than the protocol numbers.
    #[error("the asset uses more than {MAX_TEXTURES} textures; split it")]
    TooManyTextures,
    /// A texture level longer than a blob may be.
    #[error("{}: a level of this texture takes {bytes} bytes, above {MAX_BLOB_BYTES}; scale it down", path.display())]
    LongLevel {
        /// The texture's file.
        path: PathBuf,
        /// Length of the level.
        bytes: usize,
    },
    /// Values that the protocol refuses.
    #[error("the asset cannot be described: {0}")]
    Refused(#[from] DescriptionError),
}
