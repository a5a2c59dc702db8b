//! How good prepared geometry is: sizes, speeds and honesty of stated errors, and the distance between two surfaces.

pub mod assess;
pub mod measure;
pub mod normals;
pub mod train;
