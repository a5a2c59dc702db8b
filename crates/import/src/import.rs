//! Entry points for all formats; the file's extension selects the reader.

use std::path::{Path, PathBuf};

use crate::error::ImportError;
use crate::file::{is_gltf, is_ply, is_stl};
use crate::model::{Imported, Part};
use crate::shading::{CreaseAngle, Unshaded};
use crate::{gltf, obj, ply, stl};

/// Imports a whole model file with the files that it names.
///
/// # Errors
/// Unusable geometry, with its place; see [`ImportError`].
pub fn import(path: &Path) -> Result<Imported, ImportError> {
    import_part(path, &Part::Whole, CreaseAngle::default())
}

/// As [`import`], with all faces without normals as smooth surfaces. Codecs and simplification are measured so, as other
/// programs' are, which get positions alone.
///
/// # Errors
/// As there.
pub fn import_smooth(path: &Path) -> Result<Imported, ImportError> {
    import_part(path, &Part::Whole, CreaseAngle::SMOOTH)
}

/// Imports a part of a model file.
///
/// # Errors
/// As [`import`].
pub fn import_part(path: &Path, part: &Part, crease: CreaseAngle) -> Result<Imported, ImportError> {
    read_part(path, part).map(|read| read.shade(crease))
}

fn read_part(path: &Path, part: &Part) -> Result<Unshaded, ImportError> {
    match part {
        Part::Whole if is_ply(path) => ply::import(path),
        Part::Whole if is_stl(path) => stl::import(path),
        Part::Whole if !is_gltf(path) => obj::import(path),
        _ => gltf::import(path, part),
    }
}

/// The files that a model file of the given content refers to, each once, whether they exist or not.
#[must_use]
pub fn dependencies(path: &Path, bytes: &[u8]) -> Vec<PathBuf> {
    match path {
        _ if is_gltf(path) => gltf::dependencies(path, bytes),
        _ if is_ply(path) => ply::dependencies(path, bytes),
        // It names no other files.
        _ if is_stl(path) => Vec::new(),
        _ => obj::dependencies(path, bytes),
    }
}

/// As [`dependencies`], of the file at a path, which is of a format that is streamed.
pub(crate) fn streamed_dependencies(path: &Path) -> Vec<PathBuf> {
    if is_ply(path) { ply::dependencies_of_file(path) } else { Vec::new() }
}
