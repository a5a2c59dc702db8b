//! Coding chunks and the base mesh.

pub(crate) mod base;
pub(crate) mod chunk;
mod fan;
mod local;
mod model;
pub(crate) mod plan;
mod position;
mod split;
