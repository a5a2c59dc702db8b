//! CPU references: the shaders' computations in f64, for tests and figures.
//!
//! Each file mirrors one shader stage step by step. Where a stage approximates, the file also holds the exact
//! computation.

pub mod antialias;
pub mod bloom;
pub mod brdf;
pub mod debug;
pub mod depth;
#[cfg(test)]
pub(crate) mod floor;
pub mod ink;
pub mod lights;
pub mod occlusion;
#[cfg(any(test, feature = "methods"))]
pub mod pn_triangles;
pub mod reflections;
pub mod relief;
#[cfg(test)]
pub(crate) mod sky;
pub mod sunlight;
pub mod surface;
pub mod tangents;
pub mod temporal;
pub mod terrain;
pub mod tone;
pub mod transform;
#[cfg(test)]
pub(crate) mod water;
