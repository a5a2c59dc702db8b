//! What can be wrong with a model file, in one line: what, where, what to do.

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
    #[error("{}: is not a regular file; give the path of an OBJ, glTF or PLY file", path.display())]
    NotAFile {
        /// The path.
        path: PathBuf,
    },
    /// The file has no bytes.
    #[error("{}: is empty; give an OBJ, glTF or PLY file with faces", path.display())]
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
    /// One line is wrong.
    #[error("{}:{line}: {what}", path.display())]
    Line {
        /// The file.
        path: PathBuf,
        /// Line, from 1.
        line: usize,
        /// What is wrong, and what was expected.
        what: String,
    },
    /// Something in a glTF file is wrong.
    #[error("{}: {what}", path.display())]
    Gltf {
        /// The file.
        path: PathBuf,
        /// Which of its objects, what is wrong with it, and what to do.
        what: String,
    },
    /// Something in a PLY file is wrong that stands in no line.
    #[error("{}: {what}", path.display())]
    Ply {
        /// The file.
        path: PathBuf,
        /// Which of its elements or bytes, what is wrong with it, and what to do.
        what: String,
    },
    /// Nothing to draw.
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
    /// The parser refuses what the checks before it let through.
    #[error("{}: {source}", path.display())]
    Parser {
        /// The file.
        path: PathBuf,
        /// The parser's own word.
        source: tobj::LoadError,
    },
}

impl ImportError {
    pub(super) fn line(path: &Path, line: usize, what: impl Into<String>) -> Self {
        Self::Line { path: path.to_owned(), line, what: what.into() }
    }

    pub(super) fn ply(path: &Path, what: impl Into<String>) -> Self {
        Self::Ply { path: path.to_owned(), what: what.into() }
    }

    pub(super) fn gltf(path: &Path, what: impl Into<String>) -> Self {
        Self::Gltf { path: path.to_owned(), what: what.into() }
    }
}
