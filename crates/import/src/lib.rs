//! Importers: model files (OBJ with MTL, glTF 2.0 and GLB, PLY, STL) to a
//! [`SourceMesh`](lodestream_geometry::mesh::SourceMesh) and materials, image files to mip levels, terrain features and
//! height maps.
//!
//! MTL files are parsed by the crate `tobj`, behind a pass of our own that drops lines on which tobj 4 fails or panics,
//! with a warning. OBJ files are parsed here (`obj/parse.rs` says why).

mod beside;
mod content;
mod error;
#[cfg(test)]
mod extremes;
mod file;
pub mod gltf;
mod import;
mod meshopt;
mod model;
mod model_file;
mod obj;
mod ply;
pub mod setting;
mod shading;
pub mod srgb;
mod stl;
pub mod terrain;
#[cfg(test)]
mod tests;
mod text;
pub mod texture;
mod triangulate;
mod weld;

pub use content::Content;
pub use error::ImportError;
pub use file::{MAX_FILE_BYTES, is_gltf, is_ply, is_stl, is_streamed, read_file};
pub use import::{dependencies, import, import_part, import_smooth};
pub use model::{
    BatchMember, Channel, Component, HeightMap, ImageSource, Imported, ImportedMaterial, MaterialMaps, Part,
    SurfaceMap,
};
pub use model_file::ModelFile;
pub use setting::InvalidValue;
pub use shading::CreaseAngle;
