//! Model files to [`SourceMesh`] and materials (OBJ with MTL, glTF 2.0 and GLB), their textures to mip levels, and
//! terrain from files.
//!
//! OBJ and MTL are parsed by the crate `tobj` behind a pass of our own (`normalise`) that checks every
//! line and reports its number: tobj 4 lets NaN and infinities through, makes up texture
//! coordinates for corners that have none, takes polylines for faces, overflows on some negative
//! indices and panics on a colour of one value.

mod error;
#[cfg(test)]
mod extremes;
pub mod gltf;
mod obj;
pub mod terrain;
#[cfg(test)]
mod tests;
pub mod texture;

use std::path::{Path, PathBuf};

use bytes::Bytes;
use lodestream_geometry::mesh::SourceMesh;

pub use error::ImportError;

/// Largest model file, in bytes; it is read whole.
pub const MAX_FILE_BYTES: u64 = 4 << 30;

/// What is meant of a model file.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Part {
    /// Everything as one mesh; of a glTF file, every mesh of its scene in its place.
    #[default]
    Whole,
    /// One mesh of a glTF file.
    Mesh {
        /// Its index in the file.
        mesh: usize,
        /// Columns of a linear map that is applied to it.
        linear: [[f64; 3]; 3],
    },
}

/// An image that a material uses: a file, or bytes of a model file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ImageSource {
    /// The file; where `bytes` are given, a name for messages.
    pub path: PathBuf,
    /// The bytes of a PNG or JPEG file, where they were in the model.
    pub bytes: Option<Bytes>,
}

impl From<PathBuf> for ImageSource {
    fn from(path: PathBuf) -> Self {
        Self { path, bytes: None }
    }
}

/// A surface description.
#[derive(Clone, Debug, PartialEq)]
pub struct Material {
    /// Name in the file.
    pub name: String,
    /// Base colour, linear, in `0..=1` (`Kd`, which editors write sRGB-encoded; glTF's factor).
    pub base_color: [f32; 3],
    /// Opacity in `0..=1` (`d`).
    pub opacity: f32,
    /// Perceptual roughness in `0..=1` (from `Ns`).
    pub roughness: f32,
    /// Colour texture (`map_Kd`; `baseColorTexture`).
    pub color_texture: Option<ImageSource>,
    /// Height texture (`map_Bump`, `bump` or `disp`; glTF has none).
    pub height_texture: Option<ImageSource>,
    /// Factor on the heights (`-bm`); 1 where not given.
    pub height_scale: f32,
}

impl Default for Material {
    fn default() -> Self {
        Self {
            name: "default".to_owned(),
            base_color: [crate::texture::srgb_to_linear(0.8); 3],
            opacity: 1.0,
            roughness: 0.6,
            color_texture: None,
            height_texture: None,
            height_scale: 1.0,
        }
    }
}

/// An imported model.
#[derive(Clone, Debug)]
pub struct Imported {
    /// The mesh; its `materials` index [`Imported::materials`].
    pub mesh: SourceMesh,
    /// Materials that at least one face uses.
    pub materials: Vec<Material>,
    /// What was odd but could be worked around, a line each.
    pub warnings: Vec<String>,
}

/// Imports a model file whole, with what it names beside it.
///
/// # Errors
/// Whatever makes the geometry unusable, and where; see [`ImportError`].
pub fn import(path: &Path) -> Result<Imported, ImportError> {
    import_part(path, &Part::Whole)
}

/// Imports a part of a model file.
///
/// # Errors
/// As [`import`].
pub fn import_part(path: &Path, part: &Part) -> Result<Imported, ImportError> {
    match part {
        Part::Whole if !is_gltf(path) => obj::import(path),
        _ => gltf::import(path, part),
    }
}

/// Whether a file's name says that it is glTF.
#[must_use]
pub fn is_gltf(path: &Path) -> bool {
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case("gltf") || e.eq_ignore_ascii_case("glb"))
}

/// The files that are read beside a model file of the given content, each once, whether they exist or not.
#[must_use]
pub fn dependencies(path: &Path, bytes: &[u8]) -> Vec<PathBuf> {
    if is_gltf(path) { gltf::dependencies(path, bytes) } else { obj::dependencies(path, bytes) }
}

/// Reads a regular file whole.
///
/// # Errors
/// Missing and unreadable files, anything but a regular file, and files above `limit` bytes.
pub fn read_file(path: &Path, limit: u64) -> Result<Vec<u8>, ImportError> {
    let read = |source| ImportError::Read { path: path.to_owned(), source };
    let metadata = std::fs::metadata(path).map_err(read)?;
    if !metadata.is_file() {
        return Err(ImportError::NotAFile { path: path.to_owned() });
    }
    if metadata.len() > limit {
        return Err(ImportError::TooLarge { path: path.to_owned(), bytes: metadata.len(), limit });
    }
    std::fs::read(path).map_err(read)
}
