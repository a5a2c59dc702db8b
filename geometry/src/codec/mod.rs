//! Coding chunks and the base mesh.

pub(crate) mod attributes;
pub(crate) mod base;
pub(crate) mod chunk;
mod fan;
mod height;
mod local;
pub(crate) mod model;
mod moves;
pub(crate) mod plan;
pub(crate) mod position;
mod residual;
mod split;
mod wedges;

/// How the symbols of chunks and of the base mesh become bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Codec {
    /// An adaptive range coder with trained priors: the fewest bytes, and stopping points inside chunks.
    #[default]
    Range,
    /// Symbols as they are, sorted into streams, for a general-purpose compressor that the caller
    /// applies to whole blobs: more bytes, less to do. Without stopping points, since a compressed blob
    /// has no beginning that could be used.
    Plain,
}
