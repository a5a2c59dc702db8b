//! Coding of chunks, the base mesh and the index as symbols, which [`crate::entropy`] turns into bytes.

#![cfg_attr(
    not(test),
    warn(
        clippy::cast_possible_truncation,
        clippy::cast_possible_wrap,
        clippy::cast_precision_loss,
        clippy::cast_sign_loss
    )
)]

mod attributes;
pub(crate) mod base;
pub(crate) mod chunk;
mod chunk_coder;
mod delta;
mod elements;
mod fan;
mod gather;
mod gather_buffers;
mod height;
pub(crate) mod index_page;
mod local;
mod memory;
pub(crate) mod model;
mod moves;
mod numbering;
mod part;
mod plan;
mod position;
pub(crate) mod repeat;
mod residual;
mod ring;
mod scratch;
pub(crate) mod sheet;
mod skin;
pub(crate) mod source;
mod split;
mod star;
mod start;
pub(crate) mod uv_map;
mod wedges;
