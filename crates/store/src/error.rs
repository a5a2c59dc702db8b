//! Errors of packs and stores. A message is one line: fault, place and remedy.

use std::path::PathBuf;

use lodestream_geometry::DecodeError;

use super::scene_object::SceneObjectError;

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
    /// A missing object.
    #[error("{}: there is no such object", path.display())]
    NoSuchObject {
        /// The object.
        path: PathBuf,
    },
    /// The file cannot be written.
    #[error("{}: cannot be written: {source}", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// A URL that names no store.
    #[error("{url}: {why}")]
    Url {
        /// The URL, without credentials.
        url: String,
        /// What is wrong with it.
        why: String,
    },
    /// An invalid scene object.
    #[error("{}: {what}; publish the scene again", path.display())]
    Scene {
        /// The object.
        path: PathBuf,
        /// What is wrong.
        what: SceneObjectError,
    },
    /// The scene was published with another pack.
    #[error("{}: is another pack than the scene was published with; publish the scene again", path.display())]
    OtherPack {
        /// The pack.
        path: PathBuf,
    },
    /// The file was replaced while it was closed.
    #[error("{}: is another pack than when it was opened; start the server again", path.display())]
    Replaced {
        /// The pack.
        path: PathBuf,
    },
    /// There is no such blob in the pack.
    #[error("{}: has no {what}", path.display())]
    NoSuchBlob {
        /// The pack.
        path: PathBuf,
        /// The blob.
        what: String,
    },
}
