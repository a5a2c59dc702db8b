//! Errors of importing model files. A message is one line: fault, place and remedy.

use std::path::{Path, PathBuf};

/// A model file that cannot be imported.
#[derive(Debug, thiserror::Error)]
pub enum ImportError {
    /// The file cannot be read.
    #[error("{}: cannot be read: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// A folder, a device or a pipe.
    #[error("{}: is not a regular file; give the path of an OBJ, glTF, PLY or STL file", path.display())]
    NotAFile {
        /// The path.
        path: PathBuf,
    },
    /// The file has no bytes.
    #[error("{}: is empty; give an OBJ, glTF, PLY or STL file with faces", path.display())]
    Empty {
        /// The file.
        path: PathBuf,
    },
    /// The file is larger than supported.
    #[error("{}: has {bytes} bytes; at most {limit} are supported, so split it into several assets", path.display())]
    TooLarge {
        /// The file.
        path: PathBuf,
        /// Its size.
        bytes: u64,
        /// The largest size supported.
        limit: u64,
    },
    /// The file needs more memory than there is.
    #[error(
        "{}: takes at least {:.1} GB of memory to read, {:.1} GB are free: end other programs, or prepare it with \
         lodestream-server prepare --out-of-core DIR", path.display(), *needed as f64 * 1e-9, *free as f64 * 1e-9
    )]
    NoMemory {
        /// The file.
        path: PathBuf,
        /// Bytes of memory that it takes, at least.
        needed: u64,
        /// Bytes that are free.
        free: u64,
    },
    /// An invalid line.
    #[error("{}:{line}: {what}", path.display())]
    Line {
        /// The file.
        path: PathBuf,
        /// Line, from 1.
        line: usize,
        /// What is wrong, and what was expected.
        what: String,
    },
    /// An error in a glTF file.
    #[error("{}: {what}", path.display())]
    Gltf {
        /// The file.
        path: PathBuf,
        /// The object, what is wrong with it, and the remedy.
        what: String,
    },
    /// An error in a PLY file that belongs to no line.
    #[error("{}: {what}", path.display())]
    Ply {
        /// The file.
        path: PathBuf,
        /// The element or byte, what is wrong with it, and the remedy.
        what: String,
    },
    /// An error in an STL file that belongs to no line.
    #[error("{}: {what}", path.display())]
    Stl {
        /// The file.
        path: PathBuf,
        /// What is wrong with it, and the remedy.
        what: String,
    },
    /// A model without faces.
    #[error("{}: has no faces ({found}); export it as a polygon mesh", path.display())]
    NoFaces {
        /// The file.
        path: PathBuf,
        /// What the file has instead.
        found: String,
    },
    /// More materials than a face can name.
    #[error("{}: uses {count} materials; at most {limit} are supported", path.display())]
    TooManyMaterials {
        /// The file.
        path: PathBuf,
        /// How many.
        count: usize,
        /// How many are supported.
        limit: usize,
    },
}

impl ImportError {
    pub(super) fn line(path: &Path, line: usize, what: impl Into<String>) -> Self {
        Self::Line { path: path.to_owned(), line, what: what.into() }
    }

    pub(super) fn ply(path: &Path, what: impl Into<String>) -> Self {
        Self::Ply { path: path.to_owned(), what: what.into() }
    }

    pub(super) fn stl(path: &Path, what: impl Into<String>) -> Self {
        Self::Stl { path: path.to_owned(), what: what.into() }
    }

    pub(super) fn gltf(path: &Path, what: impl Into<String>) -> Self {
        Self::Gltf { path: path.to_owned(), what: what.into() }
    }
}
