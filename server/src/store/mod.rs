//! Packs on disk: opened read-only, every blob checked against its hash when it is read.

mod asset;
mod file;
mod lru;
mod scene;
mod terrain;
#[cfg(test)]
mod tests;

use std::path::PathBuf;

use lodestream_geometry::DecodeError;

use crate::scene::ComposeError;

pub use asset::LoadedAsset;
pub use file::PackFile;
pub use scene::{DEFAULT_CACHE_BYTES, SceneStore};
pub use terrain::{TerrainBlobs, TerrainBlobsError};

/// A pack, or one of its blobs, that cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum StoreError {
    /// The file cannot be read.
    #[error("{}: cannot be read: {source}", path.display())]
    Read {
        /// The pack.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// A folder, a device or a pipe.
    #[error("{}: is not a regular file; give the path of a pack (.lsp)", path.display())]
    NotAFile {
        /// The path.
        path: PathBuf,
    },
    /// The file is not a pack, of another version, or damaged.
    #[error("{}: {source}", path.display())]
    Format {
        /// The pack.
        path: PathBuf,
        /// What is wrong.
        source: DecodeError,
    },
    /// There is no such blob in the pack.
    #[error("{}: has no {what}", path.display())]
    NoSuchBlob {
        /// The pack.
        path: PathBuf,
        /// The blob.
        what: String,
    },
    /// The scene over the packs cannot be described.
    #[error(transparent)]
    Compose(#[from] ComposeError),
}
