//! Coding: chunks, the base mesh and the index, as symbols that [`crate::entropy`] turns into bytes.

mod attributes;
mod base_blob;
pub(crate) mod base_mesh;
pub(crate) mod chunk;
mod chunk_coder;
mod fan;
mod height;
pub(crate) mod index_page;
mod local;
pub(crate) mod model;
mod moves;
mod plan;
mod position;
mod residual;
mod scratch;
pub(crate) mod source;
mod split;
mod wedges;
