//! Model files to [`SourceMesh`] and materials.
//!
//! OBJ and MTL, parsed by the crate `tobj` behind a pass of our own (`normalise`) that checks every
//! line and reports its number: tobj 4 lets NaN and infinities through, makes up texture
//! coordinates for corners that have none, takes polylines for faces, overflows on some negative
//! indices and panics on a colour of one value.

mod error;
#[cfg(test)]
mod extremes;
mod mtl;
mod normalise;
mod obj;
#[cfg(test)]
mod tests;
mod triangulate;

use std::path::{Path, PathBuf};

use lodestream_geometry::mesh::SourceMesh;

pub use error::ImportError;
pub use obj::{dependencies, import};

/// Largest model file, in bytes; it is read whole.
pub const MAX_FILE_BYTES: u64 = 4 << 30;

/// A surface description, as far as OBJ's MTL gives one.
#[derive(Clone, Debug, PartialEq)]
pub struct Material {
    /// Name in the MTL file.
    pub name: String,
    /// Base colour, sRGB-encoded as MTL editors write it, in `0..=1` (`Kd`).
    pub base_color: [f32; 3],
    /// Opacity in `0..=1` (`d`).
    pub opacity: f32,
    /// Perceptual roughness in `0..=1` (from `Ns`).
    pub roughness: f32,
    /// Colour texture (`map_Kd`).
    pub color_texture: Option<PathBuf>,
    /// Height texture (`map_Bump`, `bump` or `disp`).
    pub height_texture: Option<PathBuf>,
    /// Factor on the heights (`-bm`); 1 where not given.
    pub height_scale: f32,
}

impl Default for Material {
    fn default() -> Self {
        Self {
            name: "default".to_owned(),
            base_color: [0.8; 3],
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

/// Reads a regular file whole.
///
/// # Errors
/// Missing and unreadable files, anything but a regular file, and files above `limit` bytes.
pub(crate) fn read_file(path: &Path, limit: u64) -> Result<Vec<u8>, ImportError> {
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
