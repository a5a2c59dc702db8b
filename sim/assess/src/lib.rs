//! Assessment of prepared geometry: sizes, speeds, validity of stated errors, and distances between surfaces.

pub mod assess;
pub mod measure;
pub mod normals;
pub mod train;
