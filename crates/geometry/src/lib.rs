//! Progressive meshes: quantisation, simplification into chunks, coding, refinement and their checks.
//!
//! The crate is pure: it opens no file and no socket, reads no clock, spawns no thread unless handed
//! a [`pool::Pool`], and links no C.

// The encoder shares its model with the decoder; without the feature `prepare` parts of it have no caller.
#![cfg_attr(not(feature = "prepare"), allow(dead_code, reason = "encoders are called by preparation"))]

// Foundations.
#[cfg(feature = "prepare")]
pub mod checkpoint;
pub mod entropy;
pub mod error;
pub mod mesh;
mod name;
pub mod numbers;
pub mod pool;
pub mod random;

// From a mesh to a pack.
#[cfg(feature = "prepare")]
pub mod quantise;

mod collapse;
#[cfg(feature = "prepare")]
mod simplify;

mod codec;

#[cfg(feature = "prepare")]
pub mod prepare;

mod asset;

// From a pack back to a mesh.
pub mod refine;

pub mod check;

#[cfg(test)]
extern crate self as lodestream_geometry;
#[cfg(test)]
#[path = "../tests/suite/common/mod.rs"]
mod common;

pub use asset::{base, pack, screen};
pub use check::ancestor_closed_cut;
pub use entropy::{Codec, steps};
pub use error::{DecodeError, MeshError, SkippedTask};
pub use mesh::{distance, normals, octahedral};
pub use name::{Named, UnknownName};
#[cfg(feature = "prepare")]
pub use prepare::training;
#[cfg(feature = "prepare")]
pub use simplify::settings::{Metric, Settings, SettingsError};

/// The chunk index: metadata of each chunk, which a client needs before it requests the chunk.
pub mod index {
    pub use crate::asset::index::{
        CHUNKS_PER_PAGE, ChunkInfo, IndexPage, MAX_PARENTS, MAX_TRUNCATION_POINTS, Sphere, TruncationPoint,
        page_count,
    };
    pub use crate::codec::index_page::{
        decode_page, decode_stated_page, encode_page, encode_pages, expected_rest_error,
    };
}
