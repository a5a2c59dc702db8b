//! Importers: model files (OBJ with MTL, glTF 2.0 and GLB, PLY) to a
//! [`SourceMesh`](lodestream_geometry::mesh::SourceMesh) and materials, image files to mip levels, terrain features and
//! height maps.
//!
//! OBJ and MTL are parsed by the crate `tobj` behind a pass of our own (`normalise`) that checks every
//! line and reports its number: tobj 4 lets NaN and infinities through, makes up texture
//! coordinates for corners that have none, takes polylines for faces, overflows on some negative
//! indices and panics on a colour of one value.

mod error;
#[cfg(test)]
mod extremes;
mod file;
pub mod gltf;
mod import;
mod meshopt;
mod model;
mod obj;
mod ply;
pub mod setting;
pub mod srgb;
pub mod terrain;
#[cfg(test)]
mod tests;
pub mod texture;
mod triangulate;
mod weld;

pub use error::ImportError;
pub use file::{MAX_FILE_BYTES, is_gltf, is_ply, read_file};
pub use import::{dependencies, import, import_part};
pub use model::{
    Channel, Component, HeightMap, ImageSource, Imported, ImportedMaterial, MaterialMaps, Part, SurfaceMap,
};
pub use setting::Impossible;
