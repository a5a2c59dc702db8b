//! What can be wrong with a pack, in one line: what, where, what to do.

use std::path::PathBuf;

use lodestream_geometry::DecodeError;

use crate::compose::ComposeError;

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
    /// While it was not open, the file became another.
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
    /// The scene over the packs cannot be described.
    #[error(transparent)]
    Compose(#[from] ComposeError),
}
