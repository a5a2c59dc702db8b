//! What a model file holds: a mesh, and the materials of its faces.

use std::path::PathBuf;

use bytes::Bytes;
use lodestream_geometry::mesh::SourceMesh;

use crate::srgb::srgb_to_linear;

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
            base_color: [srgb_to_linear(0.8); 3],
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
