//! Progressive meshes: quantise, simplify, chunk, code, refine, measure.
//!
//! The crate is pure: it opens no file and no socket, reads no clock, spawns no thread unless handed
//! a [`pool::Pool`], and links no C.

pub mod base;
mod ceiling;
pub mod check;
pub mod closed_set;
mod codec;
mod context;
pub mod distance;
pub mod error;
pub mod index;
pub mod mesh;
pub mod normals;
pub mod octahedral;
pub mod pack;
mod plain_coder;
pub mod pool;
pub mod prepare;
pub mod quantise;
pub mod random;
mod range_coder;
pub mod refine;
pub mod screen;
mod simplify;
mod slot_map;
mod stars;
pub mod steps;
mod symbols;
pub mod terrain;
pub mod training;
mod vec3;

#[cfg(test)]
extern crate self as lodestream_geometry;
#[cfg(test)]
#[path = "../tests/suite/common/mod.rs"]
mod common;

pub use codec::Codec;
pub use error::{DecodeError, MeshError};
pub use simplify::{Metric, Settings};
