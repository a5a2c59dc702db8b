//! Progressive meshes: quantise, simplify, chunk, code, refine, measure.
//!
//! The crate is pure: it opens no file and no socket, reads no clock, spawns no thread unless handed
//! a [`pool::Pool`], and links no C.

pub mod distance;
pub mod error;
pub mod index;
pub mod mesh;
pub mod screen;

pub use error::{DecodeError, MeshError};
