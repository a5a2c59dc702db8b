//! A prepared asset: base blob, chunk index, screen error, and the pack file.

#![cfg_attr(
    not(test),
    warn(
        clippy::cast_possible_truncation,
        clippy::cast_possible_wrap,
        clippy::cast_precision_loss,
        clippy::cast_sign_loss
    )
)]

pub mod base;
pub(crate) mod index;
pub mod pack;
pub mod screen;
