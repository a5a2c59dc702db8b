//! Reading of files: size limits and formats by extension.

use std::path::Path;

use crate::error::ImportError;

/// Largest model file, in bytes.
pub const MAX_FILE_BYTES: u64 = 4 << 30;

/// Whether a file's extension is one of glTF's.
#[must_use]
pub fn is_gltf(path: &Path) -> bool {
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case("gltf") || e.eq_ignore_ascii_case("glb"))
}

/// Whether a file's extension is PLY's.
#[must_use]
pub fn is_ply(path: &Path) -> bool {
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case("ply"))
}

/// Whether a file's extension is STL's.
#[must_use]
pub fn is_stl(path: &Path) -> bool {
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case("stl"))
}

/// Whether a file is of a format that is read from beginning to end and never kept whole in memory: PLY and STL.
#[must_use]
pub fn is_streamed(path: &Path) -> bool {
    is_ply(path) || is_stl(path)
}

/// Reads a whole regular file.
///
/// # Errors
/// Missing and unreadable files, anything but a regular file, and files above `limit` bytes.
pub fn read_file(path: &Path, limit: u64) -> Result<Vec<u8>, ImportError> {
    check_file(path, limit)?;
    std::fs::read(path).map_err(|source| ImportError::Read { path: path.to_owned(), source })
}

/// The length of a regular file that is not above `limit` bytes.
pub(crate) fn check_file(path: &Path, limit: u64) -> Result<u64, ImportError> {
    let read = |source| ImportError::Read { path: path.to_owned(), source };
    let metadata = std::fs::metadata(path).map_err(read)?;
    if !metadata.is_file() {
        return Err(ImportError::NotAFile { path: path.to_owned() });
    }
    if metadata.len() > limit {
        return Err(ImportError::TooLarge { path: path.to_owned(), bytes: metadata.len(), limit });
    }
    Ok(metadata.len())
}
