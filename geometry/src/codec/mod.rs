//! Coding chunks and the base mesh.

pub(crate) mod attributes;
pub(crate) mod base;
pub(crate) mod chunk;
mod fan;
mod height;
mod local;
pub(crate) mod model;
pub(crate) mod plan;
pub(crate) mod position;
mod residual;
mod slot_map;
mod split;
mod wedges;
